"""A plot whose points are bodies: click, drag a rectangle or draw a lasso to choose them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pyqtgraph as pg
from jaxtyping import Bool, Float, Int
from PySide6.QtCore import QPointF, Qt, Signal
from PySide6.QtGui import QColor, QKeyEvent, QPainterPath
from PySide6.QtWidgets import QGraphicsPathItem

from mbstudio.ui.language import tr
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.plots import Plot

Mode = Literal["rectangle", "lasso"]

REACH = 10.0  # pixels between the mouse and the point that a click means
_ADDING = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
SYMBOLS = ("o", "t1", "s")


@dataclass(frozen=True, eq=False)
class Points:
    """The bodies of one population in a plot.

    Attributes
    ----------
    labels : int array, shape (bodies,)
    x, y : float array, shape (bodies,)
        As the axes count: logarithms on a log axis.
    colour : str
    symbol : str
        pyqtgraph's name.
    linked : bool
        Whether the labels are those of grains of the project; only such points can be chosen.
    """

    labels: Int[np.ndarray, " bodies"]
    x: Float[np.ndarray, " bodies"]
    y: Float[np.ndarray, " bodies"]
    colour: str
    symbol: str = "o"
    linked: bool = True


class Dots(pg.ScatterPlotItem):
    """Points that leave the mouse to the plot, which also knows those beside the mouse."""

    def mouseClickEvent(self, ev: Any) -> None:
        ev.ignore()


class BrushBox(pg.ViewBox):
    """A view in which the left button draws an outline; the middle one moves, the wheel zooms.

    Attributes
    ----------
    outlined : signal (float array of shape (corners, 2), bool)
        An outline was drawn, in the axes' coordinates; whether to add to what is chosen.
    touched : signal (QPointF, bool)
        A click, in the axes' coordinates; whether to add.
    menu_asked : signal (QPointF, QPoint)
        A click of the right button, in the axes' coordinates and on the screen.
    """

    outlined = Signal(object, bool)
    touched = Signal(object, bool)
    menu_asked = Signal(object, object)

    def __init__(self, across: bool = False) -> None:
        super().__init__(enableMenu=False)
        self.mode: Mode = "rectangle"
        self._across = across
        self._corners: list[QPointF] = []
        self.outline = QGraphicsPathItem(self)
        self.outline.setZValue(1e6)
        self.outline.hide()

    def mouseDragEvent(self, ev: Any, axis: int | None = None) -> None:
        if ev.button() != Qt.MouseButton.LeftButton:
            super().mouseDragEvent(ev, axis)
            return
        ev.accept()
        start, now = ev.buttonDownPos(), ev.pos()
        if self.mode == "lasso" and not self._across:
            if ev.isStart():
                self._corners = [start]
            self._corners.append(now)
            corners = self._corners
        else:
            low, high = (0.0, self.height()) if self._across else (start.y(), now.y())
            corners = [QPointF(x, y) for x, y in (
                (start.x(), low), (now.x(), low), (now.x(), high), (start.x(), high)
            )]  # fmt: skip
        if not ev.isFinish():
            path = QPainterPath(corners[0])
            for corner in corners[1:]:
                path.lineTo(corner)
            path.closeSubpath()
            self.outline.setPath(path)
            self.outline.show()
            return
        self.outline.hide()
        places = [self.mapToView(corner) for corner in corners]
        self.outlined.emit(np.array([(p.x(), p.y()) for p in places]), bool(ev.modifiers() & _ADDING))

    def mouseClickEvent(self, ev: Any) -> None:
        if ev.button() == Qt.MouseButton.LeftButton:
            ev.accept()
            self.touched.emit(self.mapToView(ev.pos()), bool(ev.modifiers() & _ADDING))
        elif ev.button() == Qt.MouseButton.RightButton:
            ev.accept()
            self.menu_asked.emit(self.mapToView(ev.pos()), ev.screenPos().toPoint())


class BrushPlot(Plot):
    """A plot of bodies.

    Parameters
    ----------
    across : bool
        Whether only x counts: the points stand on the lower axis, and a drag takes a range.

    Attributes
    ----------
    brushed : signal (list of int, bool)
        Labels chosen in the plot, and whether to add them to those chosen already.
    menu_asked : signal (int or None, QPoint)
        Label of the point that was clicked with the right button, and the place on the screen.
    """

    brushed = Signal(object, bool)
    menu_asked = Signal(object, object)

    def __init__(self, theme: Theme, name: str, across: bool = False) -> None:
        self.box = BrushBox(across)
        super().__init__(theme, "", "", name, self.box)
        self._across = across
        self._groups: list[Points] = []
        self._chosen: frozenset[int] = frozenset()
        self._current: int | None = None
        self._scatters: list[Dots] = []
        self._marks = Dots()
        self._marks.setZValue(50)
        self.addItem(self._marks, ignoreBounds=True)
        for side in ("bottom", "left"):
            self.getAxis(side).enableAutoSIPrefix(False)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setToolTip(
            tr(
                "Click a point or drag around points to choose their grains; Ctrl or Shift adds to them. "
                "Keys ← and → go from grain to grain. The wheel zooms, the middle button moves, a double "
                "click shows everything."
            )
        )
        self.box.outlined.connect(self._take_outline)
        self.box.touched.connect(self._take_touch)
        self.box.menu_asked.connect(lambda place, screen: self.menu_asked.emit(self._nearest(place), screen))
        self.repaint_theme()

    # ---- what is shown -------------------------------------------------------------------------

    def set_points(self, groups: Sequence[Points]) -> None:
        """Show other bodies."""
        for scatter in self._scatters:
            self.removeItem(scatter)
        self._groups, self._scatters = list(groups), []
        for group in groups:
            colour = QColor(group.colour)
            colour.setAlpha(int(np.clip(2600 / np.sqrt(max(1, len(group.x))), 90, 210)))
            scatter = Dots(group.x, group.y, size=7, symbol=group.symbol, pen=None, brush=pg.mkBrush(colour))
            scatter.setZValue(20)
            self.addItem(scatter)
            self._scatters.append(scatter)
        self.mark(self._chosen, self._current)

    def mark(self, labels: Collection[int], current: int | None = None) -> None:
        """Bring out the points of these labels."""
        self._chosen, self._current = frozenset(labels), current
        pen = pg.mkPen(self._theme.tokens.text, width=2)
        spots = []
        for group in self._groups:
            if not group.linked:
                continue
            for row in np.flatnonzero(np.isin(group.labels, list(self._chosen))):
                size = 15 if group.labels[row] == current else 11
                spots.append({"pos": (group.x[row], group.y[row]), "symbol": group.symbol, "size": size,
                              "brush": pg.mkBrush(group.colour), "pen": pen})  # fmt: skip
        self._marks.setData(spots)
        for scatter in self._scatters:
            scatter.setOpacity(0.4 if spots else 1.0)

    @property
    def marked(self) -> list[tuple[float, float]]:
        """Places of the points that are brought out, in the axes' coordinates."""
        return [(float(spot.pos().x()), float(spot.pos().y())) for spot in self._marks.points()]

    def place_of(self, label: int, group: int = 0) -> QPointF:
        """Return where the point of a body stands in the widget, in pixels."""
        points = self._groups[group]
        (row,) = np.flatnonzero(points.labels == label)[:1]
        scene = self.box.mapViewToScene(QPointF(float(points.x[row]), float(points.y[row])))
        return QPointF(self.mapFromScene(scene))

    def repaint_theme(self) -> None:
        super().repaint_theme()
        tokens = self._theme.tokens
        fill = QColor(tokens.accent)
        fill.setAlpha(40)
        self.box.outline.setPen(pg.mkPen(tokens.accent, width=1.4))
        self.box.outline.setBrush(fill)
        if self._groups:
            self.mark(self._chosen, self._current)

    # ---- choosing ------------------------------------------------------------------------------

    def _linked_points(self) -> list[tuple[Points, tuple[int, float, float]]]:
        return [
            (group, (int(label), float(x), float(y)))
            for group in self._groups
            if group.linked
            for label, x, y in zip(group.labels, group.x, group.y, strict=True)
        ]

    def _take_outline(self, corners: Float[np.ndarray, "corners 2"], adding: bool) -> None:
        found: set[int] = set()
        for group in self._groups:
            if group.linked and len(group.x):
                y = np.full(len(group.x), corners[:, 1].mean()) if self._across else group.y
                inside = points_inside(np.column_stack([group.x, y]), corners)
                found.update(int(label) for label in group.labels[inside])
        if found or not adding:
            self.brushed.emit(sorted(found), adding)

    def _take_touch(self, place: QPointF, adding: bool) -> None:
        nearest = self._nearest(place)
        if nearest is not None or not adding:
            self.brushed.emit([] if nearest is None else [nearest], adding)

    def _nearest(self, place: QPointF) -> int | None:
        """Return the label of the point that a click means, or None."""
        wide, high = self.box.viewPixelSize()
        nearest, least = None, REACH
        for _, (label, x, y) in self._linked_points():
            dy = 0.0 if self._across else (y - place.y()) / high
            distance = float(np.hypot((x - place.x()) / wide, dy))
            if distance <= least:
                nearest, least = label, distance
        return nearest

    def keyPressEvent(self, ev: QKeyEvent) -> None:
        step = {Qt.Key.Key_Right: 1, Qt.Key.Key_Left: -1}.get(Qt.Key(ev.key()))
        group = next((group for group in self._groups if group.linked and len(group.x)), None)
        if step is None or group is None:
            super().keyPressEvent(ev)
            return
        order = [int(label) for label in group.labels[np.argsort(group.x, kind="stable")]]
        start = order.index(self._current) + step if self._current in order else (0 if step > 0 else -1)
        adding = bool(ev.modifiers() & Qt.KeyboardModifier.ShiftModifier)
        self.brushed.emit([order[start % len(order)]], adding)
        ev.accept()

    def mouseDoubleClickEvent(self, ev: Any) -> None:
        self.show_everything()
        ev.accept()

    def show_everything(self) -> None:
        """Undo zooming."""
        self.box.autoRange()


def points_inside(
    points: Float[np.ndarray, "points 2"], corners: Float[np.ndarray, "corners 2"]
) -> Bool[np.ndarray, " points"]:
    """Return which points lie inside a closed outline, by how often a ray to the right crosses it."""
    inside = np.zeros(len(points), dtype=bool)
    x, y = points.T
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 == y1:
            continue
        crosses = (y0 > y) != (y1 > y)
        inside ^= crosses & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside
