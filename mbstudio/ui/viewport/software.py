"""An off-screen plotter painted as a picture: needs no OpenGL of the window system.

It serves tests, remote desktops and machines whose graphics driver fails.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pyvista as pv
from jaxtyping import UInt8
from PySide6.QtCore import QPointF, Qt, QTimer
from PySide6.QtGui import QImage, QMouseEvent, QPainter, QPaintEvent, QResizeEvent, QWheelEvent
from PySide6.QtWidgets import QWidget
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

from mbstudio.ui.language import tr
from mbstudio.ui.viewport.viewport import Viewport

BUDGET = 0.03  # seconds that a picture may take while things move
CALM = 200  # milliseconds without a change after which the picture is drawn sharp
LATE = 0.03  # seconds after its time at which drawing sharp waits once more
COARSEST = 0.25  # of the width and height, however slow
SMOOTH = 4  # samples a pixel of a picture at rest
MANY = (
    30_000  # triangles from which a picture at rest takes one sample a pixel, and its edges are smoothed then
)


class SoftwareViewport(Viewport):
    """Renders off screen, paints the picture and turns the camera by the mouse itself.

    Left button turns, middle button or Shift and left moves, right button or wheel zooms: the
    same as in the other implementation.

    The processor draws every pixel in the main thread. What moves is drawn with rough edges, and with fewer
    pixels where it would take longer than the event loop may pause; at rest it is drawn sharp. Pictures to
    keep always have several samples a pixel.
    """

    kind = "software"

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.plotter = pv.Plotter(off_screen=True, window_size=[640, 480])
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setAccessibleName(tr("3-D view"))
        self.setMouseTracking(True)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self._image: QImage | None = None
        self._last: QPointF | None = None
        self._begun = False
        self._closed = False
        self._latest_sharp = math.inf  # when drawing sharp would come late
        self._per_pixel = 0.0  # seconds, of the last pictures
        self._sharpen_soon = QTimer(self)
        self._sharpen_soon.setSingleShot(True)
        self._sharpen_soon.setInterval(CALM)
        self._sharpen_soon.timeout.connect(self._sharpen)
        self._render_soon.timeout.disconnect()
        self._render_soon.timeout.connect(self._render_quickly)

    def _sharpen(self) -> None:
        if time.perf_counter() > self._latest_sharp:
            # The window was busy when calm should have come: what waits behind comes first, but only once.
            self._latest_sharp = math.inf
            self._sharpen_soon.start()
            return
        self.render_now()

    def render_now(self) -> None:
        """Render at once and sharp."""
        self._sharpen_soon.stop()
        self._render(1.0, 0 if self._triangles() > MANY else SMOOTH, smoothed=True)

    def _triangles(self) -> int:
        """Return how many triangles and other cells are drawn."""
        total = 0
        for actor in self.plotter.renderer.GetActors():
            mapper = actor.GetMapper() if actor.GetVisibility() else None
            if mapper is not None and mapper.GetInput() is not None:
                total += mapper.GetInput().GetNumberOfCells()
        return total

    @property
    def is_sharp(self) -> bool:
        """Whether the picture has all its pixels and smooth edges."""
        return not self._sharpen_soon.isActive()

    def coarseness(self) -> float:
        """Return by what width and height of the next picture are multiplied to draw it in time."""
        width, height = self._pixels()
        expected = self._per_pixel * width * height
        return 1.0 if expected <= BUDGET else max(COARSEST, math.sqrt(BUDGET / expected))

    def _render_quickly(self) -> None:
        begun, scale = time.perf_counter(), self.coarseness()
        self._render(scale, 0)
        width, height = self._pixels()
        spent = (time.perf_counter() - begun) / (scale * width * scale * height)
        self._per_pixel = spent if not self._per_pixel else 0.5 * (self._per_pixel + spent)
        self._latest_sharp = time.perf_counter() + CALM / 1000 + LATE
        self._sharpen_soon.start()

    def picture(self, scale: int = 1) -> UInt8[np.ndarray, "h w 3"]:
        self.render_now()
        return self._drawn(float(scale), SMOOTH)

    def _render(self, scale: float, samples: int, *, smoothed: bool = False) -> None:
        if self._closed:
            return
        # Four samples a pixel of very many triangles take more than twice as long as one.
        self.plotter.renderer.SetUseFXAA(smoothed and not samples)
        pixels = self._drawn(scale, samples)
        self.plotter.renderer.SetUseFXAA(False)
        height, width, _ = pixels.shape
        image = QImage(pixels.data, width, height, 3 * width, QImage.Format.Format_RGB888).copy()
        image.setDevicePixelRatio(self.devicePixelRatioF())
        self._image = image
        self.update()

    def _drawn(self, scale: float, samples: int) -> UInt8[np.ndarray, "h w 3"]:
        """Return the view with its sides multiplied, and so many samples a pixel."""
        whole, ratio = self._pixels(), self.devicePixelRatioF()
        width, height = (max(16, round(side * scale)) for side in whole)
        # Straight to VTK: pyvista draws everything again whenever its size is set.
        window = self._window
        window.SetMultiSamples(samples)
        window.SetSize(width, height)
        self.scaled.emit(ratio * scale)
        if not self._begun:
            self._begun = True
            self.plotter.show(auto_close=False, interactive=False)
        self.plotter.renderer.ResetCameraClippingRange()
        self.plotter.render()
        data = vtkUnsignedCharArray()
        # From the front, where edges are smooth.
        window.GetPixelData(0, 0, width - 1, height - 1, 1, data, 0)
        pixels = np.ascontiguousarray(vtk_to_numpy(data).reshape(height, width, 3)[::-1])
        if (width, height) != whole:
            # Who asks where a point stands in the picture means the whole one.
            window.SetSize(*whole)
            self.scaled.emit(ratio)
        return pixels

    @property
    def _window(self) -> Any:
        return self.plotter.render_window

    def close_viewport(self) -> None:
        super().close_viewport()
        self._sharpen_soon.stop()
        self._closed = True
        self.plotter.close()

    def _pixels(self) -> tuple[int, int]:
        ratio = self.devicePixelRatioF()
        return max(16, round(self.width() * ratio)), max(16, round(self.height() * ratio))

    # ---- events of the widget ------------------------------------------------------------------

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        if self._image is None:
            painter.fillRect(self.rect(), self.palette().window())
        else:
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            painter.drawImage(self.rect(), self._image)
        painter.end()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        if not self._closed:
            # At once: fitting the view asks the renderer for its size.
            self._window.SetSize(*self._pixels())
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
        self.watch_clicks(event)
        self.moving.emit(False)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self.offer(event) or self._last is None:
            return
        moved = event.position() - self._last
        self._last = event.position()
        buttons = event.buttons()
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
