"""The stations in their order on the rail. A new one has a folder of its own, and a line here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Signal

from mbstudio.ui.stations.export.station import ExportStation
from mbstudio.ui.stations.fit.station import FitStation
from mbstudio.ui.stations.grains.station import GrainStation
from mbstudio.ui.stations.latent.station import LatentStation
from mbstudio.ui.stations.packing.station import PackingStation
from mbstudio.ui.stations.populations.station import PopulationStation
from mbstudio.ui.stations.scan.station import ScanStation
from mbstudio.ui.stations.station import Station
from mbstudio.ui.stations.style.station import StyleStation
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView

STATIONS: list[type[Station]] = [
    ScanStation,
    GrainStation,
    FitStation,
    PopulationStation,
    StyleStation,
    LatentStation,
    ExportStation,
    PackingStation,
]


class Stations(QObject):
    """All stations, and which one is open. ``stations.fit`` is the one with the id ``fit``.

    Attributes
    ----------
    current : Station
    entered : signal
        Another station is open and its layers are shown; it has not been told yet.
    """

    entered = Signal()

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio)
        self._studio, self._view = studio, view
        self._stations = {kind.id: kind(studio, view) for kind in STATIONS}
        self.current = self.home
        studio.station_asked.connect(self.enter)

    def __iter__(self) -> Iterator[Station]:
        return iter(self._stations.values())

    def __getitem__(self, station: str) -> Station:
        return self._stations[station]

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["_stations"][name]
        except KeyError:
            raise AttributeError(f"There is no station “{name}”.") from None

    @property
    def home(self) -> Station:
        """The first one: where a project begins."""
        return next(iter(self))

    def shortcut_of(self, station: Station) -> str:
        """Return the keys that go to a station."""
        return station.shortcut or f"Ctrl+{list(self).index(station) + 1}"

    def enter(self, station: str) -> None:
        """Go to a station."""
        before, self.current = self.current, self._stations[station]
        before.is_open, self.current.is_open = False, True
        self._view.enter(self.current.display)
        self.entered.emit()
        if before is not self.current:
            before.leave()
            self._studio.give_hint("")  # what was said of the other station
        self.current.enter()
        self._studio.refresh()

    def open(self, paths: Sequence[Path]) -> bool:
        """Open files or folders with the station that knows them; return whether one does."""
        return any(station.open(paths) for station in self)
