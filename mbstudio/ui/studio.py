"""What every part of the window works with, handed around in place of the window itself."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Protocol

from PySide6.QtCore import QObject, QSettings, Signal, SignalInstance
from PySide6.QtWidgets import QWidget

from mbstudio.ui.commands import CommandTable
from mbstudio.ui.grain_menu import GrainMenu
from mbstudio.ui.icons import Icons
from mbstudio.ui.offers import Offers
from mbstudio.ui.theme import Theme
from mbstudio.ui.viewport.viewport import Viewport
from mbstudio.ui.workers import TaskQueue
from mbstudio.ui.workspace import Workspace

Level = Literal["info", "success", "warning", "error"]


class Messages(Protocol):
    """Where the person is told what happened: one message at a time."""

    shown: SignalInstance
    level: Level

    @property
    def text(self) -> str:
        """The message that is shown, or empty."""

    def say(self, level: Level, text: str, action: str = "", callback: object = None) -> None:
        """Show a message, with a button that calls `callback` if `action` names one."""

    def dismiss(self) -> None:
        """Take the message away."""


class Studio(QObject):
    """The project, what runs on it, and the means to show it.

    Parameters
    ----------
    settings : QSettings
    theme : Theme
    icons : Icons
    messages : Messages
    viewport : Viewport
    host : QWidget
        Owns what is made here, takes the shortcuts, and lies below every dialog.

    Attributes
    ----------
    workspace : Workspace
    queue : TaskQueue
    commands : CommandTable
        Empty until the shell has collected the commands of all parts.
    offers : Offers
        What the stations have for one another.
    grain_menu : GrainMenu
        The menu on grains, the same in every view.
    refresh_asked, docks_asked : signal
        Commands and title, or the docks that are shown, may be out of date.
    station_asked : signal (str)
    grain_asked : signal
        The grain that is looked at is to be brought into the middle of the view.
    hint_given : signal (str)
        Words for the status bar; empty takes them away.
    """

    refresh_asked = Signal()
    docks_asked = Signal()
    station_asked = Signal(str)
    hint_given = Signal(str)
    grain_asked = Signal()

    def __init__(
        self,
        settings: QSettings,
        theme: Theme,
        icons: Icons,
        messages: Messages,
        viewport: Viewport,
        host: QWidget,
    ) -> None:
        super().__init__(host)
        self.settings, self.theme, self.icons = settings, theme, icons
        self.messages, self.viewport, self.host = messages, viewport, host
        self.workspace = Workspace(settings, self)
        self.queue = TaskQueue(self)
        self.commands = CommandTable(icons, host)
        self.offers = Offers(self)
        self.grain_menu = GrainMenu(self.workspace, self.commands, host)

    def say(self, level: Level, text: str, action: str = "", callback: object = None) -> None:
        """Show a message above the view."""
        self.messages.say(level, text, action, callback)

    def give_hint(self, text: str) -> None:
        """Show words in the status bar, or take them away."""
        self.hint_given.emit(text)

    def refresh(self, *_: object) -> None:
        """Bring commands, buttons and the title up to date."""
        self.refresh_asked.emit()

    def arrange_docks(self) -> None:
        """Show the docks that the open station wants now."""
        self.docks_asked.emit()

    def enter(self, station: str) -> None:
        """Go to a station."""
        self.station_asked.emit(station)

    def look_at_grain(self) -> None:
        """Bring the grain that is looked at into the middle of the view."""
        self.grain_asked.emit()

    def path_for(self, name: str = "") -> str:
        """Return where a dialog for files begins: a file of this name in the project's folder."""
        project, recent = self.workspace.project.path, self.workspace.recent
        folder = project.parent if project else (recent[0].parent if recent else Path.home())
        return str(folder / name)
