"""The grey values of a scan as a histogram, with the threshold as a line to drag."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Signal

from mbstudio.ui.language import tr
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.plots import Plot


class GreyHistogram(Plot):
    """Counts of grey values, on a log scale, and a line that stands at the threshold.

    Attributes
    ----------
    dragged : signal (float)
        The line is held at this grey value.
    """

    dragged = Signal(float)

    def __init__(self, theme: Theme, height: int = 84) -> None:
        super().__init__(theme, "", "", tr("Histogram of grey values"))
        self.setFixedHeight(height)
        self.hideAxis("left")
        self.setMouseEnabled(x=False, y=False)
        self.getAxis("bottom").enableAutoSIPrefix(False)
        self._bars = pg.BarGraphItem(x=[], height=[], width=1)
        self.addItem(self._bars)
        self.line = pg.InfiniteLine(angle=90, movable=True)
        self.line.sigDragged.connect(lambda line: self.dragged.emit(float(line.value())))
        self.addItem(self.line)
        self.setToolTip(tr("Drag the line to set the grey value from which a voxel is grain"))
        self.repaint_theme()

    def repaint_theme(self) -> None:
        super().repaint_theme()
        self.showGrid(x=False, y=False)
        tokens = self._theme.tokens
        self._bars.setOpts(brush=pg.mkBrush(tokens.muted), pen=pg.mkPen(None))
        self.line.setPen(pg.mkPen(tokens.accent, width=2))
        self.line.setHoverPen(pg.mkPen(tokens.accent, width=4))

    def set_counts(self, counts: np.ndarray, edges: np.ndarray) -> None:
        """Show a histogram: counts of bins, and the edges of these."""
        heights = np.log1p(counts)
        self._bars.setOpts(x=(edges[:-1] + edges[1:]) / 2, height=heights, width=np.diff(edges)[0])
        self.setXRange(edges[0], edges[-1], padding=0.02)
        self.setYRange(0, max(float(heights.max(initial=0.0)), 1e-9) * 1.05, padding=0)
        self.line.setBounds((float(edges[0]), float(edges[-1])))

    def set_threshold(self, value: float) -> None:
        """Let the line stand at a grey value."""
        if value != self.line.value():
            self.line.setPos(value)
