"""How populations look in figures: colours, marks, axes and legends shared by all of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import MeasureError
from mbstudio.core.metrics.bodies import UNITLESS
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations import Population
from mbstudio.core.units import METRES_PER_UNIT, conversion_factor
from mbstudio.scene.theme import SceneTheme

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

DASHES: tuple[Any, ...] = ("solid", (0, (5, 1.6)), (0, (1.2, 1.2)))
MARKERS = ("o", "^", "s")
_GREY = "#6b7680"


def colour_of(population: Population, theme: SceneTheme) -> str:
    """Return the colour of a kind of bodies: the same in figures and in the 3-D scene."""
    return {"grains": theme.grain, "avatars": theme.avatar, "clones": theme.points}[population.kind]


def select_measured(populations: Sequence[Population]) -> list[Population]:
    """Return the populations of which something could be measured; MeasureError if there is none."""
    shown = [population for population in populations if population.measured.any()]
    if not shown:
        raise MeasureError("No body of these populations could be measured: there is nothing to draw.")
    return shown


def plain_axes(axes: Axes, theme: SceneTheme) -> None:
    """Give axes a light grid and no frame at the top and right."""
    axes.grid(alpha=0.25)
    axes.set_axisbelow(True)
    axes.tick_params(colors=theme.ink, labelsize=8.5)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(_GREY)


def scatter(
    axes: Axes,
    population: Population,
    x: Float[np.ndarray, " bodies"],
    y: Float[np.ndarray, " bodies"],
    place: int,
    theme: SceneTheme,
    size: float,
) -> None:
    """Draw one point a body, the fainter the more there are."""
    axes.scatter(
        x, y, s=size, color=colour_of(population, theme), linewidths=0, zorder=2, rasterized=True,
        alpha=float(np.clip(12.0 / np.sqrt(max(1, len(x))), 0.25, 0.8)), marker=MARKERS[place % len(MARKERS)],
    )  # fmt: skip


def line_handle(population: Population, place: int, theme: SceneTheme) -> Line2D:
    """Return a legend's line of a population."""
    from matplotlib.lines import Line2D

    return Line2D(
        [], [], color=colour_of(population, theme), linewidth=2, linestyle=DASHES[place % len(DASHES)]
    )


def marker_handles(shown: Sequence[Population], theme: SceneTheme) -> tuple[list[Line2D], list[str]]:
    """Return a legend's marks and words: the name and the number of bodies measured."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], linestyle="", marker=MARKERS[place % len(MARKERS)], color=colour_of(p, theme))
        for place, p in enumerate(shown)
    ]
    return handles, [f"{p.name} ({int(p.measured.sum())})" for p in shown]


def readable_scale(populations: Sequence[Population], factor: str) -> tuple[float, str]:
    """Return by what to multiply a factor, and the length unit that it is in then, for short numbers."""
    unit, power = populations[0].unit, FACTORS[factor].power
    values = np.concatenate([population.values(factor) for population in populations])
    if not power or unit == UNITLESS or not len(values):
        return 1.0, unit
    middle = abs(float(np.median(values)))
    scales = {name: conversion_factor(unit, name) ** power for name in ("um", "mm", "m", *METRES_PER_UNIT)}
    fitting = [name for name in (unit, *scales) if 0.01 <= middle * scales.get(name, 1.0) < 10_000]
    chosen = fitting[0] if fitting else unit
    return scales.get(chosen, 1.0), chosen
