"""Undo and redo of the whole program: of the station that has a history of its own, else of the project."""

from __future__ import annotations

from mbstudio.ui.stations.registry import Stations
from mbstudio.ui.stations.station import UndoHistory
from mbstudio.ui.workspace import Workspace


class Undo:
    """Asks the open station for its history.

    Parameters
    ----------
    workspace : Workspace
    stations : Stations
    """

    def __init__(self, workspace: Workspace, stations: Stations) -> None:
        self._workspace, self._stations = workspace, stations

    @property
    def history(self) -> UndoHistory:
        """The history that undo and redo go through now."""
        return self._stations.current.history or self._workspace

    @property
    def undo_title(self) -> str | None:
        """What undo takes back now; None where there is nothing."""
        return self.history.undo_title

    @property
    def redo_title(self) -> str | None:
        """What redo makes again now; None where there is nothing."""
        return self.history.redo_title

    def undo(self) -> None:
        """Take the last step back."""
        self.history.undo()

    def redo(self) -> None:
        """Make it again."""
        self.history.redo()
