"""Where the docks stand, and which of them are to be seen at the station that is open."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtWidgets import QMainWindow

from mbstudio.ui.stations.registry import Stations
from mbstudio.ui.studio import Studio
from mbstudio.ui.widgets.dock_frame import DockFrame


class Docks(QObject):
    """All docks by their names.

    Parameters
    ----------
    window : QMainWindow
        That they stand in.
    studio : Studio
    stations : Stations
        Each shows its own docks and those that it borrows.
    view_docks : iterable of DockFrame
        Of the view: shown wherever they are wanted.
    free_docks : iterable of DockFrame
        Of no station: they stay as they are wherever one goes.

    Attributes
    ----------
    sized : set of str
        Names of docks that have had their first width.
    arranged : signal
        Those of the station are shown and the others hidden; sizes follow.
    """

    arranged = Signal()

    def __init__(
        self,
        window: QMainWindow,
        studio: Studio,
        stations: Stations,
        view_docks: Iterable[DockFrame],
        free_docks: Iterable[DockFrame],
    ) -> None:
        super().__init__(window)
        self._window, self._stations = window, stations
        self._view_docks, self._free_docks = tuple(view_docks), tuple(free_docks)
        self._station_docks = tuple(dock for station in stations for dock in station.docks)
        self.sized: set[str] = set()
        self._seen: tuple[object, set[str]] = (None, set())
        # Plots need the height more than the table needs the width; the rail reaches down to the status bar.
        window.setCorner(Qt.Corner.BottomRightCorner, Qt.DockWidgetArea.RightDockWidgetArea)
        window.setCorner(Qt.Corner.BottomLeftCorner, Qt.DockWidgetArea.LeftDockWidgetArea)
        for dock in self:
            window.addDockWidget(dock.area, dock)
            if dock.close_button is not None:
                dock.close_button.clicked.connect(studio.refresh)
        for dock in self._free_docks:
            dock.hide()
        studio.docks_asked.connect(self.show)

    def __iter__(self) -> Iterator[DockFrame]:
        return iter((*self._station_docks, *self._view_docks, *self._free_docks))

    def __getitem__(self, name: str) -> DockFrame:
        return next(dock for dock in self if dock.name == name)

    @property
    def names(self) -> list[str]:
        """Names of all docks."""
        return [dock.name for dock in self]

    @property
    def free(self) -> set[str]:
        """Names of the docks that belong to no station."""
        return {dock.name for dock in self._free_docks}

    @property
    def visible(self) -> set[str]:
        """Names of the docks that are not hidden."""
        return {dock.name for dock in self if not dock.isHidden()}

    def show(self) -> None:
        """Show the docks of the station that is open, hide those of the others."""
        station, before = self._stations.current, self._seen
        here = {dock.name for dock in station.docks} | set(station.borrowed)
        for dock in self._station_docks:
            dock.setVisible(dock.name in here and dock.is_wanted())
        for dock in self._view_docks:
            dock.setVisible(dock.is_wanted())
        high = [dock for dock in station.docks if dock.usual_height is not None and not dock.isHidden()]
        if high:
            self._resize(high, [dock.usual_height or 0 for dock in high], Qt.Orientation.Vertical)
        self.arranged.emit()
        for dock in self:
            if dock.first_width is not None and dock.isVisible() and dock.name not in self.sized:
                self.sized.add(dock.name)
                self._resize([dock], [dock.first_width(self._window.width())], Qt.Orientation.Horizontal)
        shared = {dock.name for dock in self if dock.share is not None and dock.isVisible()}
        if before[0] is station and shared - before[1]:
            self.share_width()
        self._seen = (station, shared)

    def share_width(self) -> None:
        """Give the docks beside each other their shares of the width."""
        shared = [dock for dock in self if dock.share is not None]
        self._resize(shared, [dock.share or 0 for dock in shared], Qt.Orientation.Horizontal)

    def take_first_sizes(self) -> None:
        """Give the docks the sizes that they have at the first start."""
        for dock in self:
            if dock.first_height is not None:
                self._resize([dock], [dock.first_height], Qt.Orientation.Vertical)
        self.share_width()

    def _resize(self, docks: list[DockFrame], sizes: list[int], along: Qt.Orientation) -> None:
        self._window.resizeDocks(docks, sizes, along)
