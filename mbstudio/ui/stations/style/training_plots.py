"""The curves of a training: items of the loss, error of the parents held out, weight of the annealer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pyqtgraph as pg
from jaxtyping import Float64
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QFrame, QHBoxLayout

from mbstudio.ui.language import mark, tr
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.plots import LogAxis, Plot

if TYPE_CHECKING:
    from mbstudio.core.vae.models.training_step import TrainingStep

EMPTY = mark("Curves are drawn here\nwhile a style is learned")
AT_ONCE = mark("Principal components are found\nat once, without training")


def signed_log(values: Float64[np.ndarray, " m"]) -> Float64[np.ndarray, " m"]:
    """Return sign(v) log10(1 + |v|): a log scale for what may fall below zero, as log likelihoods do."""
    return np.sign(values) * np.log10(1.0 + np.abs(values))


class SignedLogAxis(LogAxis):
    """A log axis that, while `signed`, names what :func:`signed_log` has drawn."""

    signed = False

    def logTickValues(self, minVal: float, maxVal: float, size: float, stdTicks: Any) -> list[Any]:
        if not self.signed:
            return super().logTickValues(minVal, maxVal, size, stdTicks)
        highest = int(np.ceil(max(abs(minVal), abs(maxVal))))
        powers = np.arange(1, highest + 1)
        ticks = signed_log(np.concatenate([-(10.0 ** powers[::-1]), [0.0], 10.0**powers]))
        shown = ticks[(ticks >= minVal) & (ticks <= maxVal)]
        while len(shown) > 2 and np.diff(shown).min() * size / max(maxVal - minVal, 1e-12) < 18:
            shown = shown[::2]
        return [(1.0, shown.tolist())]

    def logTickStrings(self, values: list[float], scale: float, spacing: float) -> list[str]:
        if not self.signed:
            return super().logTickStrings(values, scale, spacing)
        return [f"{np.sign(v) * (10 ** abs(v) - 1):.4g}" for v in values]


class TrainingCurve(Plot):
    """Curves against the steps of a training.

    Parameters
    ----------
    theme : Theme
    left, name : str
    titles : tuple of str
        One a curve, for the legend where there are several.
    log : bool
        Whether upwards is logarithmic; where values are not all positive, on both sides of zero.
    empty : str
        What is said while there is nothing to draw.
    """

    def __init__(
        self, theme: Theme, left: str, name: str, titles: tuple[str, ...], *, log: bool, empty: str = ""
    ) -> None:
        super().__init__(theme, tr("Step"), left, name)
        self._log, self._titles = log, titles
        self._signed = SignedLogAxis(orientation="left")
        if log:
            self.setAxisItems({"left": self._signed})
        for side in ("bottom", "left"):
            self.getAxis(side).enableAutoSIPrefix(False)
        self.setMouseEnabled(x=False, y=False)
        self.empty = empty
        self._steps = np.zeros(0)
        self._values = np.zeros((len(titles), 0))
        self._lines = [self.plot([], []) for _ in titles]
        self._best = pg.ScatterPlotItem(size=9)
        self.addItem(self._best)
        self._words = pg.TextItem(anchor=(0.5, 0.5))
        self.addItem(self._words, ignoreBounds=True)
        self.getViewBox().sigResized.connect(self._place_words)
        self.getViewBox().sigRangeChanged.connect(self._place_words)
        self.repaint_theme()
        self.show_values(np.zeros(0), np.zeros((len(titles), 0)))

    def repaint_theme(self) -> None:
        super().repaint_theme()
        if not hasattr(self, "_words"):
            return
        tokens, scene = self._theme.tokens, self._theme.scene
        colours = (tokens.accent, scene.grain)
        for line, colour in zip(self._lines, colours, strict=False):
            line.setPen(pg.mkPen(colour, width=2))
            line.setSymbolPen(None)
            line.setSymbolBrush(pg.mkBrush(colour))
        words = [
            f'<span style="color:{colour}">●</span> <span style="color:{tokens.muted}">{title}</span>'
            for colour, title in zip(colours, self._titles, strict=False)
        ]
        self.setTitle(" &nbsp; ".join(words), size="11px")
        self._best.setPen(pg.mkPen(tokens.surface, width=1.5))
        self._best.setBrush(pg.mkBrush(tokens.success))
        self._words.setColor(QColor(tokens.muted))

    @property
    def counts(self) -> tuple[int, ...]:
        """How many points each curve has."""
        return tuple(int(np.isfinite(row).sum()) for row in self._values)

    def show_values(
        self,
        steps: Float64[np.ndarray, " m"],
        values: Float64[np.ndarray, "curves m"],
        best: int | None = None,
    ) -> None:
        """Draw curves; a dot marks record `best` of the first."""
        self._steps, self._values = steps, values
        known = values[np.isfinite(values)]
        self._signed.signed = bool(self._log and len(known) and known.min() <= 0)
        heights = [self._height(row) for row in values]
        for line, row in zip(self._lines, heights, strict=True):
            there = np.isfinite(row)
            # Few records make no line: the points are shown as well.
            few = int(there.sum()) < 3
            line.setData(steps[there], row[there], symbol="o" if few else None, symbolSize=5)
        self._best.setData([], [])
        if best is not None and np.isfinite(heights[0][best]):
            self._best.setData([steps[best]], [heights[0][best]])
        self._words.setText("" if len(known) else self.empty)
        self._fit(np.concatenate(heights) if len(heights) else np.zeros(0))
        self._place_words()

    def _height(self, values: Float64[np.ndarray, " m"]) -> Float64[np.ndarray, " m"]:
        if not self._log:
            return values
        return signed_log(values) if self._signed.signed else np.log10(values)

    def _fit(self, heights: Float64[np.ndarray, " m"]) -> None:
        self._signed.setLogMode(x=False, y=True) if self._log else None
        there = heights[np.isfinite(heights)]
        low, high = (float(there.min()), float(there.max())) if len(there) else (0.0, 1.0)
        room = max(0.08 * (high - low), 0.04)
        if not self._log:
            low, high, room = 0.0, max(1.0, high), 0.07
        self.setYRange(low - room, high + room, padding=0)
        self.setXRange(0, max(1.0, float(self._steps[-1]) if len(self._steps) else 1.0) * 1.03, padding=0.01)

    def _place_words(self, *_: object) -> None:
        self._words.setPos(self.getViewBox().viewRect().center())


class TrainingPlots(QFrame):
    """The three plots side by side, growing while a training runs."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.setAccessibleName(tr("Curves of the training"))
        self._records: list[TrainingStep] = []
        self.items = TrainingCurve(
            theme, "", tr("Items of the loss"), (tr("Reconstruction"), tr("Distribution")), log=True
        )
        self.error = TrainingCurve(
            theme, tr("% of Dₙ"), tr("Error of the parents held out"), (tr("Held-out error"),), log=True,
            empty=tr(EMPTY),
        )  # fmt: skip
        self.weight = TrainingCurve(
            theme, "", tr("Weight of the distribution item"), (tr("Annealer weight"),), log=False
        )
        self.items.setToolTip(
            tr(
                "The minimised loss, averaged over the steps of a record: how well parents are reproduced "
                "(in preset aligned a negative log-likelihood, which may fall below zero), and how far the "
                "latent vectors are from a normal distribution"
            )
        )
        self.error.setToolTip(
            tr(
                "Root mean square distance between the held-out parents and their reconstructions; the dot "
                "marks the best state, which is kept"
            )
        )
        self.weight.setToolTip(tr("The annealer raises the weight of the distribution item from 0 to 1"))
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        for plot, share in ((self.items, 4), (self.error, 4), (self.weight, 3)):
            plot.setMinimumWidth(150)
            layout.addWidget(plot, share)

    @property
    def records(self) -> list[TrainingStep]:
        """What is drawn."""
        return list(self._records)

    def set_records(self, records: Sequence[TrainingStep]) -> None:
        """Draw a whole history."""
        self._records = list(records)
        self._draw()

    def add_records(self, records: Sequence[TrainingStep]) -> None:
        """Draw the newest records as well."""
        self._records += records
        self._draw()

    def _draw(self) -> None:
        # What is found at once has one record and no curve; its errors stand on the card.
        at_once = len(self._records) == 1 and not self._records[0].steps
        records = [] if at_once else self._records
        self.error.empty = tr(AT_ONCE if at_once else EMPTY)
        steps = np.array([record.step for record in records], dtype=float)
        table = np.array(
            [(r.reconstruction, r.distribution, 100 * r.held_out, r.weight) for r in records], dtype=float
        ).reshape(-1, 4).T  # fmt: skip
        best = max((row for row, record in enumerate(records) if record.best), default=None)
        self.items.show_values(steps, table[:2])
        self.error.show_values(steps, table[2:3], best)
        self.weight.show_values(steps, table[3:])
