"""Every command of the window in one table: menus, tool bar, palette and tests read it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from PySide6.QtCore import QObject
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QWidget

from mbstudio.ui.icons import Icons


@dataclass(frozen=True)
class Command:
    """One thing that the person can tell the program to do.

    Attributes
    ----------
    id : str
        ``station.verb``; stable, for tests and settings.
    title : str
        Imperative, as menus show it; "..." at its end if it asks for more.
    callback : callable
        Called without arguments, or with the new state if `checked` is given.
    menu : str
        Menu that it stands in, by its English name.
    shortcut : str
        As Qt writes it, several parted by "; "; empty for none.
    icon : str
        Name of an icon, empty for none.
    tip : str
        What it does, in a sentence.
    enabled : callable
        Whether it can be used now.
    checked : callable or None
        State of a command that switches something.
    separated : bool
        Whether a line stands above it in its menu.
    """

    id: str
    title: str
    callback: Callable[..., object]
    menu: str
    shortcut: str = ""
    icon: str = ""
    tip: str = ""
    enabled: Callable[[], bool] = lambda: True
    checked: Callable[[], bool] | None = None
    separated: bool = False


class CommandTable(QObject):
    """The commands and their actions.

    Parameters
    ----------
    commands : list of Command
    icons : Icons
    window : QWidget
        Takes the shortcuts.
    """

    def __init__(self, commands: list[Command], icons: Icons, window: QWidget) -> None:
        super().__init__(window)
        self._commands = {command.id: command for command in commands}
        if len(self._commands) != len(commands):
            raise ValueError("Two commands have the same id.")
        self._actions: dict[str, QAction] = {}
        for command in commands:
            action = QAction(command.title, window)
            action.setObjectName(command.id)
            action.setCheckable(command.checked is not None)
            if command.shortcut:
                action.setShortcuts([QKeySequence(keys) for keys in command.shortcut.split("; ")])
            keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
            tip = command.tip or command.title.rstrip(".")
            action.setToolTip(f"{tip} ({keys})" if keys else tip)
            action.setStatusTip(tip)
            if command.icon:
                icons.set(action, command.icon)
            if command.checked is None:
                action.triggered.connect(lambda _checked=False, call=command.callback: call())
            else:
                action.triggered.connect(lambda checked, call=command.callback: call(checked))
            window.addAction(action)
            self._actions[command.id] = action

    def __iter__(self) -> Iterator[Command]:
        return iter(self._commands.values())

    def action(self, command_id: str) -> QAction:
        """Return the action of a command, for a menu, a button or a test."""
        return self._actions[command_id]

    def run(self, command_id: str) -> bool:
        """Trigger a command if it can be used now; return whether it could."""
        self.refresh()
        action = self._actions[command_id]
        if action.isEnabled():
            action.trigger()
            return True
        return False

    def refresh(self) -> None:
        """Ask every command whether it can be used now, and whether it is switched on."""
        for command in self:
            action = self._actions[command.id]
            action.setEnabled(command.enabled())
            if command.checked is not None:
                action.setChecked(command.checked())
