"""All shortcuts at a glance, over the window; any key or click takes the sheet away."""

from __future__ import annotations

from collections import defaultdict

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent, QKeySequence, QMouseEvent
from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from mbstudio.ui.commands import Command, CommandTable
from mbstudio.ui.language import mark, tr
from mbstudio.ui.widgets.forms import empty, label

COLUMNS = 3
_MOUSE = (
    (mark("Turn the view"), mark("drag")),
    (mark("Move the view"), mark("Shift + drag")),
    (mark("Zoom"), mark("wheel")),
    (mark("Choose a grain"), mark("click")),
    (mark("Add to the selection"), mark("Ctrl + click")),
    (mark("What can be done with grains"), mark("right click")),
)


def shortcuts(commands: CommandTable) -> dict[str, list[tuple[str, str]]]:
    """Return title and keys of every command that has a shortcut, by menu."""
    found: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for command in commands:
        keys = _keys(commands, command)
        if keys:
            found[command.menu].append((command.title.rstrip(".…"), keys))
    return dict(found)


def _keys(commands: CommandTable, command: Command) -> str:
    native = QKeySequence.SequenceFormat.NativeText
    return tr("  or  ").join(keys.toString(native) for keys in commands.action(command.id).shortcuts())


class CheatSheet(QFrame):
    """The sheet itself, a child of the window."""

    def __init__(self, commands: CommandTable, window: QWidget) -> None:
        super().__init__(window)
        self.setObjectName("palette")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setAccessibleName(tr("Keyboard shortcuts"))
        self._commands, self._window = commands, window
        self._content = QVBoxLayout(self)
        self._content.setContentsMargins(26, 20, 26, 20)
        self._content.setSpacing(12)
        window.installEventFilter(self)
        self.hide()

    def open(self) -> None:
        """Show the sheet over the middle of the window."""
        empty(self._content)
        page = QWidget()
        layout = QVBoxLayout(page)
        layout.setContentsMargins(0, 0, 0, 0)
        head = QHBoxLayout()
        head.addWidget(label(tr("Keyboard and mouse"), "title"), 1)
        head.addWidget(label(tr("Any key closes this sheet"), "hint"))
        layout.addLayout(head)
        layout.addSpacing(10)
        columns = QHBoxLayout()
        columns.setSpacing(34)
        for groups in self._columns():
            column = QVBoxLayout()
            column.setSpacing(10)
            for name, entries in groups:
                column.addWidget(_group(name, entries))
            column.addStretch(1)
            columns.addLayout(column)
        layout.addLayout(columns)
        self._content.addWidget(page)
        self._place()
        self.show()
        self.raise_()
        self.setFocus()

    def _columns(self) -> list[list[tuple[str, list[tuple[str, str]]]]]:
        """Deal the groups out so that the columns are about equally long."""
        mouse = [(tr(title), tr(keys)) for title, keys in _MOUSE]
        groups = [*shortcuts(self._commands).items(), (mark("Mouse"), mouse)]
        columns: list[list[tuple[str, list[tuple[str, str]]]]] = [[] for _ in range(COLUMNS)]
        length = [0] * COLUMNS
        for name, entries in sorted(groups, key=lambda group: -len(group[1])):
            place = length.index(min(length))
            columns[place].append((name, entries))
            length[place] += len(entries) + 2
        return columns

    def _place(self) -> None:
        self.adjustSize()
        size = self.sizeHint().boundedTo(self._window.size())
        self.setGeometry(
            (self._window.width() - size.width()) // 2, max(0, (self._window.height() - size.height()) // 2),
            size.width(), size.height(),
        )  # fmt: skip

    def keyPressEvent(self, event: QKeyEvent) -> None:
        self.hide()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self.hide()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize and self.isVisible():
            self._place()
        return super().eventFilter(watched, event)


def _group(name: str, entries: list[tuple[str, str]]) -> QWidget:
    box = QWidget()
    grid = QGridLayout(box)
    grid.setContentsMargins(0, 0, 0, 0)
    grid.setHorizontalSpacing(18)
    grid.setVerticalSpacing(3)
    grid.addWidget(label(tr(name), "heading"), 0, 0, 1, 2)
    for line, (title, keys) in enumerate(entries, 1):
        grid.addWidget(label(title, "key"), line, 0)
        pressed = QLabel(keys)
        pressed.setObjectName("keys")
        grid.addWidget(pressed, line, 1, Qt.AlignmentFlag.AlignRight)
    grid.setColumnStretch(0, 1)
    return box
