"""The command palette: type a few letters of what you want, press Enter."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent, QKeySequence
from PySide6.QtWidgets import QFrame, QLineEdit, QListWidget, QListWidgetItem, QVBoxLayout, QWidget

from mbstudio.ui.commands import Command, CommandTable
from mbstudio.ui.language import tr


def match(words: str, title: str) -> int | None:
    """Return how badly `words` match a title (0: begins with it), or None if they do not.

    All letters must stand in the title in their order; gaps count against it.
    """
    title, letters = title.lower(), words.lower().replace(" ", "")
    if not letters:
        return 0
    position = title.find(words.lower())
    if position >= 0:
        return position
    at, gaps = -1, 0
    for letter in letters:
        found = title.find(letter, at + 1)
        if found < 0:
            return None
        gaps += found - at - 1
        at = found
    return 100 + gaps


class CommandPalette(QFrame):
    """A list of all commands that can be used now, over the window."""

    def __init__(self, commands: CommandTable, window: QWidget) -> None:
        super().__init__(window)
        self.setObjectName("palette")
        self._commands, self._window = commands, window
        self._search = QLineEdit()
        self._search.setPlaceholderText(tr("What do you want to do?"))
        self._search.setAccessibleName(tr("Search commands"))
        self._list = QListWidget()
        self._list.setAccessibleName(tr("Commands"))
        self._list.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(6, 6, 6, 6)
        layout.addWidget(self._search)
        layout.addWidget(self._list)
        self._search.textChanged.connect(self._fill)
        self._search.returnPressed.connect(self._run)
        self._list.itemClicked.connect(self._run)
        self._search.installEventFilter(self)
        self.hide()

    def open(self) -> None:
        """Show it over the upper middle of the window, ready to type."""
        self._commands.refresh()
        window = self._window
        width = min(560, window.width() - 80)
        self.setGeometry((window.width() - width) // 2, 76, width, min(420, window.height() - 140))
        self._search.clear()
        self._fill("")
        self.show()
        self.raise_()
        self._search.setFocus()

    def titles(self) -> list[str]:
        """Titles in the list, best first."""
        return [self._list.item(index).text() for index in range(self._list.count())]

    def type(self, words: str) -> None:
        """Search for words."""
        self._search.setText(words)

    def _fill(self, words: str) -> None:
        found: list[tuple[int, str, Command]] = []
        for command in self._commands:
            worth = match(words, command.title)
            if worth is not None and self._commands.action(command.id).isEnabled():
                found.append((worth, command.title, command))
        self._list.clear()
        for _, title, command in sorted(found, key=lambda entry: entry[:2]):
            action = self._commands.action(command.id)
            keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
            text = f"{tr(command.menu)}: {title.rstrip('.')}" + (f"    {keys}" if keys else "")
            item = QListWidgetItem(action.icon(), text)
            item.setData(Qt.ItemDataRole.UserRole, command.id)
            self._list.addItem(item)
        self._list.setCurrentRow(0)

    def _run(self) -> None:
        item = self._list.currentItem()
        self.hide()
        if item is not None:
            self._commands.run(item.data(Qt.ItemDataRole.UserRole))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.KeyPress:
            if event.key() == Qt.Key.Key_Escape:
                self.hide()
                return True
            if event.key() in (Qt.Key.Key_Down, Qt.Key.Key_Up) and self._list.count():
                step = 1 if event.key() == Qt.Key.Key_Down else -1
                self._list.setCurrentRow((self._list.currentRow() + step) % self._list.count())
                return True
        if event.type() == QEvent.Type.FocusOut and self.isVisible():
            self.hide()
        return super().eventFilter(watched, event)
