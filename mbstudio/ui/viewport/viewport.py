"""The 3-D view behind one interface: what the window may ask of either implementation."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pyvista as pv
from jaxtyping import UInt8
from PySide6.QtCore import QEvent, QObject, QPointF, QTimer, Signal
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QVBoxLayout, QWidget

CLICK = 5.0  # pixels that the mouse may move between press and release of a click


class Viewport(QWidget):
    """A widget that holds a plotter.

    Attributes
    ----------
    plotter : pyvista.BasePlotter
    clicked : signal (float, float)
        A click that turned nothing, in pixels of the picture from its lower left corner.
    is_draft : bool
        Whether pictures may be plainer for a while because they have to follow a hand.
    """

    kind: ClassVar[str] = ""
    clicked = Signal(float, float)
    plotter: pv.BasePlotter
    is_draft = False

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._layout = QVBoxLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._pressed: QPointF | None = None
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

    def picture(self) -> UInt8[np.ndarray, "h w 3"]:
        """Render and return what is seen."""
        self.render_now()
        return np.asarray(self.plotter.screenshot(return_img=True))[..., :3]

    def close_viewport(self) -> None:
        """Free the graphics; the widget is of no use afterwards."""
        self._render_soon.stop()

    def watch_clicks(self, event: QEvent) -> None:
        """Look at an event of the drawing widget and emit `clicked` for a plain left click."""
        if not isinstance(event, QMouseEvent) or event.button().name != "LeftButton":
            return
        if event.type() == QEvent.Type.MouseButtonPress:
            self._pressed = event.position()
        elif event.type() == QEvent.Type.MouseButtonRelease and self._pressed is not None:
            moved = event.position() - self._pressed
            self._pressed = None
            if moved.manhattanLength() <= CLICK:
                ratio = self.devicePixelRatioF()
                x, y = event.position().x() * ratio, (self.height() - event.position().y()) * ratio
                self.clicked.emit(x, y)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        self.watch_clicks(event)
        return super().eventFilter(watched, event)
