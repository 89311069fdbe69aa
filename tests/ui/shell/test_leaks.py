"""The fixture that fails tests which leave something alive sees what it is to see."""

from __future__ import annotations

import gc
import weakref

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QWidget
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow

from mbstudio.core.project import Project, ProjectState
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.viewport import make_viewport
from tests.ui.conftest import PATIENCE, delete_later_now, living


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


def use_and_close(qtbot, settings, theme, grains):
    """Look at a grain at every station with the tools of the view, close, and return what may not stay."""
    window = MainWindow(settings, theme)
    window.project_files.asks = False
    window.show()
    qtbot.waitExposed(window)
    window.workspace.replace_project(Project(ProjectState(grains=grains)))
    window.workspace.select(1)
    for station in [station.id for station in window.stations]:
        window.enter(station)
        qtbot.waitUntil(lambda: window.queue.is_idle, timeout=PATIENCE)
    window.view_tools.measure("distance")
    window.view_tools.clip(True)
    window.view_tools.clear()
    window.view_tools.clip(False)
    window.shell.begin()
    qtbot.waitUntil(lambda: window.queue.is_idle, timeout=PATIENCE)
    scene, space = window.view.scene, window.workspace
    mortal = {"window": window, "scene": scene, "workspace": space, "queue": window.queue}
    watched = {name: weakref.ref(thing) for name, thing in mortal.items()}
    window.close()
    window.deleteLater()
    return watched


def test_a_closed_window_goes_with_its_scene_while_the_theme_lives_on(qtbot, settings, theme, two_grains):
    watched = use_and_close(qtbot, settings, theme, two_grains)
    delete_later_now()
    gc.collect()
    assert [name for name, thing in watched.items() if thing() is not None] == []
    # The theme belongs to the application: what listened to it has let go, and nothing is called any more.
    theme.choose("light")
