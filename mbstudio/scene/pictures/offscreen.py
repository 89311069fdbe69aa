"""Rendering without a display: which of VTK's windows to use, chosen before VTK is imported."""

from __future__ import annotations

import ctypes
import os
import sys

OSMESA = "libOSMesa.so.8"


def has_display() -> bool:
    """Return whether a window could be shown here."""
    if not sys.platform.startswith("linux"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def prepare_offscreen_rendering() -> None:
    """Make VTK render in memory where there is no display; a choice already made stands.

    It must be called before the first import of pyvista or VTK. OSMesa needs nothing but a
    processor; where it is gone (it left Mesa in 25.1), EGL does the same.
    """
    os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")
    if not has_display() and "VTK_DEFAULT_OPENGL_WINDOW" not in os.environ:
        window = "vtkOSOpenGLRenderWindow" if _loads(OSMESA) else "vtkEGLRenderWindow"
        os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = window


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
