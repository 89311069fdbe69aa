"""The 3-D view behind one interface: what the window may ask of either implementation."""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np
import pyvista as pv
from jaxtyping import UInt8
from PySide6.QtCore import QEvent, QObject, QPointF, Qt, QTimer, Signal
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QVBoxLayout, QWidget

CLICK = 5.0  # pixels that the mouse may move between press and release of a click


class Grip(Protocol):
    """Something in the scene that can be dragged; places are pixels from the picture's lower left corner."""

    def over(self, x: float, y: float) -> object | None:
        """Return what lies under the mouse and can be grabbed, or None."""

    def grab(self, x: float, y: float) -> bool:
        """Begin to drag what lies there; return whether there is something."""

    def drag(self, x: float, y: float) -> None:
        """Go on to another place."""

    def drop(self) -> None:
        """End the drag."""


class Viewport(QWidget):
    """A widget that holds a plotter.

    Attributes
    ----------
    plotter : pyvista.BasePlotter
    clicked : signal (float, float)
        A click that turned nothing, in pixels of the picture from its lower left corner.
    menu_asked : signal (float, float, QPoint)
        A click of the right button that turned nothing, in the same pixels, and its place on the screen.
    hovered : signal (float, float)
        The mouse is there, and no button is held.
    moving : signal (bool)
        The camera begins to be turned by hand, or is let go.
    scaled : signal (float)
        So many pixels of the picture are now one of the screen's units: for the size of text and lines.
    grips : list of Grip
        What can be dragged instead of turning the camera, the first one goes first.
    """

    kind: ClassVar[str] = ""
    clicked = Signal(float, float)
    menu_asked = Signal(float, float, object)
    hovered = Signal(float, float)
    moving = Signal(bool)
    scaled = Signal(float)
    plotter: pv.BasePlotter

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._layout = QVBoxLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._pressed: dict[Qt.MouseButton, QPointF] = {}
        self.grips: list[Grip] = []
        self._held: Grip | None = None
        # Many changes of one turn of the event loop make one picture.
        self._render_soon = QTimer(self)
        self._render_soon.setSingleShot(True)
        self._render_soon.setInterval(0)
        self._render_soon.timeout.connect(self.render_now)

    def request_render(self) -> None:
        """Render once the event loop is free."""
        self._render_soon.start()

    def render_now(self) -> None:
        """Render at once."""
        raise NotImplementedError

    def picture(self, scale: int = 1) -> UInt8[np.ndarray, "h w 3"]:
        """Render and return what is seen, with `scale` times the view's pixels along each side."""
        self.render_now()
        return np.asarray(self.plotter.screenshot(return_img=True, scale=scale))[..., :3]

    def close_viewport(self) -> None:
        """Free the graphics; the widget is of no use afterwards."""
        self._render_soon.stop()

    def watch_clicks(self, event: QEvent) -> None:
        """Look at an event of the drawing widget and tell plain clicks of the left and the right button."""
        if not isinstance(event, QMouseEvent):
            return
        button = event.button()
        if event.type() == QEvent.Type.MouseButtonPress:
            self._pressed[button] = event.position()
        elif event.type() == QEvent.Type.MouseButtonRelease and button in self._pressed:
            moved = event.position() - self._pressed.pop(button)
            if moved.manhattanLength() > CLICK:
                return
            if button == Qt.MouseButton.LeftButton:
                self.clicked.emit(*self.pixel(event.position()))
            elif button == Qt.MouseButton.RightButton:
                self.menu_asked.emit(*self.pixel(event.position()), event.globalPosition().toPoint())

    def pixel(self, place: QPointF) -> tuple[float, float]:
        """Return the picture's pixel under a place of the widget, from the lower left corner."""
        ratio = self.devicePixelRatioF()
        return place.x() * ratio, (self.height() - place.y()) * ratio

    @property
    def canvas(self) -> QWidget:
        """The widget that is drawn on and gets the mouse."""
        return self

    def offer(self, event: QEvent) -> bool:
        """Offer a mouse event to the grips; return whether one took it."""
        if not isinstance(event, QMouseEvent):
            return False
        x, y = self.pixel(event.position())
        kind = event.type()
        if kind == QEvent.Type.MouseButtonPress and event.button() == Qt.MouseButton.LeftButton:
            self._held = next((grip for grip in self.grips if grip.grab(x, y)), None)
            return self._held is not None
        if kind == QEvent.Type.MouseMove and self._held is not None:
            self._held.drag(x, y)
            return True
        if kind == QEvent.Type.MouseMove and event.buttons() == Qt.MouseButton.NoButton:
            taken = any(grip.over(x, y) is not None for grip in self.grips)
            shape = Qt.CursorShape.SizeAllCursor if taken else Qt.CursorShape.ArrowCursor
            if self.canvas.cursor().shape() != shape:
                self.canvas.setCursor(shape)
            self.hovered.emit(x, y)
        if kind == QEvent.Type.MouseButtonRelease and self._held is not None:
            self._held.drop()
            self._held = None
            return True
        return False

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if self.offer(event):
            return True
        if event.type() == QEvent.Type.MouseButtonPress:
            self.moving.emit(True)
        elif event.type() == QEvent.Type.MouseButtonRelease:
            self.moving.emit(False)
        self.watch_clicks(event)
        return super().eventFilter(watched, event)
