"""Every command of the window in one table: menus, tool bar, buttons, palette and tests read it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from PySide6.QtCore import QObject
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QAbstractButton, QWidget

from mbstudio.ui.deferred_calls import DeferredCalls
from mbstudio.ui.icons import Icons


@dataclass(frozen=True, kw_only=True)
class Command:
    """One thing that the person can tell the program to do.

    Attributes
    ----------
    id : str
        ``station.verb``; stable, for tests and settings.
    title : str
        Imperative, as menus show it; "..." at its end if it asks for more.
    run : callable
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
    visible : callable
        Whether menus and tool bars show it now.
    separated : bool
        Whether a line stands above it in its menu.
    words : callable or None
        What the menus call it now, if that depends on what is chosen; `title` is what it is called in lists.
    is_about_grains : bool
        Whether it acts on the chosen grains: menus on grains offer it.
    """

    id: str
    title: str
    run: Callable[..., object]
    menu: str
    shortcut: str = ""
    icon: str = ""
    tip: str = ""
    enabled: Callable[[], bool] = lambda: True
    checked: Callable[[], bool] | None = None
    visible: Callable[[], bool] = lambda: True
    separated: bool = False
    words: Callable[[], str] | None = None
    is_about_grains: bool = False


class CommandTable(QObject):
    """The commands and their actions.

    Parameters
    ----------
    icons : Icons
    host : QWidget
        Takes the shortcuts.
    """

    def __init__(self, icons: Icons, host: QWidget) -> None:
        super().__init__(host)
        self._icons, self._host = icons, host
        self._commands: dict[str, Command] = {}
        self._actions: dict[str, QAction] = {}
        self._is_outdated = self._is_closed = False
        self._deferred = DeferredCalls(self)

    def add(self, commands: Iterable[Command]) -> None:
        """Take commands in; each gets its action.

        Raises
        ------
        ValueError
            If there is a command of the same id.
        """
        for command in commands:
            if command.id in self._commands:
                raise ValueError(f"There are two commands “{command.id}”.")
            self._commands[command.id] = command
            self._actions[command.id] = self._action_of(command)

    def _action_of(self, command: Command) -> QAction:
        action = QAction(command.title, self._host)
        action.setObjectName(command.id)
        action.setCheckable(command.checked is not None)
        if command.shortcut:
            action.setShortcuts([QKeySequence(keys) for keys in command.shortcut.split("; ")])
        keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
        tip = command.tip or command.title.rstrip(".")
        action.setToolTip(f"{tip} ({keys})" if keys else tip)
        action.setStatusTip(tip)
        if command.icon:
            self._icons.set(action, command.icon)
        if command.checked is None:
            action.triggered.connect(lambda _checked=False, call=command.run: call())
        else:
            action.triggered.connect(lambda checked, call=command.run: call(checked))
        self._host.addAction(action)
        return action

    def __iter__(self) -> Iterator[Command]:
        return iter(self._commands.values())

    def action(self, command_id: str) -> QAction:
        """Return the action of a command, for a menu, a button or a test; as it is to be seen now."""
        self.bring_up_to_date()
        return self._actions[command_id]

    def run(self, command_id: str) -> bool:
        """Trigger a command if it can be used now; return whether it could."""
        self.refresh()
        action = self._actions[command_id]
        if action.isEnabled():
            action.trigger()
            return True
        return False

    def bind(self, button: QAbstractButton, command_id: str) -> None:
        """Let a button do what a command does, be enabled as it is, and explain itself as it does.

        A button of a command that switches something stays pressed while it is switched on. What the button
        itself says of what it does stays: it may know more than the menu.
        """
        action = self._actions[command_id]
        button.setCheckable(action.isCheckable())
        keeps_tip = bool(button.toolTip())

        def follow() -> None:
            button.setEnabled(action.isEnabled())
            button.setChecked(action.isChecked())
            if not keeps_tip:
                button.setToolTip(action.toolTip())

        def press() -> None:
            self.run(command_id)
            self.bring_up_to_date()  # a second press finds what the first one did
            follow()  # the button has switched itself, whether or not the command did anything

        action.changed.connect(follow)
        button.clicked.connect(press)
        follow()

    def outdate(self) -> None:
        """Tell that commands may have changed: they are refreshed once the event loop is free.

        A correction of grains tells of a dozen changes, and each command looks at the project.
        """
        self._is_outdated = True
        self._deferred.call(self.bring_up_to_date)

    def close(self) -> None:
        """Look at nothing any more by itself: what commands ask about is going."""
        self._is_closed = True

    def bring_up_to_date(self) -> None:
        """Refresh if something may have changed since."""
        if self._is_outdated and not self._is_closed:
            self.refresh()

    def refresh(self) -> None:
        """Ask every command whether it can be used now, whether it is switched on and to be seen."""
        self._is_outdated = False
        for command in self:
            action = self._actions[command.id]
            action.setEnabled(command.enabled())
            action.setVisible(command.visible())
            if command.words is not None:
                action.setText(command.words())
            if command.checked is not None:
                action.setChecked(command.checked())
