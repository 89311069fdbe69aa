"""One slice of a scan as a flat picture, with the lines where the other two slices cut it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, UInt8
from PySide6.QtCore import QEvent, QLineF, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import (
    QColor,
    QEnterEvent,
    QImage,
    QKeyEvent,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QPen,
    QWheelEvent,
)
from PySide6.QtWidgets import QWidget

from mbstudio.scene.label_overlay import HALO, LabelLook
from mbstudio.ui.language import tr
from mbstudio.ui.view.pane_box import Ends, PaneBox
from mbstudio.ui.view.pane_labels import PaneLabels
from mbstudio.ui.view.pane_trail import Brush, PaneTrail

Outline = tuple[Float[np.ndarray, "m 2 2"], str]
"""Lines (start and end as column and row of voxels) and their colour."""

MARGIN = 6  # pixels around the picture
CLICK = 4.0  # pixels that the mouse may move between press and release of a click
LARGEST_ZOOM = 40.0


class SlicePane(QWidget):
    """Shows a slice as the camera's presets do: the first axis to the right, the second upwards.

    The wheel goes through the slices, with Ctrl it zooms; the left button moves the lines, the right one
    changes the grey window, the middle one moves the picture; a double click makes it as large as the view.

    Parameters
    ----------
    title : str
        Of the plane: ``"XY"``.
    across : str
        The axis that is cut: ``"z"``.

    Attributes
    ----------
    stepped : signal (int)
        Go so many slices further.
    crossed : signal (float, float)
        The lines are to cross at this voxel (column, row).
    pointed : signal (float, float)
        The mouse is over this voxel (column, row).
    left : signal
        The mouse is over none.
    windowed : signal (float, float)
        Widen the grey window and raise its middle by these shares of its width.
    boxed : signal (object)
        The box is to have these ends (columns, rows).
    stroked : signal (float, float, bool)
        The left button is held over this voxel (column, row), and was pressed just now or before; only while
        a tool takes it.
    stroke_ended : signal
        It was let go.
    zoomed : signal ()
        Another part of the picture is shown than before.
    enlarged : signal ()
        It is to be as large as the view, or as small as before.
    freed : signal ()
        Esc was pressed, and nobody else took it.
    picked : signal (float, float)
        This voxel (column, row) was clicked, and the mouse did not move meanwhile.
    menu_asked : signal (float, float, QPoint)
        It was clicked with the right button; the place on the screen.
    is_taken : bool
        Whether a tool takes the left button.
    box : PaneBox
        The part of the slice that is chosen.
    """

    stepped = Signal(int)
    crossed = Signal(float, float)
    pointed = Signal(float, float)
    left = Signal()
    windowed = Signal(float, float)
    boxed = Signal(object)
    stroked = Signal(float, float, bool)
    stroke_ended = Signal()
    zoomed = Signal()
    enlarged = Signal()
    freed = Signal()
    picked = Signal(float, float)
    menu_asked = Signal(float, float, object)

    def __init__(self, title: str, across: str) -> None:
        super().__init__()
        self.title, self.across = title, across
        self._image: QImage | None = None
        self._tint: QImage | None = None
        self._shape = (1, 1)  # rows, columns
        self._spacing = (1.0, 1.0)
        self._cross = (0.0, 0.0)
        self._told = ""
        self._colours = ("#888888", "#888888", "#888888", "#000000")
        self._zoom, self._shift = 1.0, QPointF()
        self._last: QPointF | None = None
        self._pressed: QPointF | None = None
        self.is_taken = False
        self._marks: list[tuple[float, float]] = []
        self.box = PaneBox(self.place_of)
        self._grains = PaneLabels()
        self._outlines: Sequence[Outline] = ()
        self._trail = PaneTrail(self.place_of, lambda: self.scale)
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMinimumSize(120, 90)
        self.setAccessibleName(tr("Slice {plane}", plane=title))
        self.setToolTip(
            tr(
                "<p>{plane}: the wheel or the arrow keys change the slice, the left button moves the lines, "
                "the right one changes the grey window (across: its width, up: brighter), Ctrl and wheel "
                "zoom, a double click enlarges.</p>",
                plane=title,
            )
        )

    def sizeHint(self) -> QSize:
        return QSize(300, 220)

    def show_slice(
        self,
        image: UInt8[np.ndarray, "h w"] | None,
        spacing: tuple[float, float] = (1.0, 1.0),
        told: str = "",
    ) -> None:
        """Show a slice.

        Parameters
        ----------
        image : uint8 array, shape (h, w), or None
            Grey values; its first row is drawn lowest.
        spacing : tuple of float
            Edge of a pixel to the right and upwards, in one unit.
        told : str
            Where it was cut, for the corner.
        """
        if image is None:
            self._image = None
        else:
            turned = np.ascontiguousarray(image[::-1])
            height, width = turned.shape
            if (height, width) != self._shape:
                self._zoom, self._shift = 1.0, QPointF()
            self._shape, self._spacing = (height, width), spacing
            self._image = QImage(
                turned.tobytes(), width, height, width, QImage.Format.Format_Grayscale8
            ).copy()
        self._told = told
        self.update()

    def set_labels(
        self,
        labels: Int[np.ndarray, "h w"] | None,
        colours: UInt8[np.ndarray, "k 3"] | None = None,
        look: LabelLook = LabelLook(),  # noqa: B008  # frozen
    ) -> None:
        """Show grains over the slice: the label of each voxel, its colour, how they are drawn."""
        self._grains.set(labels, colours, look)
        self.update()

    def set_outlines(self, outlines: Sequence[Outline]) -> None:
        """Show lines over slice and grains."""
        if outlines or self._outlines:
            self._outlines = outlines
            self.update()

    def set_brush(self, brush: Brush | None) -> None:
        """Show what a tool draws while it draws it."""
        if brush != self._trail.brush:
            self._trail.brush = brush
            self.update()

    def set_tint(self, picture: UInt8[np.ndarray, "h w 4"] | None) -> None:
        """Lay a picture (red, green, blue, alpha) over the slice, its first row lowest; None for none."""
        if picture is None and self._tint is None:
            return
        self._tint = None
        if picture is not None:
            turned = np.ascontiguousarray(picture[::-1])
            height, width, _ = turned.shape
            self._tint = QImage(
                turned.tobytes(), width, height, 4 * width, QImage.Format.Format_RGBA8888
            ).copy()
        self.update()

    @property
    def is_tinted(self) -> bool:
        """Whether a picture lies over the slice."""
        return self._tint is not None

    def set_cross(self, column: float, row: float) -> None:
        """Let the lines cross at a voxel; a magnified picture moves where that would not be seen."""
        cross = (float(column), float(row))
        if cross != self._cross:
            self._cross = cross
            if self._zoom > 1 and not QRectF(self.rect()).contains(self.place_of(*cross)):
                self._shift += QRectF(self.rect()).center() - self.place_of(*cross)
        self.update()

    def set_box(self, ends: Ends | None, cuts_slice: bool = True) -> None:
        """Show the part of the slice that is chosen, or none; whether this slice lies within it."""
        self.box.ends, self.box.cuts_slice = ends, cuts_slice
        self.update()

    def set_marks(self, marks: list[tuple[float, float]]) -> None:
        """Mark voxels (column, row) with rings."""
        if marks != self._marks:
            self._marks = marks
            self.update()

    def set_colours(self, own: str, upright: str, level: str, ground: str) -> None:
        """Take the colours of the frame, of the upright and the level line, and behind the picture."""
        self._colours = (own, upright, level, ground)
        self.update()

    # ---- places ----------------------------------------------------------------------------------

    def picture_rect(self) -> QRectF:
        """Return where the whole picture lies on the widget."""
        rows, columns = self._shape
        width, height = columns * self._spacing[0], rows * self._spacing[1]
        room = QRectF(self.rect()).adjusted(MARGIN, MARGIN, -MARGIN, -MARGIN)
        scale = max(1e-9, min(room.width() / width, room.height() / height)) * self._zoom
        result = QRectF(0.0, 0.0, width * scale, height * scale)
        result.moveCenter(room.center() + self._shift)
        return result

    @property
    def scale(self) -> float:
        """Pixels of the widget in one unit of the slice."""
        return self.picture_rect().width() / (self._shape[1] * self._spacing[0])

    @property
    def is_magnified(self) -> bool:
        """Whether only a part of the slice is shown."""
        return self._zoom > 1.0

    @property
    def middle(self) -> tuple[float, float]:
        """The voxel (column, row) in the middle of what is shown."""
        return self._voxel_near(QRectF(self.rect()).center())

    def zoom_to(self, scale: float, column: float, row: float) -> None:
        """Show a unit of the slice with so many pixels, a voxel in the middle; all of it if it fits in."""
        self._zoom = float(np.clip(self._zoom * scale / self.scale, 1.0, LARGEST_ZOOM))
        self._shift = QPointF()
        if self._zoom > 1.0:
            self._shift = QRectF(self.rect()).center() - self.place_of(column, row)
        self.update()

    def show_all(self) -> None:
        """Show the whole slice again."""
        self._zoom, self._shift = 1.0, QPointF()
        self.update()

    def voxel_at(self, place: QPointF) -> tuple[float, float] | None:
        """Return the voxel (column, row; the centre of the first is 0) under a place, or None outside."""
        if self._image is None or not self.picture_rect().contains(place):
            return None
        return self._voxel_near(place)

    def _voxel_near(self, place: QPointF) -> tuple[float, float]:
        """Return the voxel at a place, also outside the picture."""
        rect, (rows, columns) = self.picture_rect(), self._shape
        column = (place.x() - rect.left()) / rect.width() * columns - 0.5
        row = (rect.bottom() - place.y()) / rect.height() * rows - 0.5
        return column, row

    def place_of(self, column: float, row: float) -> QPointF:
        """Return where the centre of a voxel lies on the widget."""
        rect, (rows, columns) = self.picture_rect(), self._shape
        return QPointF(
            rect.left() + (column + 0.5) / columns * rect.width(),
            rect.bottom() - (row + 0.5) / rows * rect.height(),
        )

    # ---- events ----------------------------------------------------------------------------------

    def paintEvent(self, event: QPaintEvent) -> None:
        own, upright, level, ground = self._colours
        painter = QPainter(self)
        painter.fillRect(self.rect(), QColor(ground))
        if self._image is not None:
            rect = self.picture_rect()
            magnified = rect.width() > 2 * self._shape[1]
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, not magnified)
            painter.drawImage(rect, self._image)
            if self._tint is not None:
                painter.drawImage(rect, self._tint)
            self._grains.paint(painter, rect, self.rect(), self.devicePixelRatioF())
            self._paint_outlines(painter)
            self.box.paint(painter, rect, ground)
            place = self.place_of(*self._cross)
            for colour, start, end in (
                (upright, QPointF(place.x(), rect.top()), QPointF(place.x(), rect.bottom())),
                (level, QPointF(rect.left(), place.y()), QPointF(rect.right(), place.y())),
            ):
                painter.setPen(QPen(QColor(colour), 1))
                painter.drawLine(start, end)
            self._trail.paint(painter, rect)
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            for mark in self._marks:
                for colour, width in ((ground, 4), (own, 2)):
                    painter.setPen(QPen(QColor(colour), width))
                    painter.drawEllipse(self.place_of(*mark), 5.0, 5.0)
            painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
            painter.setPen(QPen(QColor(own), 2 if self.hasFocus() else 1))
            painter.drawRect(rect)
            self._write(painter)
        painter.end()

    def _paint_outlines(self, painter: QPainter) -> None:
        rect, (rows, columns) = self.picture_rect(), self._shape
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for lines, colour in self._outlines:
            places = np.empty_like(lines)
            places[..., 0] = rect.left() + (lines[..., 0] + 0.5) / columns * rect.width()
            places[..., 1] = rect.bottom() - (lines[..., 1] + 0.5) / rows * rect.height()
            drawn = [QLineF(*line) for line in places.reshape(-1, 4).tolist()]
            for pen, width in ((QColor(*HALO, 190), 4.0), (QColor(colour), 2.0)):
                painter.setPen(QPen(pen, width, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
                painter.drawLines(drawn)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)

    def _write(self, painter: QPainter) -> None:
        words = f"{self.title}   {self._told}" if self._told else self.title
        metrics = painter.fontMetrics()
        corner = self.picture_rect().topLeft()
        left, top = max(corner.x(), 0.0), max(corner.y(), 0.0)
        box = QRectF(left, top, metrics.horizontalAdvance(words) + 14, metrics.height() + 4)
        painter.fillRect(box, QColor(self._colours[3]))
        painter.setPen(QColor(self._colours[0]))
        painter.drawText(box, Qt.AlignmentFlag.AlignCenter, words)

    def wheelEvent(self, event: QWheelEvent) -> None:
        turned = event.angleDelta().y() / 120
        if event.modifiers() & Qt.KeyboardModifier.ControlModifier:
            self._zoom_at(event.position(), 1.25**turned)
        elif turned:
            self.stepped.emit(round(turned) or (1 if turned > 0 else -1))
        event.accept()

    def _zoom_at(self, place: QPointF, factor: float) -> None:
        zoom = float(np.clip(self._zoom * factor, 1.0, LARGEST_ZOOM))
        middle = QRectF(self.rect()).center()
        away = place - middle - self._shift
        self._shift += away * (1 - zoom / self._zoom)
        self._zoom = zoom
        if zoom == 1.0:
            self._shift = QPointF()
        self.update()
        self.zoomed.emit()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self._last = self._pressed = event.position()
        if event.button() != Qt.MouseButton.LeftButton:
            return
        if self.is_taken:
            self._stroke_at(event.position(), True)
        elif not self.box.grab(event.position()):
            self._cross_at(event.position())

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        place = event.position()
        moved = place - self._last if self._last is not None else QPointF()
        self._last = place if event.buttons() else None
        if event.buttons() & Qt.MouseButton.LeftButton and self.is_taken:
            self._stroke_at(place, False)
        elif event.buttons() & Qt.MouseButton.LeftButton and self.box.is_held:
            rows, columns = self._shape
            self.boxed.emit(self.box.dragged_to(*self._voxel_near(place), (columns, rows)))
        elif event.buttons() & Qt.MouseButton.LeftButton:
            self._cross_at(place)
        elif event.buttons() & Qt.MouseButton.RightButton:
            self.windowed.emit(moved.x() / 200, -moved.y() / 200)
        elif event.buttons() & Qt.MouseButton.MiddleButton:
            self._shift += moved
            self.update()
            self.zoomed.emit()
        if not self.box.is_held:
            self.setCursor(self.box.cursor_at(place) or Qt.CursorShape.CrossCursor)
        if self._trail.follows_mouse:
            self._trail.hover(place)
            self.update()
        voxel = self.voxel_at(place)
        if voxel is None:
            self.left.emit()
        else:
            self.pointed.emit(*voxel)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if not (self.is_taken and event.button() == Qt.MouseButton.LeftButton) and not self.box.is_held:
            self._tell_click(event)
        self._last = None
        self.box.drop()
        if self.is_taken and event.button() == Qt.MouseButton.LeftButton:
            self._trail.end()
            self.update()
            self.stroke_ended.emit()

    def _tell_click(self, event: QMouseEvent) -> None:
        """Tell a click that moved nothing."""
        pressed, self._pressed = self._pressed, None
        voxel = self.voxel_at(event.position())
        if pressed is None or voxel is None or (event.position() - pressed).manhattanLength() > CLICK:
            return
        if event.button() == Qt.MouseButton.LeftButton:
            self.picked.emit(*voxel)
        elif event.button() == Qt.MouseButton.RightButton:
            self.menu_asked.emit(*voxel, event.globalPosition().toPoint())

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        if self.is_taken:
            self.mousePressEvent(event)  # two clicks of a tool, one soon after the other
        elif event.button() == Qt.MouseButton.LeftButton:
            self.enlarged.emit()

    def enterEvent(self, event: QEnterEvent) -> None:
        self.setCursor(Qt.CursorShape.CrossCursor)

    def leaveEvent(self, event: QEvent) -> None:
        self._trail.hover(None)
        self.update()
        self.left.emit()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        steps = {
            Qt.Key.Key_Up: 1,
            Qt.Key.Key_Down: -1,
            Qt.Key.Key_Right: 1,
            Qt.Key.Key_Left: -1,
            Qt.Key.Key_PageUp: 10,
            Qt.Key.Key_PageDown: -10,
        }
        step = steps.get(Qt.Key(event.key()))
        if event.key() == Qt.Key.Key_Escape:
            self.freed.emit()
        elif event.key() in (Qt.Key.Key_Plus, Qt.Key.Key_Equal, Qt.Key.Key_Minus):
            self._zoom_at(self.place_of(*self._cross), 0.8 if event.key() == Qt.Key.Key_Minus else 1.25)
        elif step is None:
            super().keyPressEvent(event)
        else:
            self.stepped.emit(step)

    def _stroke_at(self, place: QPointF, is_first: bool) -> None:
        voxel = self.voxel_at(place)
        if voxel is not None:
            self._trail.begin(*voxel) if is_first else self._trail.go_on(*voxel)
            self.update()
            self.stroked.emit(*voxel, is_first)

    def _cross_at(self, place: QPointF) -> None:
        rect = self.picture_rect()
        inside = QPointF(
            min(max(place.x(), rect.left()), rect.right() - 1e-6),
            min(max(place.y(), rect.top() + 1e-6), rect.bottom() - 1e-6),
        )
        voxel = self.voxel_at(inside)
        if voxel is not None:
            self.crossed.emit(*voxel)
