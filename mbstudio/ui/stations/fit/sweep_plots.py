"""Loss and errors against the number of control points, drawn as the fits of a sweep finish."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor

from mbstudio.core.imaging.sweep import SweepRow, error_names, quantiles_of
from mbstudio.ui.language import mark, tr
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.factor_words import factor_label
from mbstudio.ui.widgets.plots import Plot

LEAST_PERCENT = 1e-3  # below it the errors are those of the measuring
_TITLES = {"overlap_error": "1 − IoU", "hausdorff": "Hausdorff / Dₙ", "rms": mark("RMS distance / Dₙ")}


def title_of(name: str) -> str:
    """Return what an error of a sweep is called."""
    if name in _TITLES:
        return tr(_TITLES[name])
    return factor_label(name)


def line_colours(theme: Theme) -> tuple[str, ...]:
    """Return the colours of the lines that are brought out, which also differ in lightness."""
    tokens, scene = theme.tokens, theme.scene
    return tokens.accent, scene.grain, scene.points, tokens.success, tokens.danger, tokens.text


class SweepPlot(Plot):
    """Medians over the grains against n, both axes logarithmic, with the quartiles of what is brought out."""

    def __init__(self, theme: Theme, left: str, name: str, empty: str) -> None:
        super().__init__(theme, tr("Control points n"), left, name)
        self.setLogMode(x=True, y=True)
        for side in ("bottom", "left"):
            self.getAxis(side).enableAutoSIPrefix(False)
        self._empty = empty
        self._drawn: list[pg.GraphicsObject] = []
        self._words = pg.TextItem(anchor=(0.5, 0.5))
        self.addItem(self._words, ignoreBounds=True)
        self.getViewBox().sigRangeChanged.connect(self._place_words)
        self.getViewBox().sigResized.connect(self._place_words)
        self.repaint_theme()
        self.clear_lines()

    def repaint_theme(self) -> None:
        super().repaint_theme()
        if hasattr(self, "_words"):
            self._words.setColor(QColor(self._theme.tokens.muted))

    def clear_lines(self) -> None:
        """Take all lines away and say what comes here."""
        for item in self._drawn:
            self.removeItem(item)
        self._drawn.clear()
        self._words.setText(self._empty)
        self.setXRange(1, 2.2, padding=0)
        self.setYRange(-2, 1, padding=0)
        self._place_words()

    def draw_line(
        self, rows: Sequence[SweepRow], value: Callable[[SweepRow], float], colour: str, bold: bool
    ) -> None:
        """Draw one quantity."""
        found = quantiles_of(rows, value, (0.25, 0.5, 0.75))
        if not found:
            return
        self._words.setText("")
        numbers = np.array(list(found), dtype=float)
        low, middle, high = np.array(list(found.values())).T
        if bold and (high > low).any():
            ends = [pg.PlotDataItem(numbers, edge, pen=pg.mkPen(None)) for edge in (low, high)]
            fill = QColor(colour)
            fill.setAlpha(36)
            for end in ends:
                self._add(end)
            band = pg.FillBetweenItem(*ends, brush=fill)
            self.addItem(band, ignoreBounds=True)
            self._drawn.append(band)
        pen = pg.mkPen(colour, width=2 if bold else 1)
        marks = {"symbol": "o", "symbolSize": 6, "symbolBrush": colour, "symbolPen": None} if bold else {}
        line = pg.PlotDataItem(numbers, middle, pen=pen, **marks)
        line.setZValue(10 if bold else 1)
        self._add(line)

    def draw_limit(self, limit: float, colour: str) -> None:
        """Draw the error that is to be met."""
        line = pg.InfiniteLine(np.log10(limit), angle=0, pen=pg.mkPen(colour, style=Qt.PenStyle.DashLine))
        self.addItem(line, ignoreBounds=True)
        self._drawn.append(line)

    def mark_numbers(self, numbers: Sequence[int]) -> None:
        """Label the axis with the numbers themselves."""
        shown: list[int] = []
        for n in sorted(numbers, reverse=True):
            if not shown or np.log10(shown[-1] / n) > 0.08:
                shown.append(n)
        self.getAxis("bottom").setTicks([[(float(np.log10(n)), str(n)) for n in shown]])
        self.enableAutoRange()

    def _add(self, item: pg.GraphicsObject) -> None:
        self.addItem(item)
        self._drawn.append(item)

    def _place_words(self, *_: object) -> None:
        self._words.setPos(self.getViewBox().viewRect().center())


def draw_sweep(
    loss: SweepPlot,
    errors: SweepPlot,
    rows: Sequence[SweepRow],
    chosen: Sequence[str],
    limit: float,
    theme: Theme,
) -> None:
    """Draw a sweep into both plots.

    Parameters
    ----------
    chosen : sequence of str
        The errors that are brought out; the others are thin and grey.
    limit : float
        The error to be met, in percent.
    """
    for plot in (loss, errors):
        plot.clear_lines()
    drawn = [row for row in rows if np.isfinite(row.loss)]
    if not drawn:
        return
    numbers = sorted({row.n for row in drawn})
    loss.draw_line(drawn, lambda row: row.loss, theme.tokens.accent, True)
    for name in error_names(drawn):
        if name not in chosen:
            errors.draw_line(drawn, _percent(name), theme.tokens.strong_border, False)
    colours = line_colours(theme)
    for place, name in enumerate(chosen):
        errors.draw_line(drawn, _percent(name), colours[place % len(colours)], True)
    errors.draw_limit(limit, theme.tokens.warning)
    for plot in (loss, errors):
        plot.mark_numbers(numbers)


def _percent(name: str) -> Callable[[SweepRow], float]:
    def value(row: SweepRow) -> float:
        error = 100.0 * row.error_of(name)
        return max(error, LEAST_PERCENT) if np.isfinite(error) else error

    return value
