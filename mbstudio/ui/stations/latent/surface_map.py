"""The map of shaped grains: two factors of the parents and of the grain under the hand."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QVBoxLayout, QWidget

from mbstudio.core.cloning.surface_design import PLAIN_FACTORS
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.latent.factor_titles import TITLES, title_with_unit
from mbstudio.ui.stations.latent.map_plot import LatentMapPlot
from mbstudio.ui.stations.latent.surface_work import SurfaceWork
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.forms import label

_FIRST = ("flatness", "elongation")
"""Zingg's diagram, which everybody knows."""
_ZINGG = 2 / 3
_FORMS = (
    (mark("equant"), (1, 1)), (mark("oblate"), (0, 1)), (mark("prolate"), (1, 0)), (mark("bladed"), (0, 0)),
)  # fmt: skip


class SurfaceMap(QWidget):
    """A scatter of two factors; a place on it is asked of the grain.

    Attributes
    ----------
    across, up : QComboBox
        The factors of both axes.
    plot : LatentMapPlot
    """

    def __init__(self, work: SurfaceWork, theme: Theme) -> None:
        super().__init__()
        self._work, self._theme = work, theme
        self.across, self.up = QComboBox(), QComboBox()
        for field, first, name in zip(
            (self.across, self.up), _FIRST, (tr("Factor across"), tr("Factor up")), strict=True
        ):
            for factor in PLAIN_FACTORS:
                field.addItem(tr(TITLES[factor]), factor)
            field.setCurrentIndex(PLAIN_FACTORS.index(first))
            field.setAccessibleName(name)
            field.setToolTip(name)
        self.plot = LatentMapPlot(theme, tr("Map of two factors"), like_lengths=False)
        self._lines: list[pg.GraphicsObject] = []
        self._lay_out()
        for field in (self.across, self.up):
            field.activated.connect(lambda _: self._axis_chosen(self.sender()))
        self.plot.walked.connect(self._walk)
        work.style_taken.connect(self.refresh)
        work.grain_changed.connect(self._show_here)
        theme.changed.connect(self.refresh)
        self.refresh()

    def _lay_out(self) -> None:
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 8, 0, 10)
        layout.setSpacing(6)
        line = QHBoxLayout()
        line.setContentsMargins(14, 0, 14, 0)
        line.addWidget(self.up, 1)
        line.addWidget(label(tr("against"), "hint"))
        line.addWidget(self.across, 1)
        layout.addLayout(line)
        layout.addWidget(self.plot, 1)
        words = QHBoxLayout()
        words.setContentsMargins(14, 0, 14, 0)
        words.addWidget(
            label(
                tr(
                    "Small dots: parents. Rings: clones. Large dot: the current grain. Click to give it "
                    "these two factors, or drag to follow the pointer; locked factors stay."
                ),
                "hint",
                wrap=True,
            )
        )
        layout.addLayout(words)

    @property
    def factors(self) -> tuple[str, str]:
        """The factors across and up."""
        return self.across.currentData(), self.up.currentData()

    def show_factors(self, across: str, up: str) -> None:
        """Show two other factors."""
        for field, factor in ((self.across, across), (self.up, up)):
            with QSignalBlocker(field):
                field.setCurrentIndex(PLAIN_FACTORS.index(factor))
        self.refresh()

    def _axis_chosen(self, field: object) -> None:
        across, up = self.factors
        if across == up:
            # Both axes cannot have one factor: the other one takes what is not shown.
            other = self.up if field is self.across else self.across
            rest = next(factor for factor in PLAIN_FACTORS if factor != across)
            with QSignalBlocker(other):
                other.setCurrentIndex(PLAIN_FACTORS.index(rest))
        self.refresh()

    def _columns(self) -> list[int]:
        return [PLAIN_FACTORS.index(factor) for factor in self.factors]

    def refresh(self) -> None:
        """Show the parents, clones and the grain anew."""
        style, parents = self._work.style, self._work.parents
        self.plot.setEnabled(style is not None)
        if style is None:
            return
        across, up = (title_with_unit(factor, style.unit) for factor in self.factors)
        self.plot.set_places(parents[:, self._columns()], across, up)
        self._show_clones()
        self._show_zingg()
        self.plot.repaint_theme()
        self._show_here()

    def _show_clones(self) -> None:
        clones = self._work.workspace.state.surface_clones
        values = np.empty((0, len(PLAIN_FACTORS)))
        if clones is not None:
            columns = clones.factors
            forms = np.exp(np.stack([clone.recipe.form for clone in clones.clones]))
            long, middle, short = forms.T
            values = np.column_stack(
                [
                    [clone.recipe.diameter for clone in clones.clones],
                    middle / long,
                    short / middle,
                    short / np.sqrt(long * middle),
                    columns.column("sphericity"),
                    columns.factors.get("convexity", np.full(len(forms), np.nan)),
                ]
            )
        places = values[:, self._columns()]
        self.plot.set_clones(places[np.isfinite(places).all(axis=1)])

    def _show_zingg(self) -> None:
        for item in self._lines:
            self.plot.removeItem(item)
        self._lines = []
        if self.factors != _FIRST:
            return
        tokens = self._theme.tokens
        pen = pg.mkPen(tokens.strong_border, style=Qt.PenStyle.DashLine)
        for angle in (0, 90):
            self._lines.append(pg.InfiniteLine(_ZINGG, angle=angle, pen=pen))
        for words, (right, top) in _FORMS:
            text = pg.TextItem(tr(words), color=QColor(tokens.muted), anchor=(1 - right, 1 - top))
            text.setPos(_ZINGG + (0.005 if right else -0.005), _ZINGG + (0.005 if top else -0.005))
            text.setAnchor((0 if right else 1, 1 if top else 0))
            self._lines.append(text)
        for item in self._lines:
            item.setZValue(5)
            self.plot.addItem(item, ignoreBounds=True)

    def _show_here(self) -> None:
        grain = self._work.grain
        values = {} if grain is None else grain.values
        place = [values.get(factor, np.nan) for factor in self.factors]
        if np.isfinite(place).all():
            self.plot.set_here(np.array(place))

    def _walk(self, place: np.ndarray, final: bool) -> None:
        if self._work.style is None:
            return
        targets = {factor: float(value) for factor, value in zip(self.factors, place, strict=True)}
        targets = {factor: _possible(factor, value) for factor, value in targets.items()}
        words = ", ".join(f"{factor} {value:.3g}" for factor, value in targets.items())
        self._work.reach_many(targets, words, final=final)


def _possible(factor: str, value: float) -> float:
    """Return the nearest value that a body can have: the map goes on beyond its grains."""
    return max(value, 1e-6) if factor == "size" else float(np.clip(value, 0.13, 1.0))
