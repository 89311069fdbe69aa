"""The changes of the project in their order; a click goes back or forth to one."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QListWidget, QListWidgetItem

from mbstudio.core.project import History
from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.theme import Theme


class HistoryList(QListWidget):
    """One line a change: what was done before the project was opened, what holds, what was undone.

    Attributes
    ----------
    chosen : signal (int)
        How many changes are to hold.
    """

    chosen = Signal(int)

    def __init__(self, theme: Theme, icons: Icons) -> None:
        super().__init__()
        self.setAccessibleName(tr("History of changes"))
        self.setObjectName("history")
        self.setMinimumWidth(230)
        self._theme, self._icons = theme, icons
        self.itemClicked.connect(self._choose)
        self.itemActivated.connect(self._choose)

    def show_history(self, history: History) -> None:
        """Show the changes of a history."""
        faint = QColor(self._theme.tokens.faint)
        self.clear()
        earlier = history.earlier_titles
        for title in earlier:
            item = QListWidgetItem(self._icons.get("ph.check", "faint"), title)
            item.setForeground(faint)
            item.setFlags(Qt.ItemFlag.ItemIsEnabled)
            item.setToolTip(tr("Done before the project was opened; cannot be undone any more"))
            self.addItem(item)
        first = tr("Project as it was opened") if earlier else tr("Beginning")
        for position, title in enumerate([first, *history.all_titles]):
            item = QListWidgetItem(title)
            item.setData(Qt.ItemDataRole.UserRole, position)
            if position > history.position:
                item.setForeground(faint)
                item.setToolTip(tr("Undone; click to redo"))
            elif position == history.position:
                font = item.font()
                font.setBold(True)
                item.setFont(font)
                item.setToolTip(tr("Current state of the project"))
            else:
                item.setToolTip(tr("Click to return to this state"))
            here = position == history.position
            item.setIcon(self._icons.get("ph.caret-right" if here else "ph.minus", "accent"))
            self.addItem(item)
        self.setCurrentRow(len(earlier) + history.position)
        self.scrollToItem(self.currentItem())

    def _choose(self, item: QListWidgetItem) -> None:
        position = item.data(Qt.ItemDataRole.UserRole)
        if position is not None:
            self.chosen.emit(position)
