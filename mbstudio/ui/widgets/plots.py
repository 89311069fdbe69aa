"""Plots in the theme's colours: the convergence curve and histograms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor, QFont

from mbstudio.ui.language import tr
from mbstudio.ui.theme import Theme

pg.setConfigOptions(antialias=True)

_TICKS = QFont()
_TICKS.setPixelSize(11)


class LogAxis(pg.AxisItem):
    """An axis that, on a log scale, names as many multiples of the powers of ten as there is room for."""

    def logTickValues(self, minVal: float, maxVal: float, size: float, stdTicks: Any) -> list[Any]:
        low, high = int(np.floor(minVal)), int(np.ceil(maxVal))
        room = 20 if self.orientation == "left" else 36  # pixels that a number takes
        for steps in ((1, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 9), (1, 1.5, 2, 3, 5, 7), (1, 2, 5), (1, 3), (1,)):
            ticks = [exponent + np.log10(step) for exponent in range(low, high + 1) for step in steps]
            shown = [tick for tick in ticks if minVal <= tick <= maxVal]
            gaps = np.diff(shown) * size / max(maxVal - minVal, 1e-12)
            if not len(gaps) or gaps.min() >= room:
                break
        return [(1.0, shown)]

    def logTickStrings(self, values: list[float], scale: float, spacing: float) -> list[str]:
        return [
            f"{10**value:.0e}".replace("e-0", "e-") if value < -4 else f"{10**value:.4g}" for value in values
        ]


class Plot(pg.PlotWidget):
    """A plot without frame whose axes and grid follow the theme."""

    def __init__(
        self, theme: Theme, bottom: str, left: str, name: str, box: pg.ViewBox | None = None
    ) -> None:
        axes = {"left": LogAxis(orientation="left"), "bottom": LogAxis(orientation="bottom")}
        super().__init__(viewBox=box, axisItems=axes)
        self._theme = theme
        self._names = (bottom, left)
        self.setAccessibleName(name)
        self.setMenuEnabled(False)
        self.hideButtons()
        self.getPlotItem().layout.setContentsMargins(4, 8, 14, 4)
        theme.changed.connect(self.repaint_theme)

    def set_names(self, bottom: str, left: str) -> None:
        """Call the axes otherwise."""
        self._names = (bottom, left)
        self.repaint_theme()

    def repaint_theme(self) -> None:
        """Take the colours of the theme that holds now."""
        tokens = self._theme.tokens
        self.setBackground(tokens.surface)
        for side, text in zip(("bottom", "left"), self._names, strict=True):
            axis = self.getAxis(side)
            axis.setPen(pg.mkPen(tokens.strong_border))
            axis.setTextPen(pg.mkPen(tokens.muted))
            if text:
                axis.setLabel(text, color=tokens.muted, **{"font-size": "12px"})
            axis.setTickFont(_TICKS)
            axis.setStyle(tickLength=-4)
        self.showGrid(x=True, y=True, alpha=0.16 if self._theme.is_dark else 0.13)


class _ChangeLine(pg.InfiniteLine):
    """An upright line where another number of control points began."""

    def __init__(self, generation: int, n: int) -> None:
        super().__init__(
            generation - 0.5,
            angle=90,
            movable=False,
            label=tr("n = {n}", n=n),
            labelOpts={"position": 0.92, "anchors": [(0, 0.5), (0, 0.5)]},
        )
        self.n = n

    def repaint(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self.setPen(pg.mkPen(theme.tokens.muted, style=Qt.PenStyle.DashLine))
        self.label.setColor(QColor(theme.tokens.muted))


class ConvergenceCurve(Plot):
    """Loss on a log axis against generations, growing while a fit runs."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme, tr("Generation"), tr("Mean loss"), tr("Convergence curve"))
        self.setLogMode(x=False, y=True)
        # Generations are whole numbers: "0.5k" would be wrong here, and so would a prefix for losses.
        for side in ("bottom", "left"):
            self.getAxis(side).enableAutoSIPrefix(False)
        self._losses: list[float] = []
        self._line = self.plot([], [])
        self._head = pg.ScatterPlotItem(size=8)
        self.addItem(self._head)
        self._changes: list[_ChangeLine] = []
        self._words = pg.TextItem(anchor=(0.5, 0.5))
        document = self._words.textItem.document()
        option = document.defaultTextOption()
        option.setAlignment(Qt.AlignmentFlag.AlignHCenter)
        document.setDefaultTextOption(option)
        self.addItem(self._words, ignoreBounds=True)
        self.getViewBox().sigResized.connect(self._place_words)
        self.getViewBox().sigRangeChanged.connect(self._place_words)
        self.repaint_theme()
        self._draw()

    @property
    def losses(self) -> list[float]:
        """The losses shown, one a generation."""
        return list(self._losses)

    def repaint_theme(self) -> None:
        super().repaint_theme()
        tokens = self._theme.tokens
        self._line.setPen(pg.mkPen(tokens.accent, width=2))
        self._head.setPen(pg.mkPen(tokens.surface, width=1.5))
        self._head.setBrush(pg.mkBrush(tokens.accent))
        self._words.setColor(QColor(tokens.muted))
        for line in self._changes:
            line.repaint(self._theme)

    def set_losses(self, losses: Sequence[float]) -> None:
        """Show a whole history."""
        self._losses = [float(loss) for loss in losses]
        self._draw()

    def mark_changes(self, changes: Sequence[tuple[int, int]]) -> None:
        """Mark before which generations the number of control points became another, and which."""
        known = [(round(line.value() + 0.5), line.n) for line in self._changes]
        if known == list(changes):
            return
        for line in self._changes:
            self.removeItem(line)
        self._changes = [_ChangeLine(generation, n) for generation, n in changes]
        for line in self._changes:
            line.repaint(self._theme)
            self.addItem(line, ignoreBounds=True)

    @property
    def marked_changes(self) -> list[tuple[float, str]]:
        """Where lines stand, and what they say."""
        return [(float(line.value()), line.label.format) for line in self._changes]

    def add_losses(self, losses: Sequence[float]) -> None:
        """Add the newest generations."""
        self._losses.extend(float(loss) for loss in losses)
        self._draw()

    def _draw(self) -> None:
        values = np.asarray(self._losses)
        generations = np.arange(len(values))
        good = np.isfinite(values) & (values > 0)
        self._line.setData(generations[good], values[good])
        if good.any():
            last = np.flatnonzero(good)[-1]
            self._head.setData([generations[last]], [np.log10(values[last])])
        else:
            self._head.setData([], [])
        self._words.setText(
            "" if good.any() else tr("The loss of each generation is drawn here while a grain is fitted")
        )
        self.getViewBox().setMouseEnabled(x=bool(good.any()), y=bool(good.any()))
        if good.any():
            logs = np.log10(values[good])
            room = max(0.08 * (logs.max() - logs.min()), 0.05)
            self.setYRange(logs.min() - room, logs.max() + room, padding=0)
            self.setXRange(0, max(5, len(values) - 1) * 1.02, padding=0.01)
        else:
            self.setYRange(-3, 0, padding=0)
            self.setXRange(0, 60, padding=0)
        self._place_words()

    def _place_words(self, *_: object) -> None:
        # In a narrow plot the words take several lines.
        self._words.setTextWidth(max(40.0, self.getViewBox().width() - 12.0))
        self._words.setPos(self.getViewBox().viewRect().center())


class Histogram(Plot):
    """Bars of counts; with `pick`, a line that can be dragged to choose a value."""

    picked = Signal(float)

    def __init__(self, theme: Theme, name: str, height: int = 104) -> None:
        super().__init__(theme, "", "", name)
        self.setFixedHeight(height)
        self.hideAxis("left")
        self.setMouseEnabled(x=False, y=False)
        self.getAxis("bottom").enableAutoSIPrefix(False)
        self._bars = pg.BarGraphItem(x=[], height=[], width=1)
        self.addItem(self._bars)
        self._marker = pg.InfiniteLine(angle=90, movable=False)
        self._marker.hide()
        self.addItem(self._marker)
        self.repaint_theme()

    def repaint_theme(self) -> None:
        super().repaint_theme()
        self.showGrid(x=False, y=False)
        tokens = self._theme.tokens
        self._bars.setOpts(brush=pg.mkBrush(tokens.accent), pen=pg.mkPen(None))
        self._marker.setPen(pg.mkPen(tokens.warning, width=2))

    def set_values(self, values: np.ndarray, bins: int = 48, log: bool = False) -> None:
        """Count values; a log count keeps small peaks visible beside a great one."""
        values = np.asarray(values, dtype=float)
        values = values[np.isfinite(values)]
        if not values.size:
            self._bars.setOpts(x=[], height=[], width=1)
            return
        counts, edges = np.histogram(values, bins=bins)
        heights = np.log1p(counts) if log else counts
        self._bars.setOpts(x=(edges[:-1] + edges[1:]) / 2, height=heights, width=np.diff(edges)[0])
        self.setXRange(edges[0], edges[-1], padding=0.02)
        self.setYRange(0, max(float(heights.max()), 1e-9) * 1.05, padding=0)

    def mark(self, value: float | None) -> None:
        """Draw a line at a value, or take it away."""
        self._marker.setVisible(value is not None)
        if value is not None:
            self._marker.setPos(value)
