"""Remembers between two starts how the panels stood and from where each project was looked at."""

from __future__ import annotations

import json

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QMainWindow

import mbstudio
from mbstudio.ui.deferred_calls import DeferredCalls
from mbstudio.ui.kept_settings import record, see_from, stored_bytes, words
from mbstudio.ui.shell.dialogs.preferences import is_on
from mbstudio.ui.shell.docks import Docks
from mbstudio.ui.stations.registry import Stations
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView

CAMERAS = 20  # projects whose camera is remembered


class LayoutMemory(QObject):
    """Keeps sizes of docks, what the person has hidden at which station, and cameras.

    Parameters
    ----------
    window : QMainWindow
    studio : Studio
    stations : Stations
    docks : Docks
    view : SceneView
    """

    def __init__(
        self, window: QMainWindow, studio: Studio, stations: Stations, docks: Docks, view: SceneView
    ) -> None:
        super().__init__(window)
        self._window, self._stations, self._docks, self._view = window, stations, docks, view
        self._space, self._settings, self._viewport = studio.workspace, studio.settings, studio.viewport
        self.hidden: dict[str, set[str]] = {}
        self._shown_before: set[str] = set()
        self._wanted: list[list[float]] | None = None
        self._deferred = DeferredCalls(self)
        docks.arranged.connect(self.apply)

    # ---- panels --------------------------------------------------------------------------------

    def restore(self) -> None:
        """Put the panels as they stood when the window was closed last."""
        if not is_on(self._space, "layout/kept"):
            return
        # Only of this version: another one may have other docks.
        state = stored_bytes(self._settings, f"layout/{mbstudio.__version__}")
        sized = record(self._settings, "layout/sized")
        if state is not None and self._window.restoreState(state):
            self._docks.sized |= {name for name in self._docks.names if sized.get(name)}
        hidden = record(self._settings, "layout/hidden")
        self.hidden = {station: set(words(names)) for station, names in hidden.items()}

    def note(self, _checked: bool = False) -> None:
        """Take down what is hidden at the station that is open: the person has just said so."""
        gone = self.hidden.setdefault(self._stations.current.id, set())
        seen = self._docks.visible
        gone |= self._shown_before - seen - self._docks.free
        gone -= seen

    def apply(self) -> None:
        """Hide what the person has hidden at this station."""
        self._shown_before = self._docks.visible
        gone = self.hidden.get(self._stations.current.id, set())
        for dock in self._docks:
            if dock.name in gone:
                dock.hide()

    def forget(self) -> None:
        """Show everything again."""
        self.hidden.clear()

    def save(self) -> None:
        """Write down how the panels and the camera stand."""
        self._settings.setValue(f"layout/{mbstudio.__version__}", self._window.saveState())
        names = {name: name in self._docks.sized for name in self._docks.names}
        self._settings.setValue("layout/sized", json.dumps(names))
        hidden = {station: sorted(names) for station, names in self.hidden.items() if names}
        self._settings.setValue("layout/hidden", json.dumps(hidden))
        self.save_camera()

    # ---- camera --------------------------------------------------------------------------------

    def save_camera(self) -> None:
        """Write down from where the project is looked at."""
        path = self._space.project.path
        if path is None or not self._view.has_content:
            return
        cameras = record(self._settings, "layout/cameras")
        cameras.pop(str(path.resolve()), None)
        camera = self._viewport.plotter.camera
        places = [camera.position, camera.focal_point, camera.up]
        cameras[str(path.resolve())] = [list(map(float, place)) for place in places]
        newest = dict(list(cameras.items())[-CAMERAS:])
        self._settings.setValue("layout/cameras", json.dumps(newest))

    def project_opened(self) -> None:
        """Look at the project from where it was looked at last, once it is shown."""
        path = self._space.project.path
        cameras = record(self._settings, "layout/cameras")
        self._wanted = None
        if path is not None and is_on(self._space, "layout/kept"):
            self._wanted = see_from(cameras.get(str(path.resolve())))
        if self._space.state.scan is None:
            self.use_camera()

    def use_camera(self) -> None:
        """Take the remembered camera, after what has just been shown has moved its own."""
        wanted, self._wanted = self._wanted, None
        if wanted is None:
            return

        def move_camera() -> None:
            camera = self._viewport.plotter.camera
            camera.position, camera.focal_point, camera.up = wanted
            self._viewport.plotter.renderer.ResetCameraClippingRange()
            self._viewport.request_render()

        self._deferred.call(move_camera)
