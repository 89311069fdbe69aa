"""Figures of populations: distributions compared, joint views, sieve curves."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float

from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations import (
    PAPER_FACTORS,
    Population,
    SizeDistribution,
    bin_edges,
    compare,
    cumulative,
    histogram,
    kernel_density,
)
from mbstudio.core.populations.bootstrap import Bootstrap
from mbstudio.core.populations.laboratory import LaboratoryCurve
from mbstudio.core.units import conversion_factor
from mbstudio.scene.figures.population_style import (
    DASHES,
    MARKERS,
    colour_of,
    line_handle,
    marker_handles,
    plain_axes,
    readable_scale,
    scatter,
    select_measured,
)
from mbstudio.scene.pictures.figures import DPI
from mbstudio.scene.theme import LIGHT, SceneTheme

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mbstudio.core.populations.comparison import FactorComparison
    from mbstudio.core.populations.population import Weighting

JOINT_FACTORS = ("dn", "sphericity", "circularity", "csf", "dns")
"""Factors of the pairwise matrix."""

_MOST_POINTS = 4000
_BAND_POINTS, _BAND_SAMPLES = 120, 400


def cdf_figure(
    populations: Sequence[Population],
    factors: Sequence[str] = PAPER_FACTORS,
    *,
    by: Weighting = "number",
    theme: SceneTheme = LIGHT,
    bands: bool = False,
) -> Figure:
    """Draw the cumulative distributions of each factor, as the paper's figure 8 does.

    Parameters
    ----------
    populations : sequence of Population
        The first is the reference: every legend states the relative errors of the others' mean and standard
        deviation against it. Of one unit and one axis convention.
    factors : sequence of str
    by : {'number', 'volume'}
    theme : SceneTheme
    bands : bool
        Shade what drawing the bodies again shows, at 95 % for each point.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    MeasureError
        If no body of any population could be measured, or the populations were measured differently.
    """
    return _distributions_figure(populations, factors, by, theme, "cdf", bands)


def pdf_figure(
    populations: Sequence[Population],
    factors: Sequence[str] = PAPER_FACTORS,
    *,
    by: Weighting = "number",
    theme: SceneTheme = LIGHT,
) -> Figure:
    """Draw histogram and kernel density of each factor, as the paper's figures 11 and 12 do.

    Parameters, result and errors are those of `cdf_figure`. The bins are those of the reference, widened to
    hold all values.
    """
    return _distributions_figure(populations, factors, by, theme, "pdf")


def distribution_figure(
    populations: Sequence[Population],
    factor: str,
    *,
    by: Weighting = "number",
    theme: SceneTheme = LIGHT,
    bands: bool = False,
) -> Figure:
    """Draw one factor: its cumulative distributions beside its densities.

    Parameters, result and errors are those of `cdf_figure`.
    """
    from matplotlib.figure import Figure

    shown = select_measured(populations)
    errors = [compare(shown[0], other, [factor], by=by).get(factor) for other in shown[1:]]
    scale, unit = readable_scale(shown, factor)
    figure = Figure(figsize=(9.6, 4), dpi=DPI, facecolor="white", layout="constrained")
    share = "number" if by == "number" else "mass"
    words = (f"Cumulative share by {share}", f"Density by {share}")
    for axes, draw, word in zip(figure.subplots(1, 2), (_draw_cdf, _draw_pdf), words, strict=True):
        plain_axes(axes, theme)
        draw(axes, shown, factor, by, theme, scale)
        if bands and draw is _draw_cdf:
            _draw_bands(axes, shown, factor, by, theme, scale)
        axes.set_xlabel(FACTORS[factor].heading(unit), color=theme.ink)
        axes.set_ylabel(word, color=theme.ink)
        _legend(axes, shown, errors, theme)
    return figure


def _distributions_figure(
    populations: Sequence[Population],
    factors: Sequence[str],
    by: Weighting,
    theme: SceneTheme,
    kind: Literal["cdf", "pdf"],
    bands: bool = False,
) -> Figure:
    from matplotlib.figure import Figure

    shown = select_measured(populations)
    errors = [compare(shown[0], other, factors, by=by) for other in shown[1:]]
    columns = min(3, len(factors))
    rows = -(-len(factors) // columns)
    figure = Figure(figsize=(4.3 * columns, 3.5 * rows), dpi=DPI, facecolor="white", layout="constrained")
    places = figure.subplots(rows, columns, squeeze=False).ravel()
    for place, axes in enumerate(places):
        if place >= len(factors):
            axes.set_axis_off()
            continue
        name = factors[place]
        plain_axes(axes, theme)
        scale, unit = readable_scale(shown, name)
        axes.set_xlabel(FACTORS[name].heading(unit), color=theme.ink)
        draw = _draw_cdf if kind == "cdf" else _draw_pdf
        draw(axes, shown, name, by, theme, scale)
        if bands:
            _draw_bands(axes, shown, name, by, theme, scale)
        if place % columns == 0:
            share = "number" if by == "number" else "mass"
            axes.set_ylabel(
                f"Cumulative share by {share}" if kind == "cdf" else f"Density by {share}", color=theme.ink
            )
        _legend(axes, shown, [found.get(name) for found in errors], theme)
    return figure


def _draw_cdf(
    axes: Axes, shown: Sequence[Population], name: str, by: Weighting, theme: SceneTheme, scale: float
) -> None:
    for place, population in enumerate(shown):
        values = scale * population.values(name)
        if not len(values):
            continue
        cdf = cumulative(values, population.weights(name, by))
        axes.step(
            np.concatenate([cdf.values[:1], cdf.values]), np.concatenate([[0.0], cdf.shares]), where="post",
            color=colour_of(population, theme), linewidth=1.8, linestyle=DASHES[place % len(DASHES)],
        )  # fmt: skip
    axes.set_ylim(0, 1.02)


def _draw_bands(
    axes: Axes, shown: Sequence[Population], name: str, by: Weighting, theme: SceneTheme, scale: float
) -> None:
    for population in shown:
        values = population.values(name)
        if not len(values):
            continue
        at = np.linspace(float(values.min()), float(values.max()), _BAND_POINTS)
        band = Bootstrap(population, samples=_BAND_SAMPLES).cumulative(name, at, by)
        axes.fill_between(
            scale * at,
            band.low,
            band.high,
            color=colour_of(population, theme),
            alpha=0.18,
            linewidth=0,
            step="post",
        )


def _draw_pdf(
    axes: Axes, shown: Sequence[Population], name: str, by: Weighting, theme: SceneTheme, scale: float
) -> None:
    given = [(place, p) for place, p in enumerate(shown) if len(p.values(name))]
    if not given:
        return
    everything = scale * np.concatenate([p.values(name) for _, p in given])
    edges = shared_edges(shown, name, by, scale)
    for place, population in given:
        values, weights = scale * population.values(name), population.weights(name, by)
        colour = colour_of(population, theme)
        bars = histogram(values, weights, edges)
        axes.stairs(bars.density, bars.x, color=colour, fill=True, alpha=0.22, linewidth=0)
        axes.stairs(bars.density, bars.x, color=colour, alpha=0.55, linewidth=0.7)
        if np.ptp(values) > 1e-9 * abs(values).max():
            smooth = kernel_density(values, weights)
            axes.plot(
                smooth.x, smooth.density, color=colour, linewidth=1.9, linestyle=DASHES[place % len(DASHES)]
            )
    low, high = float(everything.min()), float(everything.max())
    margin = 0.06 * (high - low) or 0.1
    # Kernels reach below zero where no body can lie.
    axes.set_xlim(max(low - margin, 0.0) if low >= 0 else low - margin, high + margin)
    axes.set_ylim(bottom=0)


def shared_edges(
    populations: Sequence[Population], factor: str, by: Weighting = "number", scale: float = 1.0
) -> Float[np.ndarray, " edges"]:
    """Return bins for all populations: those of the first that has the factor, widened to hold all values.

    Empty if none has it.
    """
    given = [population for population in populations if len(population.values(factor))]
    if not given:
        return np.zeros(0)
    everything = scale * np.concatenate([population.values(factor) for population in given])
    own = bin_edges(scale * given[0].values(factor), given[0].weights(factor, by))
    return _widen_edges(own, everything)


def _widen_edges(edges: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the edges, with as many more of the same width as hold all values."""
    width = edges[1] - edges[0]
    before = int(np.ceil(max(0.0, edges[0] - values.min()) / width))
    after = int(np.ceil(max(0.0, values.max() - edges[-1]) / width))
    # Values far from the reference must not make more bars than a picture can show.
    before, after = min(before, 200), min(after, 200)
    return edges[0] + width * np.arange(-before, len(edges) + after)


def _legend(
    axes: Axes, shown: Sequence[Population], errors: Sequence[FactorComparison | None], theme: SceneTheme
) -> None:
    words = [shown[0].name]
    for population, found in zip(shown[1:], errors, strict=True):
        stated = "" if found is None else (
            f": δ mean {_percent(found.mean_error)}, s.d. {_percent(found.deviation_error)}"
        )  # fmt: skip
        words.append(population.name + stated)
    # Above the axes, where it hides no curve.
    axes.legend(
        [line_handle(population, place, theme) for place, population in enumerate(shown)], words,
        frameon=False, fontsize=8.5, loc="lower left", bbox_to_anchor=(0, 1.0), borderaxespad=0.2,
        labelcolor=theme.ink, handlelength=2.4,
    )  # fmt: skip


def _percent(error: float) -> str:
    return f"{error:.2f} %" if np.isfinite(error) else "–"


def joint_figure(
    populations: Sequence[Population],
    factors: Sequence[str] = JOINT_FACTORS,
    *,
    theme: SceneTheme = LIGHT,
) -> Figure:
    """Draw every factor against every other, and each one's density on the diagonal.

    Of a very large population only every k-th body is drawn.

    Raises
    ------
    MeasureError
        If no body of any population could be measured.
    """
    from matplotlib.figure import Figure

    shown = select_measured(populations)
    count = len(factors)
    scales = {name: readable_scale(shown, name) for name in factors}
    headings = [FACTORS[name].heading(scales[name][1]) for name in factors]
    figure = Figure(figsize=(2.15 * count, 2.15 * count), dpi=DPI, facecolor="white", layout="constrained")
    places = figure.subplots(count, count, squeeze=False)
    for row, column in product(range(count), repeat=2):
        axes = places[row, column]
        if column > row:
            axes.set_axis_off()
            continue
        plain_axes(axes, theme)
        axes.tick_params(labelsize=7, labelbottom=row == count - 1, labelleft=column == 0 < row)
        axes.locator_params(nbins=4)
        if row == column:
            _draw_pdf(axes, shown, factors[row], "number", theme, scales[factors[row]][0])
            axes.set_yticks([])
            axes.grid(False)
        else:
            axes.sharex(places[column, column])
            for place, population in enumerate(shown):
                x, y = (scales[f][0] * population.column(f) for f in (factors[column], factors[row]))
                step = max(1, len(population) // _MOST_POINTS)
                scatter(axes, population, x[::step], y[::step], place, theme, 7)
        if row == count - 1:
            axes.set_xlabel(FACTORS[factors[column]].heading(shown[0].unit), fontsize=8.5, color=theme.ink)
        if column == 0 and row > 0:
            axes.set_ylabel(headings[row], fontsize=8.5, color=theme.ink)
    corner = places[0, -1] if count > 1 else places[0, 0]
    corner.legend(*marker_handles(shown, theme), frameon=False, loc="upper right", labelcolor=theme.ink)
    return figure


def sieve_figure(
    curves: Sequence[tuple[Population, SizeDistribution]],
    *,
    laboratory: Sequence[LaboratoryCurve] = (),
    bands: bool = False,
    theme: SceneTheme = LIGHT,
) -> Figure:
    """Draw percent finer by mass against size in mm on a logarithmic axis, as sieve analyses are drawn.

    Parameters
    ----------
    curves : sequence of (Population, SizeDistribution)
        A curve on sieves is drawn with a mark at every sieve, one of the bodies' own sizes as a plain line.
    laboratory : sequence of LaboratoryCurve
        Measured curves, drawn beside them.
    bands : bool
        Shade what drawing the bodies again shows, at 95 % for each size.
    theme : SceneTheme

    Raises
    ------
    UnitError
        If a curve has no unit.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    figure = Figure(figsize=(8.2, 5), dpi=DPI, facecolor="white", layout="constrained")
    axes = figure.subplots()
    plain_axes(axes, theme)
    reach: list[float] = []
    for place, (population, curve) in enumerate(curves):
        sizes = curve.sizes * conversion_factor(curve.unit, "mm")
        reach += [float(sizes[0]), float(sizes[-1])]
        if bands:
            band = Bootstrap(population, samples=_BAND_SAMPLES).finer(_thinned(curve.sizes))
            axes.fill_between(
                band.x * conversion_factor(curve.unit, "mm"), band.low, band.high,
                color=colour_of(population, theme), alpha=0.18, linewidth=0,
            )  # fmt: skip
        axes.plot(
            sizes, curve.finer, color=colour_of(population, theme), linewidth=1.9,
            linestyle=DASHES[place % len(DASHES)], marker=MARKERS[place % 3] if curve.sieves else "",
            markersize=5, label=_sieve_words(population, curve),
        )  # fmt: skip
    for place, measured in enumerate(laboratory):
        sizes = measured.curve.sizes
        reach += [float(sizes[0]), float(sizes[-1])]
        axes.plot(
            sizes, measured.curve.finer, color=theme.ink, linewidth=1.4,
            linestyle=DASHES[(place + 1) % len(DASHES)], marker="D", markersize=4.5,
            label=f"{measured.name} (laboratory)",
        )  # fmt: skip
    axes.set_xscale("log")
    # Whole decades are the standards' look, but they squeeze a uniform sand into a sliver.
    low, high = min(reach), max(reach)
    axes.set_xlim(low / 1.25, high * 1.25)
    axes.xaxis.set_major_locator(LogLocator(subs=_subdivisions(high / low)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(LogLocator(subs=tuple(range(1, 10))))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_ylim(0, 100)
    axes.set_yticks(np.arange(0, 101, 10))
    axes.grid(which="minor", alpha=0.18, linewidth=0.5)
    axes.grid(which="major", alpha=0.4, linewidth=0.7)
    named = sorted({curve.sieves for _, curve in curves if curve.sieves})
    words = f"Sieve opening (mm), {', '.join(named)}" if named else "Size: intermediate axis b (mm)"
    axes.set_xlabel(words, color=theme.ink)
    axes.set_ylabel("Percent finer by mass", color=theme.ink)
    legend = axes.legend(loc="upper left", fontsize=8.5, labelcolor=theme.ink, framealpha=0.92)
    legend.get_frame().set_edgecolor("#d5dbe0")
    return figure


def _thinned(sizes: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
    """Return at most as many sizes as a band is drawn of."""
    step = max(1, len(sizes) // _BAND_POINTS)
    return np.unique(np.append(sizes[::step], sizes[-1]))


def _sieve_words(population: Population, curve: SizeDistribution) -> str:
    def length(value: float) -> str:
        return f"{value * conversion_factor(curve.unit, 'mm'):#.3g}" if np.isfinite(value) else "–"

    def number(value: float) -> str:
        return f"{value:.2f}" if np.isfinite(value) else "–"

    sizes = " / ".join(length(curve.diameter(percent)) for percent in (10, 30, 50, 60))
    return (
        f"{population.name}: D10 / D30 / D50 / D60 = {sizes} mm\n"
        f"$C_u$ = {number(curve.cu)}, $C_c$ = {number(curve.cc)}"
    )


def _subdivisions(ratio: float) -> tuple[float, ...]:
    """Return which numbers of a decade are named on an axis that spans so many times its start."""
    if ratio < 12:
        return (1, 1.5, 2, 3, 4, 5, 6, 8)
    return (1, 2, 5) if ratio < 300 else (1,)
