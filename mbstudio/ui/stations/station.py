"""A station: everything that the shell needs to know of one step of the work."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

from PySide6.QtCore import QObject, Signal

from mbstudio.core.project import ProjectState
from mbstudio.ui.commands import Command
from mbstudio.ui.stations.panel import Panel
from mbstudio.ui.stations.work import Work
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.display import Display
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.widgets.dock_frame import DockFrame


class UndoHistory(Protocol):
    """What undo and redo mean somewhere: the workspace has one, a station may have its own."""

    @property
    def undo_title(self) -> str | None:
        """What undo takes back, in words; None where there is nothing."""

    @property
    def redo_title(self) -> str | None:
        """What redo makes again; None where there is nothing."""

    def undo(self) -> None:
        """Take the last step back."""

    def redo(self) -> None:
        """Make it again."""


@dataclass(frozen=True, eq=False)
class HalfDone:
    """Work that is not in the project yet, and is not to be lost in a crash.

    Attributes
    ----------
    parts : tuple of object
        What it consists of: as long as these are the same objects, nothing has been added.
    join : callable
        Returns the project's state with it.
    """

    parts: tuple[object, ...]
    join: Callable[[ProjectState], ProjectState]


class Station(QObject):
    """One step of the work, from the panel on the left to what undo means there.

    A station makes its panel, works and docks in ``__init__``, tells its commands, and is wired once the
    commands of all stations have their actions. It knows no other station: what they have for one another
    goes through the workspace and ``studio.offers``.

    Parameters
    ----------
    studio : Studio
    view : SceneView

    Attributes
    ----------
    id : str
        Short and stable: settings and tests speak of it.
    title, tip : str
        Marked for translation.
    icon : str
    guide : str
        Heading of the user guide that it is described under.
    menu : str
        Title of its own menu, marked for translation; empty if it has none.
    shortcut : str
        Goes to it; by default Ctrl and its number on the rail.
    borrowed : tuple of str
        Names of other stations' docks that are shown here too.
    panel : Panel
    display : Display
    docks : tuple of DockFrame
    is_open : bool
    arrived : signal
        Work that is half done has come further.
    """

    id: ClassVar[str]
    title: ClassVar[str]
    icon: ClassVar[str]
    tip: ClassVar[str]
    guide: ClassVar[str]
    menu: ClassVar[str] = ""
    shortcut: ClassVar[str] = ""
    borrowed: ClassVar[tuple[str, ...]] = ()

    arrived = Signal()

    panel: Panel
    display: Display

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio)
        self.studio, self.view = studio, view
        self.docks: tuple[DockFrame, ...] = ()
        self.is_open = False

    def relay_messages(self, *works: Work) -> None:
        """Let the person be told what works say."""
        for work in works:
            work.said.connect(self.studio.say)

    def commands(self) -> list[Command]:
        """Return its commands; those of its menu in their order."""
        return []

    def wire(self) -> None:
        """Connect its parts with each other and with the rest, once all commands have their actions."""

    def enter(self) -> None:
        """Do what is to be done when the person comes here; the view shows the station already."""

    def leave(self) -> None:
        """Do what is to be done when the person goes elsewhere."""

    # ---- what the shell asks ---------------------------------------------------------------------

    @property
    def history(self) -> UndoHistory | None:
        """What undo and redo mean here; None: the changes of the project."""
        return None

    def open(self, paths: Sequence[Path]) -> bool:
        """Open files or folders that were given together; return whether they are for this station."""
        return False

    def project_opened(self) -> None:
        """Do what a project that was opened needs."""

    @property
    def half_done(self) -> HalfDone | None:
        """Work that is not in the project yet."""
        return None

    @property
    def has_unsaved_work(self) -> bool:
        """Whether leaving the project now would lose something that is under way."""
        return False

    def stop_and_keep(self) -> bool:
        """End what runs so that its result comes into the project; return whether something did."""
        return False

    def close(self) -> None:
        """Let go of threads and the like: the window closes."""
