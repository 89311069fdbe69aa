"""What mbstudio has said and done: messages and the log, by level."""

from __future__ import annotations

import logging
import time
from collections import deque
from dataclasses import dataclass

from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import (
    QComboBox,
    QFrame,
    QHBoxLayout,
    QListWidget,
    QListWidgetItem,
    QToolButton,
    QVBoxLayout,
)

from mbstudio.ui.icons import Icons
from mbstudio.ui.language import mark, tr
from mbstudio.ui.widgets.forms import label

KEPT = 500  # lines
_LEVELS = {"info": logging.INFO, "success": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}
_SIGNS = {
    logging.DEBUG: ("ph.bug", "faint"),
    logging.INFO: ("ph.info", "info"),
    logging.WARNING: ("ph.warning", "warning"),
    logging.ERROR: ("ph.warning-octagon", "danger"),
}
_CHOICES = (
    (mark("Everything"), logging.DEBUG),
    (mark("Messages"), logging.INFO),
    (mark("Warnings and errors"), logging.WARNING),
    (mark("Errors"), logging.ERROR),
)


@dataclass(frozen=True)
class LogLine:
    """One line of the log: seconds since 1970, level as `logging` numbers it, text."""

    seconds: float
    level: int
    text: str


class LogRecords(QObject):
    """Takes what any thread logs and hands it to the main thread.

    Attributes
    ----------
    came : signal (LogLine)
    """

    came = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        records = self

        class Handler(logging.Handler):
            def emit(self, record: logging.LogRecord) -> None:
                # A signal emitted in another thread reaches the main thread through its event loop.
                records.came.emit(LogLine(record.created, record.levelno, record.getMessage()))

        self._handler = Handler(logging.INFO)
        logging.getLogger("mbstudio").addHandler(self._handler)

    def close(self) -> None:
        """Take no more."""
        logging.getLogger("mbstudio").removeHandler(self._handler)


class LogPanel(QFrame):
    """The lines with a choice of level, to be copied into a report."""

    def __init__(self, icons: Icons) -> None:
        super().__init__()
        self.setObjectName("plots")
        self._icons = icons
        self._lines: deque[LogLine] = deque(maxlen=KEPT)
        self.records = LogRecords(self)
        self.records.came.connect(self.add)
        self.level = QComboBox()
        self.level.setAccessibleName(tr("Level"))
        for words, level in _CHOICES:
            self.level.addItem(tr(words), level)
        self.level.setCurrentIndex(1)
        self.level.currentIndexChanged.connect(lambda _: self._fill())
        self.list = QListWidget()
        self.list.setAccessibleName(tr("Messages and log"))
        self.list.setWordWrap(True)
        self.list.setSelectionMode(QListWidget.SelectionMode.ExtendedSelection)
        copy, clear = QToolButton(), QToolButton()
        for button, icon, words in (
            (copy, "ph.copy", tr("Copy these lines")),
            (clear, "ph.trash", tr("Clear the list (the log file stays)")),
        ):
            icons.set(button, icon)
            button.setToolTip(words)
            button.setAccessibleName(words)
        copy.clicked.connect(lambda: QGuiApplication.clipboard().setText(self.text()))
        clear.clicked.connect(self.clear)
        head = QHBoxLayout()
        head.setContentsMargins(14, 6, 8, 4)
        head.addWidget(label(tr("Show"), "key"))
        head.addWidget(self.level)
        head.addStretch(1)
        head.addWidget(copy)
        head.addWidget(clear)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addLayout(head)
        layout.addWidget(self.list, 1)
        self._fill()

    def say(self, level: str, text: str) -> None:
        """Add a message of the message bar."""
        self.add(LogLine(time.time(), _LEVELS.get(level, logging.INFO), text))

    def add(self, line: LogLine) -> None:
        """Add a line."""
        self._lines.append(line)
        self._fill()

    def clear(self) -> None:
        """Forget all lines."""
        self._lines.clear()
        self._fill()

    def text(self) -> str:
        """Return the lines that are shown, as text."""
        return "\n".join(
            f"{_clock(line)} {logging.getLevelName(line.level).lower()}: {line.text}"
            for line in self._shown()
        )

    def _shown(self) -> list[LogLine]:
        return [line for line in self._lines if line.level >= self.level.currentData()]

    def _fill(self) -> None:
        self.list.clear()
        for line in self._shown():
            icon, colour = _SIGNS[min(max(line.level // 10 * 10, logging.DEBUG), logging.ERROR)]
            self.list.addItem(QListWidgetItem(self._icons.get(icon, colour), f"{_clock(line)}   {line.text}"))
        if not self.list.count():
            item = QListWidgetItem(tr("No messages of this level yet."))
            item.setFlags(Qt.ItemFlag.NoItemFlags)
            self.list.addItem(item)
        self.list.scrollToBottom()


def _clock(line: LogLine) -> str:
    return time.strftime("%H:%M:%S", time.localtime(line.seconds))
