"""Remembers between two starts how the panels stood and from where each project was looked at."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QDockWidget

import mbstudio
from mbstudio.ui.shell.dialogs.preferences import is_on
from mbstudio.ui.soon import Soon

if TYPE_CHECKING:
    from mbstudio.ui.shell.main_window import MainWindow

CAMERAS = 20  # projects whose camera is remembered
FREE = ("history", "log", "bodies")
"""Docks that belong to no station: they stay as they are wherever one goes."""


class LayoutMemory(QObject):
    """Keeps sizes of docks, what the person has hidden at which station, and cameras.

    Parameters
    ----------
    window : MainWindow
    """

    def __init__(self, window: MainWindow) -> None:
        super().__init__(window)
        self._window, self._settings = window, window.settings
        self.hidden: dict[str, set[str]] = {}
        self._shown_before: set[str] = set()
        self._wanted: Any = None
        self._soon = Soon(self)

    @property
    def docks(self) -> dict[str, QDockWidget]:
        """The docks that can be hidden, by name."""
        window = self._window
        docks = window.findChildren(QDockWidget)
        return {dock.objectName(): dock for dock in docks if dock is not window.side_dock}

    # ---- panels --------------------------------------------------------------------------------

    def restore(self) -> None:
        """Put the panels as they stood when the window was closed last."""
        window = self._window
        if not is_on(window.workspace, "layout/kept"):
            return
        # Only of this version: another one may have other docks.
        state = self._settings.value(f"layout/{mbstudio.__version__}")
        sized = _record(self._settings.value("layout/sized"))
        if state is not None and window.restoreState(state):
            window._sized.extend(dock for name, dock in self.docks.items() if sized.get(name))
        self.hidden = {
            station: set(names) for station, names in _record(self._settings.value("layout/hidden")).items()
        }

    def note(self, _checked: bool = False) -> None:
        """Take down what is hidden at the station that is open: the person has just said so."""
        window = self._window
        gone = self.hidden.setdefault(window.station, set())
        for name, dock in self.docks.items():
            if name in FREE:
                continue
            if dock.isHidden() and name in self._shown_before:
                gone.add(name)
            elif not dock.isHidden():
                gone.discard(name)

    def apply(self) -> None:
        """Hide what the person has hidden at this station."""
        self._shown_before = {name for name, dock in self.docks.items() if not dock.isHidden()}
        for name in self.hidden.get(self._window.station, ()):
            dock = self.docks.get(name)
            if dock is not None:
                dock.hide()

    def forget(self) -> None:
        """Show everything again."""
        self.hidden.clear()

    def save(self) -> None:
        """Write down how the panels and the camera stand."""
        window = self._window
        self._settings.setValue(f"layout/{mbstudio.__version__}", window.saveState())
        names = {name: dock in window._sized for name, dock in self.docks.items()}
        self._settings.setValue("layout/sized", json.dumps(names))
        hidden = {station: sorted(names) for station, names in self.hidden.items() if names}
        self._settings.setValue("layout/hidden", json.dumps(hidden))
        self.save_camera()

    # ---- camera --------------------------------------------------------------------------------

    def save_camera(self) -> None:
        """Write down from where the project is looked at."""
        path = self._window.workspace.project.path
        if path is None or not self._window.has_view:
            return
        cameras = _record(self._settings.value("layout/cameras"))
        cameras.pop(str(path.resolve()), None)
        camera = self._window.viewport.plotter.camera
        places = [camera.position, camera.focal_point, camera.up]
        cameras[str(path.resolve())] = [list(map(float, place)) for place in places]
        newest = dict(list(cameras.items())[-CAMERAS:])
        self._settings.setValue("layout/cameras", json.dumps(newest))

    def project_opened(self) -> None:
        """Look at the project from where it was looked at last, once it is shown."""
        path = self._window.workspace.project.path
        cameras = _record(self._settings.value("layout/cameras"))
        self._wanted = None
        if path is not None and is_on(self._window.workspace, "layout/kept"):
            self._wanted = cameras.get(str(path.resolve()))
        if self._window.workspace.state.scan is None:
            self.use_camera()

    def use_camera(self) -> None:
        """Take the remembered camera, after what has just been shown has moved its own."""
        wanted, self._wanted = self._wanted, None
        if wanted is None:
            return

        def take() -> None:
            camera = self._window.viewport.plotter.camera
            camera.position, camera.focal_point, camera.up = wanted
            self._window.viewport.plotter.renderer.ResetCameraClippingRange()
            self._window.viewport.request_render()

        self._soon.call(take)


def _record(text: Any) -> dict[str, Any]:
    """Return what JSON in the settings says; nothing where somebody has spoilt it."""
    try:
        found = json.loads(text) if isinstance(text, str) else {}
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
