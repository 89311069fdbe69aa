"""What a tool has drawn into a slice since the button was pressed, and the brush under the mouse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPainterPath, QPen

_DARK = QColor(12, 14, 17, 190)
_LINE = 2.0  # pixels


@dataclass(frozen=True)
class Brush:
    """What a tool draws with.

    Attributes
    ----------
    colour : str
    radius : float or None
        Of a round brush, in the unit of the slice; None for a thin line.
    """

    colour: str
    radius: float | None = None


class PaneTrail:
    """The way of the mouse over one slice.

    Parameters
    ----------
    place_of : callable
        Where a voxel's centre (column, row) lies on the widget.
    scale : callable
        Pixels of the widget in one unit of the slice.

    Attributes
    ----------
    brush : Brush or None
        None where no tool draws.
    """

    def __init__(self, place_of: Callable[[float, float], QPointF], scale: Callable[[], float]) -> None:
        self._place_of, self._scale = place_of, scale
        self.brush: Brush | None = None
        self._places: list[tuple[float, float]] = []
        self._mouse: QPointF | None = None

    @property
    def follows_mouse(self) -> bool:
        """Whether the brush itself is seen under the mouse."""
        return self.brush is not None and self.brush.radius is not None

    def begin(self, column: float, row: float) -> None:
        """Begin a way at a voxel."""
        self._places = [(column, row)]

    def go_on(self, column: float, row: float) -> None:
        """Go on to another voxel."""
        if self.brush is not None and self._places:
            self._places.append((column, row))

    def end(self) -> None:
        """Forget the way."""
        self._places = []

    def hover(self, place: QPointF | None) -> None:
        """Let the brush be seen at a place of the widget, or nowhere."""
        self._mouse = place

    def paint(self, painter: QPainter, picture: QRectF) -> None:
        """Draw the way, and the brush."""
        brush = self.brush
        if brush is None:
            return
        painter.save()
        painter.setClipRect(picture)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        radius = 0.0 if brush.radius is None else brush.radius * self._scale()
        if self._places:
            self._paint_way(painter, brush, radius)
        if brush.radius is not None and self._mouse is not None:
            for colour, width in ((_DARK, 3.0), (QColor(brush.colour), 1.5)):
                painter.setPen(QPen(colour, width))
                painter.setBrush(Qt.BrushStyle.NoBrush)
                painter.drawEllipse(self._mouse, radius, radius)
        painter.restore()

    def _paint_way(self, painter: QPainter, brush: Brush, radius: float) -> None:
        points = [self._place_of(*place) for place in self._places]
        way = QPainterPath(points[0])
        for point in points[1:]:
            way.lineTo(point)
        pens: tuple[tuple[QColor, float], ...]
        if brush.radius is None:
            pens = ((_DARK, _LINE + 2), (QColor(brush.colour), _LINE))
        else:
            if len(points) == 1:
                way.lineTo(points[0] + QPointF(0.01, 0))  # a dot has a direction only with a length
            under = QColor(brush.colour)
            under.setAlpha(150)
            pens = ((under, max(1.0, 2 * radius)),)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for colour, width in pens:
            painter.setPen(
                QPen(colour, width, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin)
            )
            painter.drawPath(way)
