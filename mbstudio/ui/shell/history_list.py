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
    """One line a change: what holds, where the project stands now, what was undone.

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
        for position, title in enumerate([tr("Beginning"), *history.all_titles]):
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
        self.setCurrentRow(history.position)
        self.scrollToItem(self.currentItem())

    def _choose(self, item: QListWidgetItem) -> None:
        self.chosen.emit(item.data(Qt.ItemDataRole.UserRole))
