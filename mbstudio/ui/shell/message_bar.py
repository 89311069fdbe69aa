"""Messages above the view: what happened, why, and what to do. Never a dialog."""

from __future__ import annotations

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QHideEvent
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QSizePolicy, QToolButton

from mbstudio.ui.icons import Icons
from mbstudio.ui.language import mark, tr
from mbstudio.ui.studio import Level

_ICONS = {
    "info": ("ph.info", "info"),
    "success": ("ph.check-circle", "success"),
    "warning": ("ph.warning", "warning"),
    "error": ("ph.warning-octagon", "danger"),
}
_NAMES = {
    "info": mark("info"), "success": mark("success"), "warning": mark("warning"), "error": mark("error"),
}  # fmt: skip
GOOD_NEWS = 8_000  # milliseconds until info and success go by themselves


class MessageBar(QFrame):
    """One line at a time; warnings and errors stay until they are closed or replaced.

    Attributes
    ----------
    shown : signal (str, str)
        Level and text.
    gone : signal
        No message is to be seen any more.
    """

    shown = Signal(str, str)
    gone = Signal()

    def __init__(self, icons: Icons) -> None:
        super().__init__()
        self.setObjectName("message")
        self._icons = icons
        self.level: Level = "info"
        self._picture = QLabel()
        self._text = QLabel()
        self._text.setWordWrap(True)
        self._text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._text.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        self._action = QPushButton()
        self._action.setProperty("quiet", "true")
        close = QToolButton()
        icons.set(close, "ph.x")
        close.setToolTip(tr("Close this message (Esc)"))
        close.setAccessibleName(tr("Close this message"))
        close.clicked.connect(self.dismiss)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(16, 9, 10, 9)
        layout.setSpacing(11)
        layout.addWidget(self._picture, 0, Qt.AlignmentFlag.AlignVCenter)
        layout.addWidget(self._text, 1)
        layout.addWidget(self._action)
        layout.addWidget(close, 0, Qt.AlignmentFlag.AlignVCenter)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self.dismiss)
        self._callback: object = None
        self._action.clicked.connect(self._run_action)
        self.hide()

    @property
    def text(self) -> str:
        """The message that is shown, or empty."""
        return self._text.text() if not self.isHidden() else ""

    def say(self, level: Level, text: str, action: str = "", callback: object = None) -> None:
        """Show a message, with a button that calls `callback` if `action` names one."""
        self.level = level
        self.setProperty("level", level)
        self.style().unpolish(self)
        self.style().polish(self)
        name, colour = _ICONS[level]
        self._picture.setPixmap(self._icons.pixmap(name, 19, colour))
        self._text.setText(text)
        self._action.setText(action)
        self._action.setVisible(bool(action))
        self._callback = callback
        self.setAccessibleName(f"{tr(_NAMES[level])}: {text}")
        self.show()
        if level in ("info", "success"):
            self._timer.start(GOOD_NEWS)
        else:
            self._timer.stop()
        self.shown.emit(level, text)

    def dismiss(self) -> None:
        """Take the message away."""
        self._timer.stop()
        self.hide()

    def hideEvent(self, event: QHideEvent) -> None:
        super().hideEvent(event)
        self.gone.emit()

    def _run_action(self) -> None:
        callback = self._callback
        self.dismiss()
        if callable(callback):
            callback()
