"""Diagrams of form: Zingg's square and the triangle of Sneed and Folk."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations import FormDiagram, Population, sneed_folk_diagram, zingg_diagram
from mbstudio.core.populations.form import SNEED_FOLK_HEIGHTS, SNEED_FOLK_SIDES, ZINGG_LIMIT
from mbstudio.scene.figures.population_style import (
    colour_of,
    marker_handles,
    plain_axes,
    scatter,
    select_measured,
)
from mbstudio.scene.pictures.figures import DPI
from mbstudio.scene.theme import LIGHT, SceneTheme

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LINE = "#8d98a3"
_TALL = np.sqrt(3.0) / 2.0


def zingg_figure(populations: Sequence[Population], *, theme: SceneTheme = LIGHT) -> Figure:
    """Draw b/a against c/b, the four classes and how many bodies lie in each.

    Raises
    ------
    MeasureError
        If no body of any population could be measured.
    """
    from matplotlib.figure import Figure

    shown = select_measured(populations)
    figure = Figure(figsize=(6.4, 6.2), dpi=DPI, facecolor="white", layout="constrained")
    axes = figure.subplots()
    plain_axes(axes, theme)
    axes.grid(False)
    diagrams = [zingg_diagram(population) for population in shown]
    for place, (population, diagram) in enumerate(zip(shown, diagrams, strict=True)):
        scatter(axes, population, diagram.x, diagram.y, place, theme, 14)
    axes.axhline(ZINGG_LIMIT, color=_LINE, linewidth=1, linestyle=(0, (4, 2)))
    axes.axvline(ZINGG_LIMIT, color=_LINE, linewidth=1, linestyle=(0, (4, 2)))
    left, right = ZINGG_LIMIT / 2, (1 + ZINGG_LIMIT) / 2
    # Those above lie outside the square: most bodies lie in its upper right.
    for name, (x, y) in {
        "disc": (left, 1.012), "equant": (right, 1.012), "blade": (left, 0.015), "rod": (right, 0.015),
    }.items():  # fmt: skip
        axes.text(x, y, f"{name}  {_shares(name, diagrams)}", ha="center", va="bottom", fontsize=9.5,
                  color=theme.ink)  # fmt: skip
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    axes.set_aspect("equal")
    axes.set_xlabel(FACTORS["flatness"].label, color=theme.ink)
    axes.set_ylabel(FACTORS["elongation"].label, color=theme.ink)
    _legend(figure, shown, theme)
    return figure


def sneed_folk_figure(populations: Sequence[Population], *, theme: SceneTheme = LIGHT) -> Figure:
    """Draw the triangle of c/a upwards and (a - b) / (a - c) across, with its ten classes.

    Raises
    ------
    MeasureError
        If no body of any population could be measured.
    """
    from matplotlib import patheffects
    from matplotlib.figure import Figure

    shown = select_measured(populations)
    figure = Figure(figsize=(7.2, 6.4), dpi=DPI, facecolor="white", layout="constrained")
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set_aspect("equal")
    corners = triangle(np.array([0.0, 1.0, 0.5, 0.0]), np.array([0.0, 0.0, 1.0, 0.0]))
    for height in SNEED_FOLK_HEIGHTS:
        line = triangle(np.array([0.0, 1.0]), np.full(2, height))
        axes.plot(*line.T, color=_LINE, linewidth=0.9)
    for side in SNEED_FOLK_SIDES:
        line = triangle(np.full(2, side), np.array([0.0, SNEED_FOLK_HEIGHTS[-1]]))
        axes.plot(*line.T, color=_LINE, linewidth=0.9)
    diagrams = [sneed_folk_diagram(population) for population in shown]
    for place, (population, diagram) in enumerate(zip(shown, diagrams, strict=True)):
        x, y = triangle(diagram.x, diagram.y).T
        scatter(axes, population, x, y, place, theme, 14)
    axes.plot(*corners.T, color=theme.ink, linewidth=1.3)
    _triangle_scales(axes, theme)
    halo = [patheffects.withStroke(linewidth=3, foreground="white")]
    for name, (side, height) in CLASS_PLACES.items():
        x, y = triangle(np.array([side]), np.array([height]))[0]
        axes.text(x, y, SHORT[name], ha="center", va="center", fontsize=11, weight="bold", color=_LINE,
                  path_effects=halo, zorder=3)  # fmt: skip
    _class_table(axes, shown, diagrams, theme)
    axes.set_xlim(-0.08, 1.09 + 0.085 * len(shown))
    axes.set_ylim(-0.13, _TALL + 0.08)
    _legend(figure, shown, theme)
    return figure


def triangle(
    side: Float[np.ndarray, " points"], height: Float[np.ndarray, " points"]
) -> Float[np.ndarray, "points 2"]:
    """Return places in a triangle of base 1: c/a = 1 is its top, platy bodies lie left, elongate right."""
    return np.stack([0.5 + (1.0 - height) * (side - 0.5), _TALL * height], axis=1)


SHORT = {
    "compact": "C", "compact-platy": "CP", "compact-bladed": "CB", "compact-elongate": "CE", "platy": "P",
    "bladed": "B", "elongate": "E", "very platy": "VP", "very bladed": "VB", "very elongate": "VE",
}  # fmt: skip
CLASS_PLACES = {
    "compact": (0.5, 0.79),
    "compact-platy": (1 / 6, 0.6), "compact-bladed": (0.5, 0.6), "compact-elongate": (5 / 6, 0.6),
    "platy": (1 / 6, 0.4), "bladed": (0.5, 0.4), "elongate": (5 / 6, 0.4),
    "very platy": (1 / 6, 0.15), "very bladed": (0.5, 0.15), "very elongate": (5 / 6, 0.15),
}  # fmt: skip


def _triangle_scales(axes: Axes, theme: SceneTheme) -> None:
    for height in (0.0, *SNEED_FOLK_HEIGHTS, 1.0):
        x, y = triangle(np.array([0.0]), np.array([height]))[0]
        axes.text(x - 0.015, y, f"{height:g}", ha="right", va="center", fontsize=8.5, color=theme.ink)
    for side, words in ((0.0, "0"), (1 / 3, "0.33"), (2 / 3, "0.67"), (1.0, "1")):
        x, y = triangle(np.array([side]), np.array([0.0]))[0]
        axes.text(x, y - 0.015, words, ha="center", va="top", fontsize=8.5, color=theme.ink)
    axes.text(0.14, 0.5 * _TALL, "c / a", rotation=60, ha="center", fontsize=10, color=theme.ink)
    axes.text(0.5, -0.085, "(a − b) / (a − c)", ha="center", va="center", fontsize=10, color=theme.ink)
    for x, y, words, across in (
        (0.5, _TALL + 0.02, "compact", "center"), (-0.02, -0.06, "platy", "left"),
        (1.02, -0.06, "elongate", "right"),
    ):  # fmt: skip
        axes.text(x, y, words, ha=across, va="bottom" if y > 0 else "center", fontsize=9.5, color=theme.ink)


def _class_table(
    axes: Axes, shown: Sequence[Population], diagrams: Sequence[FormDiagram], theme: SceneTheme
) -> None:
    """Write the share of every class beside the triangle, each population in its colour."""
    top, line = _TALL + 0.02, 0.042
    for row, (name, short) in enumerate(SHORT.items()):
        y = top - line * row
        axes.text(0.74, y, short, fontsize=8.5, weight="bold", color=_LINE, va="center")
        axes.text(0.795, y, name, fontsize=8.5, color=theme.ink, va="center")
        for place, (population, diagram) in enumerate(zip(shown, diagrams, strict=True)):
            axes.text(1.09 + 0.085 * place, y, _share(diagram, name), fontsize=8.5, ha="right", va="center",
                      color=colour_of(population, theme))  # fmt: skip


def _share(diagram: FormDiagram, name: str) -> str:
    return f"{100.0 * diagram.counts[name] / max(1, len(diagram.classes)):.0f} %"


def _shares(name: str, diagrams: Sequence[FormDiagram]) -> str:
    return " | ".join(_share(diagram, name) for diagram in diagrams)


def _legend(figure: Figure, shown: Sequence[Population], theme: SceneTheme) -> None:
    figure.legend(
        *marker_handles(shown, theme), frameon=False, loc="outside upper center", ncols=len(shown),
        labelcolor=theme.ink,
    )  # fmt: skip
