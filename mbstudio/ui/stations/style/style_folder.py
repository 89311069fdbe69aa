"""Opens the folder of a style-learner, with what the person should know about its files."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from mbstudio.core.errors import StyleWarning

if TYPE_CHECKING:
    from mbstudio.core.vae.models.style_learner import StyleLearner


def open_style_folder(folder: Path) -> tuple[StyleLearner, tuple[str, ...]]:
    """Return the style-learner of a folder, and notes on it."""
    from mbstudio.core.vae.models.style_learner import load_style_learner

    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", StyleWarning)
        learner = load_style_learner(folder)
    return learner, tuple(str(one.message) for one in told if issubclass(one.category, StyleWarning))
