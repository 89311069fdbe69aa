"""The presets of the style-learner: to add one, write its module and name it here."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from mbstudio.core.errors import StyleError

if TYPE_CHECKING:
    from mbstudio.core.vae.models.style_preset import StylePreset

# Imported when first asked for: a command line that learns nothing does without them.
_MODULES = {
    "aligned": "aligned_training",
    "pca": "principal",
    "paper": "paper_training",
}

PRESETS = tuple(_MODULES)
"""Names of the presets; the first is the usual one."""


def find_preset(name: str) -> StylePreset:
    """Return a preset: the entry ``PRESET`` with which its module ends.

    Raises
    ------
    StyleError
        If there is none of that name.
    """
    if name not in _MODULES:
        raise StyleError(f"There is no style-learner '{name}': use one of {', '.join(PRESETS)}.")
    found: StylePreset = import_module(f"mbstudio.core.vae.models.{_MODULES[name]}").PRESET
    return found


def recommended_preset(parents: int) -> StylePreset:
    """Return the first preset to which so many parents are enough; the usual one if they are to none."""
    presets = [find_preset(name) for name in PRESETS]
    return next((preset for preset in presets if preset.enough_parents <= parents), presets[0])
