"""The fixture that fails tests which leave something alive sees what it is to see."""

from __future__ import annotations

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QWidget
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow

from mbstudio.ui.viewport import make_viewport
from tests.ui.conftest import delete_later_now, living


def test_viewports_vtk_timers_and_widgets_are_seen_while_they_live(qapp):
    timer, widget, viewport = QTimer(), QWidget(), make_viewport()
    assert timer not in living()
    timer.start(60_000)
    seen = living()
    for thing in (timer, widget, viewport):
        assert thing in seen
    assert any(isinstance(thing, vtkRenderWindow) for thing in seen)
    assert any(isinstance(thing, vtkRenderer) for thing in seen)
    timer.stop()
    viewport.close_viewport()
    for thing in (widget, viewport):
        thing.deleteLater()
    delete_later_now()
    assert timer not in living()
    del seen, thing, widget, viewport


def test_a_window_leaves_nothing(window, idle):
    window.shell.begin()
    idle()
    # What it leaves is found by the fixture, when the test has ended.
    assert window in living()
