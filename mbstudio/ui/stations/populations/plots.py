"""What populations look like in the window: distributions, pairs, forms and sieve curves."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyqtgraph as pg
from jaxtyping import Float
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QVBoxLayout, QWidget

from mbstudio.core.errors import MbstudioError
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations import (
    Band,
    LaboratoryCurve,
    Population,
    SizeDistribution,
    cumulative,
    histogram,
    kernel_density,
    largest_gap,
    size_distribution,
    sneed_folk_diagram,
    zingg_diagram,
)
from mbstudio.core.populations.form import SNEED_FOLK_HEIGHTS, SNEED_FOLK_SIDES, ZINGG_LIMIT
from mbstudio.core.populations.population import Weighting
from mbstudio.core.populations.sieving import SERIES_NAMES, SieveSeries
from mbstudio.core.units import conversion_factor
from mbstudio.scene.figures.form_figures import CLASS_PLACES, SHORT, triangle
from mbstudio.scene.figures.population_figures import shared_edges
from mbstudio.scene.figures.population_style import colour_of, readable_scale
from mbstudio.ui.language import tr
from mbstudio.ui.stations.populations.certainty import Certainty
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.brush_plot import SYMBOLS, BrushPlot, Mode, Points
from mbstudio.ui.widgets.comparison_table import name_of
from mbstudio.ui.widgets.factor_words import factor_heading, factor_label
from mbstudio.ui.widgets.forms import label

Counts = Mapping[int, np.ndarray]
"""How many bodies each of a population stands for, by the population's identity."""
STYLES = (Qt.PenStyle.SolidLine, Qt.PenStyle.DashLine, Qt.PenStyle.DotLine)


@dataclass(frozen=True)
class Shown:
    """What of the populations is looked at.

    Attributes
    ----------
    factor, second : str
        Factor of the distributions, and the one that pairs set against it.
    by : {'number', 'volume'}
    sieves : {'iso', 'astm'} or None
        Where sizes are read off; None: at every body's own size.
    border : bool
        Whether size curves count grains for those that the border cuts.
    certainty : Certainty or None
        How sure it is, once that was found.
    """

    factor: str = "sphericity"
    second: str = "csf"
    by: Weighting = "number"
    sieves: SieveSeries | None = None
    border: bool = False
    certainty: Certainty | None = None


class PopulationPlot(QWidget):
    """One page of the plots; what it draws are its subclasses' matters.

    Attributes
    ----------
    brushed : signal (list of int, bool)
    menu_asked : signal (int or None, QPoint)
    """

    brushed = Signal(object, bool)
    menu_asked = Signal(object, object)

    def __init__(self, theme: Theme, *plots: BrushPlot) -> None:
        super().__init__()
        self.plots = plots
        self._theme = theme
        self._populations: Sequence[Population] = ()
        self._drawn: list[tuple[BrushPlot, pg.GraphicsObject]] = []
        self._shown = Shown()
        self._tables: Sequence[LaboratoryCurve] = ()
        self._counts: Counts = {}
        self._note = label("", "hint", wrap=True)
        self._note.setContentsMargins(14, 0, 14, 8)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 4, 0, 0)
        layout.setSpacing(2)
        for plot in plots:
            layout.addWidget(plot, 1)
            plot.brushed.connect(self.brushed)
            plot.menu_asked.connect(self.menu_asked)
        layout.addWidget(self._note)
        theme.changed.connect(self.redraw)

    def show_populations(
        self,
        populations: Sequence[Population],
        shown: Shown,
        tables: Sequence[LaboratoryCurve] = (),
        counts: Counts | None = None,
    ) -> None:
        """Draw these populations, and tables of laboratories beside their size curves."""
        self._populations, self._shown = populations, shown
        self._tables, self._counts = tables, counts or {}
        self.redraw()
        self.show_everything()

    def show_certainty(self, shown: Shown) -> None:
        """Draw bands too, without moving the view."""
        self._shown = shown
        self.redraw()

    def _band(self, kind: str, place: int) -> Band | None:
        """Return the band of a population's curve where it is known for what is drawn."""
        certainty, shown = self._shown.certainty, self._shown
        if certainty is None or not certainty.is_of(self._populations, shown.factor, shown.by):
            return None
        found: Band | None = getattr(certainty, kind)[place]
        return found if found is not None and np.isfinite(found.low).all() else None

    def _shade(self, plot: BrushPlot, place: int, x: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
        """Draw a band between two curves."""
        colour = QColor(self._colour(self._populations[place]))
        colour.setAlpha(45)
        ends = [pg.PlotCurveItem(x, np.asarray(y, float), pen=pg.mkPen(None)) for y in (low, high)]
        self._add(plot, pg.FillBetweenItem(*ends, brush=colour), bounds=False)

    def show_everything(self) -> None:
        """Undo zooming."""
        for plot in self.plots:
            plot.show_everything()

    def redraw(self) -> None:
        """Draw everything anew, in the colours of the theme that holds now."""
        for plot, item in self._drawn:
            plot.removeItem(item)
        self._drawn.clear()
        note = ""
        if self._populations:
            try:
                note = self._draw()
            except MbstudioError as error:  # sizes outside the sieves: said where the plot would stand
                for plot in self.plots:
                    plot.set_points([])
                note = str(error)
        self._note.setText(note)
        self._note.setVisible(bool(note))

    def mark(self, labels: Collection[int], current: int | None) -> None:
        """Bring out the bodies of these labels."""
        for plot in self.plots:
            plot.mark(labels, current)

    def set_mode(self, mode: Mode) -> None:
        """Drag rectangles or lassos."""
        for plot in self.plots:
            plot.box.mode = mode

    def _draw(self) -> str:
        """Draw, and return what is to be said below the plot."""
        raise NotImplementedError

    def _colour(self, population: Population) -> str:
        return colour_of(population, self._theme.scene)

    def _pen(self, place: int, population: Population) -> object:
        return pg.mkPen(self._colour(population), width=2, style=STYLES[place % len(STYLES)])

    def _add(self, plot: BrushPlot, item: pg.GraphicsObject, *, bounds: bool = True) -> None:
        plot.addItem(item, ignoreBounds=not bounds)
        self._drawn.append((plot, item))

    def _line(self, plot: BrushPlot, x: object, y: object, pen: object, **options: object) -> None:
        self._add(plot, pg.PlotCurveItem(np.asarray(x, float), np.asarray(y, float), pen=pen, **options))

    def _words(self, plot: BrushPlot, text: str, x: float, y: float, anchor: tuple[float, float]) -> None:
        item = pg.TextItem(text, color=QColor(self._theme.tokens.muted), anchor=anchor)
        item.setPos(x, y)
        item.setZValue(5)
        self._add(plot, item, bounds=False)

    def _points(
        self,
        place: int,
        population: Population,
        rows: np.ndarray,
        x: Float[np.ndarray, " bodies"],
        y: Float[np.ndarray, " bodies"],
    ) -> Points:
        linked = population.kind != "clones"
        symbol = SYMBOLS[place % len(SYMBOLS)]
        return Points(population.labels[rows], x, y, self._colour(population), symbol, linked)


class DistributionPlot(PopulationPlot):
    """Cumulative distribution above, density below."""

    def __init__(self, theme: Theme) -> None:
        self.cdf = BrushPlot(theme, tr("Cumulative distribution"))
        self.pdf = BrushPlot(theme, tr("Density"), across=True)
        super().__init__(theme, self.cdf, self.pdf)
        self.pdf.setXLink(self.cdf)
        for plot in (self.cdf, self.pdf):
            plot.getAxis("left").setWidth(54)  # so that the same value stands at the same place

    def _draw(self) -> str:
        name, by = self._shown.factor, self._shown.by
        scale, unit = readable_scale(self._populations, name)
        heading = factor_heading(name, unit)
        self.cdf.set_names("", tr("Share by number") if by == "number" else tr("Share by mass"))
        per = FACTORS[name].unit(unit)
        self.pdf.set_names(heading, tr("Density (1/{unit})", unit=per) if per else tr("Density"))
        rises, ticks = [], []
        edges = shared_edges(self._populations, name, by, scale)
        for place, population in enumerate(self._populations):
            rows = np.flatnonzero(np.isfinite(population.column(name)))
            values, weights = scale * population.values(name), population.weights(name, by)
            if not len(values):
                continue
            cdf = cumulative(values, weights)
            pen = self._pen(place, population)
            band = self._band("cdf", place)
            if band is not None:
                self._shade(self.cdf, place, scale * band.x, band.low, band.high)
            self._line(self.cdf, np.repeat(cdf.values, 2), np.repeat([0.0, *cdf.shares], 2)[1:-1], pen)
            rises.append(self._points(place, population, rows, values, cdf(values)))
            ticks.append(self._points(place, population, rows, values, np.zeros(len(values))))
            self._draw_density(place, population, values, weights, edges)
            band = self._band("density", place)
            if band is not None:
                self._shade(self.pdf, place, scale * band.x, band.low / scale, band.high / scale)
        self.cdf.set_points(rises)
        self.pdf.set_points(ticks)
        return ""

    def _draw_density(
        self,
        place: int,
        population: Population,
        values: np.ndarray,
        weights: np.ndarray,
        edges: np.ndarray,
    ) -> None:
        bars = histogram(values, weights, edges)
        fill = QColor(self._colour(population))
        fill.setAlpha(60)
        self._add(
            self.pdf,
            pg.BarGraphItem(
                x0=bars.x[:-1], x1=bars.x[1:], height=bars.density, brush=fill, pen=pg.mkPen(None)
            ),
        )
        if np.ptp(values) > 1e-9 * abs(values).max():
            smooth = kernel_density(values, weights)
            self._line(self.pdf, smooth.x, smooth.density, self._pen(place, population))


class PairPlot(PopulationPlot):
    """One factor against another."""

    def __init__(self, theme: Theme) -> None:
        self.plot = BrushPlot(theme, tr("Pairs of factors"))
        super().__init__(theme, self.plot)

    def _draw(self) -> str:
        names = self._shown.factor, self._shown.second
        scales = [readable_scale(self._populations, name) for name in names]
        self.plot.set_names(
            *(factor_heading(name, unit) for name, (_, unit) in zip(names, scales, strict=True))
        )
        groups, told = [], []
        for place, population in enumerate(self._populations):
            x, y = (scale * population.column(n) for n, (scale, _) in zip(names, scales, strict=True))
            rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
            groups.append(self._points(place, population, rows, x[rows], y[rows]))
            if len(rows) > 2 and np.ptp(x[rows]) and np.ptp(y[rows]):
                told.append(f"{name_of(population)} {np.corrcoef(x[rows], y[rows])[0, 1]:+.2f}")
        self.plot.set_points(groups)
        return tr("Correlation: {values}", values=", ".join(told)) if told else ""


class FormPlot(PopulationPlot):
    """Zingg's square or the triangle of Sneed and Folk, with their classes."""

    def __init__(self, theme: Theme, kind: str) -> None:
        self.plot = BrushPlot(
            theme, tr("Zingg diagram") if kind == "zingg" else tr("Sneed and Folk's diagram")
        )
        super().__init__(theme, self.plot)
        self._kind = kind
        if kind != "zingg":
            self.plot.box.setAspectLocked(True)
            for side in ("bottom", "left"):
                self.plot.hideAxis(side)

    def _draw(self) -> str:
        diagrams = [
            (zingg_diagram if self._kind == "zingg" else sneed_folk_diagram)(population)
            for population in self._populations
        ]
        groups = []
        for place, (population, diagram) in enumerate(zip(self._populations, diagrams, strict=True)):
            x, y = diagram.x, diagram.y
            if self._kind != "zingg":
                x, y = triangle(x, y).T
            rows = np.flatnonzero(np.isin(population.labels, diagram.labels))
            groups.append(self._points(place, population, rows, x, y))
        self.plot.set_points(groups)
        self._draw_zingg() if self._kind == "zingg" else self._draw_triangle()
        names = diagrams[0].names if diagrams else ()
        told = []
        for population, diagram in zip(self._populations, diagrams, strict=True):
            total = max(1, len(diagram.classes))
            shares = [
                f"{tr(SHORT.get(name, name))} {100 * diagram.counts[name] / total:.0f} %"
                for name in names
                if diagram.counts[name]
            ]
            told.append(f"{name_of(population)}: {', '.join(shares)}")
        return "\n".join(told)

    def _draw_zingg(self) -> None:
        self.plot.set_names(factor_label("flatness"), factor_label("elongation"))
        grey = pg.mkPen(self._theme.tokens.faint, style=Qt.PenStyle.DashLine)
        self._line(self.plot, [0, 1], [ZINGG_LIMIT] * 2, grey)
        self._line(self.plot, [ZINGG_LIMIT] * 2, [0, 1], grey)
        self._line(self.plot, [0, 1, 1, 0, 0], [0, 0, 1, 1, 0], pg.mkPen(self._theme.tokens.strong_border))
        left, right = ZINGG_LIMIT / 2, (1 + ZINGG_LIMIT) / 2
        # Those above stand outside the square: most bodies lie in its upper right.
        for name, x, y in (
            (tr("disc"), left, 1.0),
            (tr("equant"), right, 1.0),
            (tr("blade"), left, 0.0),
            (tr("rod"), right, 0.0),
        ):
            self._words(self.plot, name, x, y, (0.5, 1.0))
        self._line(self.plot, [0, 0], [0, 1.04], pg.mkPen(None))

    def _outline(self, points: Float[np.ndarray, "points 2"], pen: object) -> None:
        self._line(self.plot, points[:, 0], points[:, 1], pen)

    def _draw_triangle(self) -> None:
        grey = pg.mkPen(self._theme.tokens.faint)
        for height in SNEED_FOLK_HEIGHTS:
            self._outline(triangle(np.array([0.0, 1.0]), np.full(2, height)), grey)
        for side in SNEED_FOLK_SIDES:
            ends = np.array([0.0, SNEED_FOLK_HEIGHTS[-1]])
            self._outline(triangle(np.full(2, side), ends), grey)
        corners = triangle(np.array([0.0, 1.0, 0.5, 0.0]), np.array([0.0, 0.0, 1.0, 0.0]))
        self._outline(corners, pg.mkPen(self._theme.tokens.text, width=1.3))
        for name, (side, height) in CLASS_PLACES.items():
            x, y = triangle(np.array([side]), np.array([height]))[0]
            self._words(self.plot, tr(SHORT[name]), x, y, (0.5, 0.5))
        for height in (0.0, *SNEED_FOLK_HEIGHTS):
            x, y = triangle(np.array([0.0]), np.array([height]))[0]
            self._words(self.plot, f"{height:g}", x, y, (1.1, 0.5))
        for side, words in ((0.0, "0"), (1 / 3, "0.33"), (2 / 3, "0.67"), (1.0, "1")):
            self._words(self.plot, words, side, 0.0, (0.5, 0.0))
        x, y = corners[2]
        self._words(self.plot, tr("compact, c/a = 1"), x, y, (0.5, 1.0))
        for words, at in ((tr("platy"), 0.0), ("(a − b) / (a − c)", 0.5), (tr("elongate"), 1.0)):
            self._words(self.plot, words, at, -0.05, (at, 0.0))
        # Words do not count for the range: room for those outside the triangle.
        self._line(self.plot, [-0.04, 1.04], [-0.12, 0.93], pg.mkPen(None))


class SizePlot(PopulationPlot):
    """Percent finer by mass against size on a log axis."""

    def __init__(self, theme: Theme) -> None:
        self.plot = BrushPlot(theme, tr("Particle-size distribution"))
        super().__init__(theme, self.plot)
        self.plot.getAxis("bottom").setLogMode(True, False)

    def _draw(self) -> str:
        sieves = self._shown.sieves
        given = self._counts
        curves = [(p, size_distribution(p, sieves, counts=given.get(id(p)))) for p in self._populations]
        unit = readable_scale(self._populations, "intermediate")[1]
        words = (
            factor_label("intermediate")
            if sieves is None
            else tr("Sieve opening, {series}", series=SERIES_NAMES[sieves])
        )
        length = FACTORS["intermediate"].unit(unit)
        self.plot.set_names(f"{words} ({length})" if length else words, tr("Finer by mass (%)"))
        groups = []
        for place, (population, curve) in enumerate(curves):
            factor = conversion_factor(curve.unit, unit) if unit != curve.unit else 1.0
            sizes = np.log10(curve.sizes * factor)
            marks: dict[str, object] = {}
            if sieves is not None:
                marks = {"symbol": SYMBOLS[place % 3], "symbolSize": 6, "symbolPen": None}
                marks["symbolBrush"] = pg.mkBrush(self._colour(population))
            band = self._band("finer", place) if id(population) not in given else None
            if band is not None:
                self._shade(self.plot, place, np.log10(band.x * factor), band.low, band.high)
            line = pg.PlotDataItem(sizes, curve.finer, pen=self._pen(place, population), **marks)
            self._add(self.plot, line)
            own = population.column("intermediate")
            rows = np.flatnonzero(np.isfinite(own) & np.isfinite(population.column("volume")))
            x = np.log10(own[rows] * factor)
            groups.append(self._points(place, population, rows, x, np.interp(x, sizes, curve.finer)))
        self.plot.set_points(groups)
        return self._draw_tables(curves, unit)

    def _draw_tables(self, curves: Sequence[tuple[Population, SizeDistribution]], unit: str) -> str:
        """Draw curves of laboratories, and return how far they are from the first population's."""
        told = []
        for place, measured in enumerate(self._tables):
            x = np.log10(measured.curve.sizes * conversion_factor(measured.curve.unit, unit))
            pen = pg.mkPen(self._theme.tokens.text, width=1.5, style=STYLES[(place + 1) % len(STYLES)])
            self._add(
                self.plot,
                pg.PlotDataItem(
                    x, measured.curve.finer, pen=pen, symbol="d", symbolSize=8, symbolPen=None,
                    symbolBrush=pg.mkBrush(self._theme.tokens.text),
                ),
            )  # fmt: skip
            gap, at = largest_gap(measured.curve, curves[0][1])
            told.append(
                tr(
                    "{name}: {read} Largest difference of {population}: {gap:+.1f} % at {at:.3g} mm.",
                    name=measured.name, read=measured.read_as, population=name_of(curves[0][0]),
                    gap=gap, at=at,
                )
            )  # fmt: skip
        return "\n".join(told)


def pages(theme: Theme) -> dict[str, tuple[str, PopulationPlot]]:
    """Return the pages of the plots by name, each with its title."""
    makers: dict[str, tuple[str, Callable[[], PopulationPlot]]] = {
        "distribution": (tr("Distribution"), lambda: DistributionPlot(theme)),
        "pairs": (tr("Pairs"), lambda: PairPlot(theme)),
        "zingg": (tr("Zingg"), lambda: FormPlot(theme, "zingg")),
        "sneed_folk": (tr("Sneed–Folk"), lambda: FormPlot(theme, "sneed_folk")),
        "size": (tr("Size"), lambda: SizePlot(theme)),
    }
    return {name: (title, make()) for name, (title, make) in makers.items()}
