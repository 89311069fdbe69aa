"""What all panels look like: a title, a scrolling body, and one main action at the foot."""

from __future__ import annotations

from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QFrame, QHBoxLayout, QScrollArea, QToolButton, QVBoxLayout, QWidget

from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label

WIDTH = 344


class Panel(QFrame):
    """The panel of one station."""

    def __init__(self, title: str, subtitle: str) -> None:
        super().__init__()
        self.setObjectName("panel")
        self.setFixedWidth(WIDTH)
        self.setAccessibleName(title)
        outer = QVBoxLayout(self)
        outer.setContentsMargins(0, 0, 0, 0)
        outer.setSpacing(0)
        content = QWidget()
        content.setObjectName("panelBody")
        self.body = QVBoxLayout(content)
        self.body.setContentsMargins(20, 18, 20, 18)
        self.body.setSpacing(10)
        self.help = QToolButton()
        self.help.setToolTip(tr("Open the guide at station {title} (F1)", title=title))
        self.help.setAccessibleName(tr("Guide: {title}", title=title))
        head = QHBoxLayout()
        head.addWidget(label(title, "title"), 1)
        head.addWidget(self.help, 0, Qt.AlignmentFlag.AlignTop)
        self.body.addLayout(head)
        self.body.addWidget(label(subtitle, "subtitle", wrap=True))
        self.body.addSpacing(4)
        self._scroll = scroll = QScrollArea()
        scroll.setWidget(content)
        scroll.setWidgetResizable(True)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        outer.addWidget(scroll, 1)
        foot = QFrame()
        foot.setObjectName("panelFoot")
        self.foot = QVBoxLayout(foot)
        self.foot.setContentsMargins(20, 12, 20, 14)
        self.foot.setSpacing(8)
        outer.addWidget(foot)

    def add(self, *widgets: QWidget) -> None:
        """Put widgets below each other into the body."""
        for widget in widgets:
            self.body.addWidget(widget)

    def scroll_to(self, widget: QWidget) -> None:
        """Bring a widget of the body into sight, once it has its place."""
        QTimer.singleShot(0, self, lambda: self._scroll.ensureWidgetVisible(widget, 0, 12))

    def add_heading(self, text: str) -> None:
        """Begin a group of the body."""
        self.body.addSpacing(8)
        self.body.addWidget(label(text, "heading"))
