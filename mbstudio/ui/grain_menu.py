"""The menu on grains: the same actions in every view, on the grains that are chosen."""

from __future__ import annotations

from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QMenu, QWidget

from mbstudio.ui.commands import CommandTable
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.workspace import Workspace


class GrainMenu:
    """Offers what can be done with the chosen grains.

    Parameters
    ----------
    workspace : Workspace
    commands : CommandTable
        Those that say that they are about grains are offered, in the order of the menus.
    host : QWidget
        Owns the menu while it is open.
    """

    def __init__(self, workspace: Workspace, commands: CommandTable, host: QWidget) -> None:
        self._space, self._commands, self._host = workspace, commands, host

    def open(self, label: int | None, place: QPoint) -> QMenu | None:
        """Show the menu for the grain under the mouse; one that is not chosen yet is chosen first.

        Parameters
        ----------
        label : int or None
            None where there is no grain: the menu is about those that are chosen.
        place : QPoint
            On the screen.

        Returns
        -------
        QMenu or None
            None if no grain is chosen then.
        """
        if label is not None and label not in self._space.chosen:
            self._space.select(label)
        if not self._space.chosen:
            return None
        menu = self.build()
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        menu.popup(place)
        return menu

    def build(self) -> QMenu:
        """Return the menu; its actions are those of the menu bar."""
        self._commands.refresh()
        menu, before = QMenu(self._host), None
        heading = QAction(self._heading(), menu)
        heading.setEnabled(False)
        menu.addAction(heading)
        for command in self._commands:
            if not command.is_about_grains or not command.visible():
                continue
            if command.menu != before or command.separated:
                menu.addSeparator()
            before = command.menu
            menu.addAction(self._commands.action(command.id))
        return menu

    def _heading(self) -> str:
        count, selected = len(self._space.chosen), self._space.selected
        if count == 1 and selected is not None:
            return tr("Grain {label}", label=selected)
        return plural(count, mark("{count} chosen grain"), mark("{count} chosen grains"))
