"""The part of a slice that is chosen: a frame whose edges and corners can be dragged."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPen

Ends = tuple[tuple[int, int], tuple[int, int]]
"""Columns and rows of voxels, each from and up to (not with) a number."""

REACH = 7.0  # pixels between mouse and an edge
HANDLE = 7.0  # pixels along the side of a handle
VEIL = 150  # opacity, of 255, of what hides the rest
_CURSORS = {
    (1, 0): Qt.CursorShape.SizeHorCursor,
    (0, 1): Qt.CursorShape.SizeVerCursor,
    (1, 1): Qt.CursorShape.SizeBDiagCursor,
    (1, -1): Qt.CursorShape.SizeFDiagCursor,
}


class PaneBox:
    """A box over a slice.

    Parameters
    ----------
    place_of : callable
        Where a voxel's centre (column, row) lies on the widget.

    Attributes
    ----------
    ends : Ends or None
        None where there is no box.
    cuts_slice : bool
        Whether the slice lies within the box along the axis that it cuts; else all of it is hidden.
    colour : str
    """

    def __init__(self, place_of: Callable[[float, float], QPointF]) -> None:
        self._place_of = place_of
        self.ends: Ends | None = None
        self.cuts_slice = True
        self.colour = "#d99b45"
        self._held: tuple[int, int] | None = None

    @property
    def is_held(self) -> bool:
        return self._held is not None

    def rect(self) -> QRectF:
        """Return where the box lies on the widget."""
        assert self.ends is not None
        (left, right), (low, high) = self.ends
        start, stop = self._place_of(left - 0.5, low - 0.5), self._place_of(right - 0.5, high - 0.5)
        return QRectF(start, stop).normalized()

    # ---- dragging --------------------------------------------------------------------------------

    def grip_at(self, place: QPointF) -> tuple[int, int] | None:
        """Return which edges lie under a place: -1 or 1 for the near or far one along columns and rows."""
        if self.ends is None:
            return None
        rect = self.rect()
        if not rect.adjusted(-REACH, -REACH, REACH, REACH).contains(place):
            return None
        across = _nearest(place.x(), rect.left(), rect.right())
        upwards = -_nearest(place.y(), rect.top(), rect.bottom())
        return None if (across, upwards) == (0, 0) else (across, upwards)

    def cursor_at(self, place: QPointF) -> Qt.CursorShape | None:
        """Return how the mouse looks over an edge or corner, None elsewhere."""
        grip = self.grip_at(place)
        if grip is None:
            return None
        across, upwards = grip
        return _CURSORS[(abs(across), across * upwards if across and upwards else abs(upwards))]

    def grab(self, place: QPointF) -> bool:
        """Take hold of the edges under a place; return whether there are some."""
        self._held = self.grip_at(place)
        return self.is_held

    def dragged_to(self, column: float, row: float, counts: tuple[int, int]) -> Ends | None:
        """Return the box with the held edges at a place between voxels; None if none are held.

        Parameters
        ----------
        column, row : float
            Voxels; the centre of the first is 0.
        counts : tuple of int
            Columns and rows of the slice.
        """
        if self._held is None or self.ends is None:
            return None
        columns, rows = (
            _moved(ends, side, round(place + 0.5), count)
            for ends, side, place, count in zip(self.ends, self._held, (column, row), counts, strict=True)
        )
        return columns, rows

    def drop(self) -> None:
        """Let go."""
        self._held = None

    # ---- drawing ---------------------------------------------------------------------------------

    def paint(self, painter: QPainter, picture: QRectF, ground: str) -> None:
        """Draw the box over the picture of the slice, the rest behind a veil."""
        if self.ends is None:
            return
        rect, veil = self.rect(), QColor(ground)
        veil.setAlpha(VEIL)
        painter.save()
        painter.setClipRect(picture.adjusted(-HANDLE, -HANDLE, HANDLE, HANDLE))
        if self.cuts_slice:
            painter.fillRect(QRectF(picture.topLeft(), QPointF(picture.right(), rect.top())), veil)
            painter.fillRect(QRectF(QPointF(picture.left(), rect.bottom()), picture.bottomRight()), veil)
            painter.fillRect(QRectF(QPointF(picture.left(), rect.top()), rect.bottomLeft()), veil)
            painter.fillRect(QRectF(rect.topRight(), QPointF(picture.right(), rect.bottom())), veil)
        else:
            painter.fillRect(picture, veil)
        colour = QColor(self.colour)
        line = Qt.PenStyle.SolidLine if self.cuts_slice else Qt.PenStyle.DashLine
        painter.setPen(QPen(colour, 2, line))
        painter.drawRect(rect)
        painter.setPen(QPen(QColor(ground), 1))
        painter.setBrush(colour)
        middle = rect.center()
        for x in (rect.left(), middle.x(), rect.right()):
            for y in (rect.top(), middle.y(), rect.bottom()):
                if (x, y) != (middle.x(), middle.y()):
                    painter.drawRect(QRectF(x - HANDLE / 2, y - HANDLE / 2, HANDLE, HANDLE))
        painter.restore()


def _nearest(place: float, low: float, high: float) -> int:
    """Return -1 or 1 for the end that lies within reach, the nearer one of both; 0 for none."""
    to_low, to_high = abs(place - low), abs(place - high)
    if min(to_low, to_high) > REACH:
        return 0
    return -1 if to_low < to_high else 1


def _moved(ends: tuple[int, int], side: int, place: int, count: int) -> tuple[int, int]:
    """Return two ends, of which the one on a side was moved; at least one voxel stays between them."""
    start, stop = ends
    if side < 0:
        start = min(max(place, 0), stop - 1)
    elif side > 0:
        stop = max(min(place, count), start + 1)
    return start, stop
