"""The figure of a sweep: loss and errors against the number of control points.

After figures 5 and 7 of Zhao et al. (2023), Computers and Geotechnics 161, 105564, with medians and
quartiles where there are several grains.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mbstudio.core.errors import FitError
from mbstudio.core.imaging.sweep import SweepRow, quantiles_of
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.scene.pictures.figures import DPI

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ENDINGS = (".svg", ".png", ".pdf")
_COLOURS = ("#2a7fb8", "#d99b45", "#a33b76", "#2f8f6b")
_MARKS = ("o", "s", "^", "D")
# Errors below this are those of the measuring, not of the avatar.
_LEAST_PERCENT = 1e-3
_LEAST_DECADES = 1.0

_Value = Callable[[SweepRow], float]


@dataclass(frozen=True)
class _Panel:
    """One diagram: its title, what it shows by name, and the label of its axis."""

    title: str
    shown: tuple[str, ...]
    axis: str = "Relative error (%)"
    dashed: int = 4  # from which line on: pairs that lie over each other stay apart


_WORDS = {
    "loss": "mean loss",
    "rms": "RMS distance / Dₙ",
    "hausdorff": "Hausdorff / Dₙ",
    "overlap_error": "1 − IoU",
    "seconds": "CPU time of a fit",
}
_SHAPE = "Shape factors"
_PANELS = (
    _Panel("Loss", ("loss",), "Mean loss after the search"),
    _Panel("Surface and overlap", ("rms", "hausdorff", "overlap_error"), "Distance, volume (%)"),
    _Panel("Size", ("volume", "area", "dn", "ds")),
    _Panel(_SHAPE, ("sphericity", "circularity", "csf", "dns")),
    _Panel("Axes", ("shortest", "intermediate", "longest")),
    _Panel("Ratios of the axes", ("elongation", "flatness", "krumbein", "sneed_folk")),
    _Panel(
        "Elongation and flatness (0 for a sphere)",
        ("potticary_elongation", "potticary_flatness", "angelidakis_elongation", "angelidakis_flatness"),
        dashed=2,
    ),
    _Panel("Cost", ("seconds",), "Seconds"),
)


def _panels() -> list[_Panel]:
    """Return the diagrams; factors that were added to the table join the others of shape."""
    placed = {name for panel in _PANELS for name in panel.shown}
    added = tuple(name for name in FACTORS.core if name not in placed)
    return [replace(p, shown=p.shown + added) if p.title == _SHAPE else p for p in _PANELS]


def sweep_figure(rows: Sequence[SweepRow]) -> Figure:
    """Draw loss, distances, errors of all factors and cost against n, both axes logarithmic.

    Lines are medians over the grains, bands reach from quartile to quartile.

    Raises
    ------
    FitError
        If there is no row with a loss.
    """
    from matplotlib.figure import Figure

    drawn = [row for row in rows if np.isfinite(row.loss)]
    if not drawn:
        raise FitError("The sweep has no fit to draw: its table says why the fits failed.")
    grains = len({row.label for row in drawn})
    figure = Figure(figsize=(16, 7.6), dpi=DPI, facecolor="white", layout="constrained")
    for index, (axes, panel) in enumerate(zip(figure.subplots(2, 4).flat, _panels(), strict=True)):
        _draw(axes, panel, drawn)
        axes.set_title(f"({'abcdefgh'[index]}) {panel.title}", fontsize=11, loc="left")
    sample = "1 grain" if grains == 1 else f"{grains} grains: medians, bands from quartile to quartile"
    figure.suptitle(f"Avatars against their number of control points, {sample}", fontsize=13)
    return figure


def save_sweep_figure(path: Path, rows: Sequence[SweepRow]) -> None:
    """Draw a sweep into a file: SVG, PNG or PDF by its ending; the file is replaced as a whole.

    Raises
    ------
    FitError
        If the ending is another, or there is nothing to draw.
    OSError
        If the file cannot be written.
    """
    from mbstudio.core.replacement import replacing

    require_ending(path)
    figure = sweep_figure(rows)
    with replacing(path) as temporary:
        figure.savefig(temporary, format=path.suffix.lower()[1:], facecolor="white")


def require_ending(path: Path) -> None:
    """Refuse a file name whose ending names no format of a figure."""
    if path.suffix.lower() not in ENDINGS:
        raise FitError(f"{path} does not have the ending of a figure: use {', '.join(ENDINGS)}.")


def _value_of(name: str) -> _Value:
    if name in ("loss", "seconds"):
        return lambda row: float(getattr(row, name))
    return lambda row: max(100.0 * row.error_of(name), _LEAST_PERCENT)


def _draw(axes: Axes, panel: _Panel, rows: Sequence[SweepRow]) -> None:
    several = len({row.label for row in rows}) > 1
    for index, name in enumerate(panel.shown):
        colour, mark = _COLOURS[index % len(_COLOURS)], _MARKS[index % len(_MARKS)]
        style = "-" if index < panel.dashed else (0, (4, 3))
        found = quantiles_of(rows, _value_of(name), (0.25, 0.5, 0.75))
        if not found:
            continue
        numbers = list(found)
        low, middle, high = np.array(list(found.values())).T
        if several:
            axes.fill_between(numbers, low, high, color=colour, alpha=0.13, linewidth=0)
        axes.plot(
            numbers, middle, color=colour, marker=mark, markersize=4.5, linewidth=1.7, linestyle=style,
            label=_WORDS[name] if name in _WORDS else FACTORS[name].label,
        )  # fmt: skip
    axes.set_xscale("log")
    axes.set_yscale("log")
    _mark_numbers(axes, sorted({row.n for row in rows}))
    _widen(axes)
    axes.set_xlabel("Number of control points n")
    axes.set_ylabel(panel.axis)
    axes.grid(alpha=0.25)
    if len(panel.shown) > 1 and axes.has_data():
        axes.legend(frameon=False, fontsize=8.5, handlelength=1.6, labelspacing=0.3)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _mark_numbers(axes: Axes, numbers: Sequence[int]) -> None:
    """Label the axis with the numbers themselves, leaving out those that would run into each other."""
    from matplotlib.ticker import FixedLocator, NullLocator

    span = np.log(numbers[-1] / numbers[0]) or 1.0
    shown = [numbers[-1]]
    for n in reversed(numbers[:-1]):
        if np.log(shown[-1] / n) > 0.07 * span:
            shown.append(n)
    axes.xaxis.set_major_locator(FixedLocator(shown))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(lambda value, _place: f"{value:g}")


def _widen(axes: Axes) -> None:
    """Show a decade at least, so that noise does not look like a trend, with plain numbers."""
    from matplotlib.ticker import LogLocator, NullFormatter

    low, high = axes.get_ylim()
    missing = _LEAST_DECADES - np.log10(high / low)
    if missing > 0:
        low, high = low * 10 ** (-missing / 2), high * 10 ** (missing / 2)
        axes.set_ylim(low, high)
    decades = np.log10(high / low)
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.5 else (1.0,), numticks=20))
    axes.yaxis.set_major_formatter(lambda value, _place: f"{value:,.0f}" if value >= 1000 else f"{value:.3g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
