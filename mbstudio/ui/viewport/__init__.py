"""The 3-D view: one interface, two implementations, chosen by what the machine can do.

Begin at :class:`~mbstudio.ui.viewport.viewport.Viewport`.
"""

from __future__ import annotations

import logging
import os

from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QWidget

from mbstudio.ui.viewport.viewport import Viewport

log = logging.getLogger(__name__)

__all__ = ["Viewport", "make_viewport"]


def make_viewport(parent: QWidget | None = None) -> Viewport:
    """Return the viewport that works here.

    ``MBSTUDIO_VIEWPORT=software`` or ``=opengl`` overrides the choice.
    """
    wish = os.environ.get("MBSTUDIO_VIEWPORT", "").lower()
    if wish == "opengl" or (wish != "software" and _has_opengl()):
        from mbstudio.ui.viewport.opengl import OpenGLViewport

        return OpenGLViewport(parent)
    from mbstudio.ui.viewport.software import SoftwareViewport

    return SoftwareViewport(parent)


def _has_opengl() -> bool:
    """Return whether Qt can make an OpenGL context that VTK can draw with (3.2 or newer)."""
    if QGuiApplication.platformName() in ("offscreen", "minimal", "vnc"):
        return False
    from PySide6.QtGui import QOffscreenSurface, QOpenGLContext

    surface = QOffscreenSurface()
    surface.create()
    context = QOpenGLContext()
    if not (context.create() and context.makeCurrent(surface)):
        log.warning("No OpenGL here: the 3-D view is drawn in software.")
        return False
    version = context.format().version()
    context.doneCurrent()
    if version < (3, 2):
        log.warning("OpenGL %d.%d is too old: the 3-D view is drawn in software.", *version)
        return False
    return True
