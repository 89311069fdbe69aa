"""The real thing: pyvistaqt's interactor in a QOpenGLWidget."""

from __future__ import annotations

from typing import cast

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget
from pyvistaqt import QtInteractor

from mbstudio.ui.language import tr
from mbstudio.ui.viewport.viewport import Viewport


class OpenGLViewport(Viewport):
    """Draws on the graphics card (or Mesa's software) straight into the window."""

    kind = "OpenGL"

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        # auto_update would render on a timer for ever.
        self.plotter = QtInteractor(self, auto_update=False, multi_samples=4)
        self.plotter.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.plotter.setAccessibleName(tr("3-D view"))
        self.plotter.setMouseTracking(True)
        self.plotter.installEventFilter(self)
        # A dropped file belongs to the window, not to pyvistaqt.
        self.plotter.setAcceptDrops(False)
        self._layout.addWidget(self.plotter)

    @property
    def canvas(self) -> QWidget:
        return cast(QWidget, self.plotter)

    def render_now(self) -> None:
        if self.plotter.isVisible():
            self.scaled.emit(self.devicePixelRatioF())
            self.plotter.render()

    def close_viewport(self) -> None:
        super().close_viewport()
        self.plotter.removeEventFilter(self)
        self.plotter.close()
