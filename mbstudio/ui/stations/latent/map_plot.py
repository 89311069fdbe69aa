"""The map of the latent space: a click shows the grain there, a drag walks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyqtgraph as pg
from jaxtyping import Float
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor, QFocusEvent, QKeyEvent

from mbstudio.ui.language import tr
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.plots import Plot

STEP = 0.1  # of the parents' spread, for one press of an arrow key
_ARROWS: dict[int, tuple[float, float]] = {
    Qt.Key.Key_Left: (-1.0, 0.0),
    Qt.Key.Key_Right: (1.0, 0.0),
    Qt.Key.Key_Up: (0.0, 1.0),
    Qt.Key.Key_Down: (0.0, -1.0),
}


class WalkBox(pg.ViewBox):
    """A view in which the left button walks; the middle one moves, the wheel zooms.

    Attributes
    ----------
    walked : signal (QPointF, bool)
        Where the mouse is, and whether it was let go there.
    """

    walked = Signal(object, bool)

    def __init__(self) -> None:
        super().__init__(enableMenu=False)

    def mouseDragEvent(self, ev: Any, axis: int | None = None) -> None:
        if ev.button() != Qt.MouseButton.LeftButton:
            super().mouseDragEvent(ev, axis)
            return
        ev.accept()
        self.walked.emit(self.mapToView(ev.pos()), bool(ev.isFinish()))

    def mouseClickEvent(self, ev: Any) -> None:
        if ev.button() == Qt.MouseButton.LeftButton:
            ev.accept()
            self.walked.emit(self.mapToView(ev.pos()), True)


class LatentMapPlot(Plot):
    """Parents, clones, kept grains, A, B, C and the grain under the hand on the map.

    Parameters
    ----------
    theme : Theme
    title : str, optional
    like_lengths : bool
        Whether a step is as long on the screen in both directions.

    Attributes
    ----------
    walked : signal (float array of shape (2,), bool)
        A place, and whether the walk ended there.
    """

    walked = Signal(object, bool)

    def __init__(self, theme: Theme, title: str = "", *, like_lengths: bool = True) -> None:
        self.box = WalkBox()
        super().__init__(theme, "", "", title or tr("Map of the latent space"), self.box)
        self._parents, self._kept = pg.ScatterPlotItem(), pg.ScatterPlotItem()
        self._here, self._clones = pg.ScatterPlotItem(), pg.ScatterPlotItem()
        self._cloned: np.ndarray = np.empty((0, 2))
        self._letters: list[pg.TextItem] = []
        self._walked: np.ndarray | None = None
        for z, item in ((10, self._parents), (15, self._clones), (20, self._kept), (30, self._here)):
            item.setZValue(z)
            item.setAcceptedMouseButtons(Qt.MouseButton.NoButton)
            self.addItem(item)
        self._places: tuple[np.ndarray, np.ndarray, np.ndarray] = (np.empty((0, 2)),) * 3
        self.setToolTip(
            tr(
                "Click to see the grain there, drag to walk; arrow keys walk by a tenth of the parents' "
                "spread. The wheel zooms, the middle button moves the map."
            )
        )
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setAspectLocked(like_lengths)
        for side in ("bottom", "left"):
            self.getAxis(side).enableAutoSIPrefix(False)
        self.box.walked.connect(
            lambda place, final: self.walked.emit(np.array([place.x(), place.y()]), final)
        )
        self.repaint_theme()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        way = _ARROWS.get(event.key())
        here, parents = self.here if self._walked is None else self._walked, self._places[0]
        if way is None or here is None or not len(parents):
            super().keyPressEvent(event)
            return
        event.accept()
        # A key held down walks on, from where it has led and not from what is drawn by now.
        self._walked = here + STEP * parents.std(axis=0) * np.array(way)
        self.walked.emit(self._walked, False)

    def keyReleaseEvent(self, event: QKeyEvent) -> None:
        if event.key() in _ARROWS and self._walked is not None:
            event.accept()
            if not event.isAutoRepeat():
                self._end_walk()
        else:
            super().keyReleaseEvent(event)

    def _end_walk(self) -> None:
        place, self._walked = self._walked, None
        if place is not None:
            self.walked.emit(place, True)

    def focusInEvent(self, event: QFocusEvent) -> None:
        super().focusInEvent(event)
        self._show_focus()

    def focusOutEvent(self, event: QFocusEvent) -> None:
        super().focusOutEvent(event)
        self._end_walk()
        self._show_focus()

    def _show_focus(self) -> None:
        self.box.setBorder(pg.mkPen(self._theme.tokens.accent, width=2) if self.hasFocus() else None)

    def set_parents(self, places: Float[np.ndarray, "parents 2"], share: tuple[float, float]) -> None:
        """Show the parents, and how much of their variance the map holds."""
        self.set_places(
            places,
            tr("First direction ({share:.0%} of the variance)", share=share[0]),
            tr("Second direction ({share:.0%})", share=share[1]),
        )

    def set_places(self, places: Float[np.ndarray, "parents 2"], across: str, up: str) -> None:
        """Show the parents, and what the axes are called."""
        self._places = places, np.empty((0, 2)), np.empty((0, 2))
        self.set_names(across, up)
        self.box.autoRange()

    def set_clones(self, places: Float[np.ndarray, "clones 2"]) -> None:
        """Show the clones."""
        self._cloned = places
        self.repaint_theme()

    def set_kept(self, places: Float[np.ndarray, "kept 2"]) -> None:
        """Show the kept grains."""
        self._places = self._places[0], places, self._places[2]
        self.repaint_theme()

    def set_here(self, place: Float[np.ndarray, "2"] | None) -> None:
        """Mark the grain under the hand."""
        there = np.empty((0, 2)) if place is None else np.asarray(place).reshape(1, 2)
        self._places = self._places[0], self._places[1], there
        self._here.setData(*there.T)
        (left, right), (low, high) = self.box.viewRange()
        if len(there) and not (left <= there[0, 0] <= right and low <= there[0, 1] <= high):
            self.box.autoRange()

    def set_letters(self, places: dict[str, Float[np.ndarray, "2"]]) -> None:
        """Mark A, B and C."""
        for item in self._letters:
            self.removeItem(item)
        self._letters = []
        for letter, place in places.items():
            text = pg.TextItem(letter, color=self._theme.tokens.text, anchor=(0.5, 0.5))
            text.setPos(*place)
            text.setZValue(25)
            self.addItem(text, ignoreBounds=True)
            self._letters.append(text)

    @property
    def here(self) -> Float[np.ndarray, "2"] | None:
        """Where the grain under the hand is marked."""
        return self._places[2][0] if len(self._places[2]) else None

    def repaint_theme(self) -> None:
        super().repaint_theme()
        tokens, scene = self._theme.tokens, self._theme.scene
        faint = QColor(tokens.muted)
        faint.setAlpha(120)
        parents, kept, here = self._places
        ring = pg.mkPen(tokens.accent, width=1.4)
        self._clones.setData(*self._cloned.T, size=7, pen=ring, brush=None)
        self._parents.setData(*parents.T, size=6, pen=None, brush=pg.mkBrush(faint))
        self._kept.setData(
            *kept.T, size=9, symbol="s", pen=pg.mkPen(tokens.surface), brush=pg.mkBrush(scene.grain)
        )
        self._here.setData(
            *here.T, size=14, pen=pg.mkPen(tokens.surface, width=2), brush=pg.mkBrush(tokens.accent)
        )
        self._show_focus()
        for item in self._letters:
            item.setColor(QColor(tokens.text))
