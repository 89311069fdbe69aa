"""An off-screen plotter painted as a picture: needs no OpenGL of the window system.

It serves tests, remote desktops and machines whose graphics driver fails.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QImage, QMouseEvent, QPainter, QPaintEvent, QResizeEvent, QWheelEvent
from PySide6.QtWidgets import QWidget
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

from mbstudio.ui.viewport.viewport import Viewport


class SoftwareViewport(Viewport):
    """Renders off screen, paints the picture and turns the camera by the mouse itself.

    Left button turns, middle button or Shift and left moves, right button or wheel zooms: the
    same as in the other implementation.
    """

    kind = "software"

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.plotter = pv.Plotter(off_screen=True, window_size=[640, 480])
        self._samples: int | None = None
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setAccessibleName("3-D view")
        self.setMouseTracking(True)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self._image: QImage | None = None
        self._last: QPointF | None = None
        self._begun = False
        self._closed = False

    def render_now(self) -> None:
        if self._closed:
            return
        size = self._pixels()
        if tuple(self.plotter.window_size) != size:
            self.plotter.window_size = size
        if not self._begun:
            self._begun = True
            self.plotter.show(auto_close=False, interactive=False)
        self._smooth(not self.is_draft)
        self.plotter.renderer.ResetCameraClippingRange()
        self.plotter.render()
        width, height = self._render_window.GetSize()
        pixels = vtkUnsignedCharArray()
        # From the front, where edges are smooth; the plotter's own way is a filter, three times as slow.
        self._render_window.GetPixelData(0, 0, width - 1, height - 1, 1, pixels, 0)
        rows = np.ascontiguousarray(vtk_to_numpy(pixels).reshape(height, width, 3)[::-1])
        image = QImage(rows.data, width, height, 3 * width, QImage.Format.Format_RGB888).copy()
        image.setDevicePixelRatio(self.devicePixelRatioF())
        self._image = image
        self.update()

    def close_viewport(self) -> None:
        super().close_viewport()
        self._closed = True
        self.plotter.close()

    def _smooth(self, on: bool) -> None:
        """Smooth edges, or not: it takes two thirds of the time that software needs for a picture."""
        if on and self._samples is not None:
            self._render_window.SetMultiSamples(self._samples)
            self._samples = None
        elif not on and self._samples is None:
            # Asked only now: before its first picture the window names more than it can do.
            self._samples = int(self._render_window.GetMultiSamples())
            self._render_window.SetMultiSamples(0)

    @property
    def _render_window(self) -> Any:
        return self.plotter.render_window

    def _pixels(self) -> tuple[int, int]:
        ratio = self.devicePixelRatioF()
        return max(16, round(self.width() * ratio)), max(16, round(self.height() * ratio))

    # ---- events of the widget ------------------------------------------------------------------

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        if self._image is None:
            painter.fillRect(self.rect(), self.palette().window())
        else:
            painter.drawImage(self.rect(), self._image)
        painter.end()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        if not self._closed:
            # At once: fitting the view asks the renderer for its size.
            self.plotter.window_size = self._pixels()
            self.request_render()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if self.offer(event):
            return
        self._last = event.position()
        self.watch_clicks(event)
        self.moving.emit(True)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self.offer(event):
            return
        self._last = None
        if self.is_draft:
            self.is_draft = False
            self.request_render()
        self.watch_clicks(event)
        self.moving.emit(False)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self.offer(event) or self._last is None:
            return
        moved = event.position() - self._last
        self._last = event.position()
        buttons = event.buttons()
        self.is_draft = True
        shifted = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
        if buttons & Qt.MouseButton.MiddleButton or (buttons & Qt.MouseButton.LeftButton and shifted):
            self.pan(moved.x(), moved.y())
        elif buttons & Qt.MouseButton.LeftButton:
            self.rotate(moved.x(), moved.y())
        elif buttons & Qt.MouseButton.RightButton:
            self.zoom(1.01 ** (-moved.y()))

    def wheelEvent(self, event: QWheelEvent) -> None:
        self.zoom(1.1 ** (event.angleDelta().y() / 120))
        event.accept()

    # ---- the camera ----------------------------------------------------------------------------

    def rotate(self, right: float, down: float) -> None:
        """Turn the camera around what it looks at, by a drag of so many pixels."""
        camera = self.plotter.renderer.camera
        camera.Azimuth(-right * 180 / max(self.width(), 1))
        camera.Elevation(down * 180 / max(self.height(), 1))
        camera.OrthogonalizeViewUp()
        self.request_render()

    def pan(self, right: float, down: float) -> None:
        """Move the picture by so many pixels."""
        camera = self.plotter.renderer.camera
        per_pixel = 2 * camera.GetParallelScale() / max(self.height(), 1)
        focal, position, up = (
            np.array(value) for value in (camera.GetFocalPoint(), camera.GetPosition(), camera.GetViewUp())
        )
        across = np.cross(focal - position, up)
        across /= np.linalg.norm(across) or 1.0
        shift = (-right * across + down * up) * per_pixel
        camera.SetFocalPoint(*(focal + shift))
        camera.SetPosition(*(position + shift))
        self.request_render()

    def zoom(self, factor: float) -> None:
        """Show things `factor` times as large."""
        camera = self.plotter.renderer.camera
        camera.SetParallelScale(camera.GetParallelScale() / factor)
        self.request_render()
