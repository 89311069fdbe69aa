"""What the latent studio tells of a kept grain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbstudio.core.units import unit_label
from mbstudio.core.vae.meaning_factors import MEANINGS
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.factor_radar import SHORT

if TYPE_CHECKING:
    from mbstudio.core.vae.kept_grain import KeptGrain


def told_of(grain: KeptGrain) -> str:
    """Return name and factors of a kept grain, and how it was made."""
    unit = unit_label(grain.unit)
    factors = ", ".join(
        f"{tr(SHORT[name])} {value:.4g} {unit}" if name == "size" else f"{tr(SHORT[name])} {value:.3f}"
        for name, value in zip(MEANINGS, grain.factors, strict=True)
    )
    return tr(
        "{grain}: {factors}\nMade by: {operations}",
        grain=grain.name,
        factors=factors,
        operations=grain.recipe.words,
    )
