"""What the window shows before there is a scan: what to do first."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from mbstudio.ui.icons import application_icon
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import empty, label, primary_button, quiet_button

ROOMY = 680  # pixels that all buttons beside each other need
_IN_A_ROW = 4


class Welcome(QFrame):
    """The first page: open a scan, try the sample, or go on with a recent file."""

    recent_chosen = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("welcomePage")
        picture = QLabel()
        picture.setPixmap(application_icon().pixmap(88, 88))
        self.open_button = primary_button(tr("Open a scan…"))
        self.sample_button = QPushButton(tr("Try the sample"))
        self.meshes_button = QPushButton(tr("Open meshes…"))
        self.project_button = QPushButton(tr("Open a project…"))
        content = QWidget()
        content.setMaximumWidth(600)
        layout = QVBoxLayout(content)
        layout.setSpacing(12)
        layout.addWidget(picture)
        layout.addSpacing(4)
        layout.addWidget(label(tr("From a CT scan to particles for DEM"), "welcome", wrap=True))
        layout.addWidget(
            label(
                tr(
                    "Open a stack of X-ray CT slices, find its grains, fit a metaball avatar to each, and "
                    "hand them to your DEM engine. You can also drop a file, a folder of slices or the "
                    "meshes of scanned stones onto this window."
                ),
                "subtitle",
                wrap=True,
            )
        )
        layout.addSpacing(8)
        self._buttons = QGridLayout()
        self._buttons.setSpacing(10)
        self._columns = 0
        self._arrange(_IN_A_ROW)
        line = QHBoxLayout()
        line.addLayout(self._buttons)
        line.addStretch(1)
        layout.addLayout(line)
        self._recovered = QVBoxLayout()
        self._recovered.setSpacing(8)
        layout.addLayout(self._recovered)
        layout.addSpacing(14)
        self._recent_heading = label(tr("Recent"), "heading")
        layout.addWidget(self._recent_heading)
        self._recent = QVBoxLayout()
        self._recent.setSpacing(0)
        layout.addLayout(self._recent)
        outer = QHBoxLayout(self)
        outer.setContentsMargins(40, 30, 40, 30)
        outer.addStretch(1)
        outer.addWidget(content, 10, Qt.AlignmentFlag.AlignVCenter)
        outer.addStretch(1)

    def _arrange(self, columns: int) -> None:
        """Lay the buttons in so many columns."""
        if columns != self._columns:
            self._columns = columns
            buttons = (self.open_button, self.sample_button, self.meshes_button, self.project_button)
            for place, button in enumerate(buttons):
                self._buttons.addWidget(button, place // columns, place % columns)

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._arrange(_IN_A_ROW if self.width() >= ROOMY else _IN_A_ROW // 2)
        super().resizeEvent(event)

    def show_cards(self, cards: Sequence[QWidget]) -> None:
        """Show cards of work to bring back."""
        empty(self._recovered)
        for card in cards:
            self._recovered.addWidget(card)

    def show_recent(self, paths: list[Path]) -> None:
        """List the files opened last."""
        empty(self._recent)
        self._recent_heading.setVisible(bool(paths))
        for path in paths[:5]:
            button = quiet_button(f"{path.name}   –   {path.parent}")
            button.setToolTip(str(path))
            button.clicked.connect(lambda _checked=False, chosen=path: self.recent_chosen.emit(chosen))
            line = QHBoxLayout()
            holder = QWidget()
            holder.setLayout(line)
            line.setContentsMargins(0, 0, 0, 0)
            line.addWidget(button)
            line.addStretch(1)
            self._recent.addWidget(holder)
