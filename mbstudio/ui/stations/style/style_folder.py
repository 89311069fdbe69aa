"""Opens the folder of a style-learner, with what the person should know about its files."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from mbstudio.core.errors import StyleWarning

if TYPE_CHECKING:
    from mbstudio.core.cloning.surface_style import SurfaceStyle
    from mbstudio.core.vae.models.style_learner import StyleLearner


def open_style_folder(folder: Path) -> tuple[StyleLearner | SurfaceStyle, tuple[str, ...]]:
    """Return the style-learner or the style of surfaces of a folder, and notes on it.

    Surfaces get their metaballs where the folder was written without.
    """
    from mbstudio.core.cloning.parent_avatars import fit_parents
    from mbstudio.core.cloning.surface_style_file import holds_surface_style, load_surface_style
    from mbstudio.core.vae.models.style_learner import load_style_learner

    found: StyleLearner | SurfaceStyle
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", StyleWarning)
        if holds_surface_style(folder):
            style = load_surface_style(folder)
            found = style if style.avatars else fit_parents(style)
        else:
            found = load_style_learner(folder)
    return found, tuple(str(one.message) for one in told if issubclass(one.category, StyleWarning))
