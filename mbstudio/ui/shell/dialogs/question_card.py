"""A question above the view with some answers. Nothing is blocked by it."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QEvent, Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QApplication, QFrame, QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label, primary_button, quiet_button

CANCEL = "cancel"


class QuestionCard(QFrame):
    """Some answers and Cancel; Esc is Cancel, and the keyboard begins at the first answer.

    Parameters
    ----------
    answers : sequence of (str, str)
        Name of each answer and the text of its button, the recommended one first.

    Attributes
    ----------
    answered : signal (str)
        Name of an answer, or 'cancel'; the card is gone by then.
    buttons : dict of str to QPushButton
    """

    answered = Signal(str)

    def __init__(self, answers: Sequence[tuple[str, str]]) -> None:
        super().__init__()
        self.setObjectName("message")
        self.setProperty("level", "warning")
        self._question, self._told = label("", "heading", wrap=True), label("", "hint", wrap=True)
        self._focused: QWidget | None = None
        self.buttons: dict[str, QPushButton] = {}
        for name, text in answers:
            self.buttons[name] = quiet_button(text) if self.buttons else primary_button(text)
        self.buttons[CANCEL] = quiet_button(tr("Cancel"))
        self.buttons[CANCEL].setToolTip(tr("Keep working (Esc)"))
        words = QVBoxLayout()
        words.setSpacing(2)
        words.addWidget(self._question)
        words.addWidget(self._told)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(16, 9, 12, 9)
        layout.setSpacing(8)
        layout.addLayout(words, 1)
        for name, button in self.buttons.items():
            # Enter presses what has the focus, as in a dialog.
            button.setAutoDefault(True)
            button.clicked.connect(lambda _checked=False, given=name: self._answer(given))
            layout.addWidget(button)
        self.hide()

    @property
    def text(self) -> str:
        """What is asked, or empty."""
        return f"{self._question.text()} {self._told.text()}" if not self.isHidden() else ""

    def ask(self, question: str, told: str) -> None:
        """Show the question; one that is shown already is replaced."""
        if self.isHidden():
            self._focused = QApplication.focusWidget()
        self._question.setText(question)
        self._told.setText(told)
        self.setAccessibleName(question)
        self.setAccessibleDescription(told)
        first = next(iter(self.buttons.values()))
        first.setAccessibleDescription(question)
        self.show()
        first.setFocus(Qt.FocusReason.OtherFocusReason)

    def take_away(self) -> None:
        """Ask no longer; the keyboard goes back to where it was."""
        held = self.isAncestorOf(QApplication.focusWidget() or self.window())
        self.hide()
        if held and self._focused is not None and self._focused.isVisible():
            self._focused.setFocus()
        self._focused = None

    def _answer(self, answer: str) -> None:
        self.take_away()
        self.answered.emit(answer)

    def event(self, event: QEvent) -> bool:
        # Esc is this card's while the keyboard is in it, whatever else Esc is a shortcut of.
        if (
            isinstance(event, QKeyEvent)
            and event.key() == Qt.Key.Key_Escape
            and event.type() in (QEvent.Type.ShortcutOverride, QEvent.Type.KeyPress)
        ):
            event.accept()
            if event.type() == QEvent.Type.KeyPress:
                self._answer(CANCEL)
            return True
        return super().event(event)
