"""The tour of the first start: five steps on a card that points at what it speaks of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QPoint, Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QFrame, QHBoxLayout, QVBoxLayout, QWidget

from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label, primary_button, quiet_button

WIDTH = 360


@dataclass(frozen=True)
class TourStep:
    """One step: heading, text, and the widget that it speaks of (None: the middle of the window)."""

    title: str
    text: str
    target: Callable[[], QWidget | None]


class TourCard(QFrame):
    """The card, a child of the window; nothing else is blocked by it.

    Attributes
    ----------
    ended : signal
        The last step was left, or the tour was skipped.
    """

    ended = Signal()

    def __init__(self, steps: list[TourStep], window: QWidget) -> None:
        super().__init__(window)
        self.setObjectName("palette")
        self.setFixedWidth(WIDTH)
        self.steps, self._window, self.place = steps, window, 0
        self._title = label("", "title")
        self._text = label("", "subtitle", wrap=True)
        self._count = label("", "hint")
        self.skip = quiet_button(tr("Skip"))
        self.back = quiet_button(tr("Back"))
        self.next = primary_button(tr("Next"))
        self._lines = layout = QVBoxLayout(self)
        layout.setContentsMargins(20, 18, 16, 14)
        layout.setSpacing(8)
        layout.addWidget(self._title)
        layout.addWidget(self._text)
        layout.addSpacing(4)
        foot = QHBoxLayout()
        foot.addWidget(self._count, 1)
        for button in (self.skip, self.back, self.next):
            foot.addWidget(button)
        layout.addLayout(foot)
        self.skip.clicked.connect(self.end)
        self.back.clicked.connect(lambda: self.go_to(self.place - 1))
        self.next.clicked.connect(lambda: self.go_to(self.place + 1))
        self.hide()

    def begin(self) -> None:
        """Show the first step."""
        self.show()
        self.go_to(0)

    def go_to(self, place: int) -> None:
        """Show a step; after the last one the tour ends."""
        if place >= len(self.steps):
            self.end()
            return
        self.place = max(0, place)
        step = self.steps[self.place]
        self._title.setText(step.title)
        self._text.setText(step.text)
        self._count.setText(tr("{place} of {count}", place=self.place + 1, count=len(self.steps)))
        self.back.setVisible(self.place > 0)
        self.next.setText(tr("Done") if self.place == len(self.steps) - 1 else tr("Next"))
        self.setAccessibleName(tr("Tour: {title}", title=step.title))
        self._put_beside(step.target())
        self.raise_()
        self.next.setFocus()

    def end(self) -> None:
        """Take the card away."""
        if not self.isHidden():
            self.hide()
            self.ended.emit()

    def _put_beside(self, target: QWidget | None) -> None:
        height = max(self._lines.heightForWidth(WIDTH), self.sizeHint().height())
        self.resize(WIDTH, height)
        room = self._window.rect()
        if target is None or not target.isVisible():
            self.move((room.width() - WIDTH) // 2, (room.height() - height) // 2)
            return
        corner = target.mapTo(self._window, QPoint(0, 0))
        right = corner.x() + target.width() + 14
        x = right if right + WIDTH < room.width() else corner.x() + (target.width() - WIDTH) // 2
        y = corner.y() + 14 if corner.y() < room.height() // 2 else corner.y() - height - 14
        self.move(min(max(x, 10), room.width() - WIDTH - 10), min(max(y, 10), room.height() - height - 10))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() == Qt.Key.Key_Escape:
            self.end()
        else:
            super().keyPressEvent(event)
