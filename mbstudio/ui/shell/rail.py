"""The rail on the left: the stations in the order of the work."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtWidgets import QButtonGroup, QFrame, QToolButton, QVBoxLayout

from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.stations.registry import Stations


class Rail(QFrame):
    """One button a station; exactly one is chosen.

    Parameters
    ----------
    stations : Stations
    icons : Icons
    """

    chosen = Signal(str)

    def __init__(self, stations: Stations, icons: Icons) -> None:
        super().__init__()
        self.setObjectName("rail")
        self.setFixedWidth(92)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 10, 0, 10)
        layout.setSpacing(4)
        self._group = QButtonGroup(self)
        self._buttons: dict[str, QToolButton] = {}
        for station in stations:
            button = QToolButton()
            button.setObjectName("station")
            button.setText(tr(station.title))
            button.setToolTip(f"{tr(station.tip)} ({stations.shortcut_of(station)})")
            button.setCheckable(True)
            button.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextUnderIcon)
            button.setIconSize(QSize(25, 25))
            button.setFixedSize(86, 62)
            button.setCursor(Qt.CursorShape.PointingHandCursor)
            button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
            icons.set(button, station.icon)
            button.clicked.connect(lambda _checked=False, name=station.id: self.chosen.emit(name))
            self._group.addButton(button)
            self._buttons[station.id] = button
            layout.addWidget(button, 0, Qt.AlignmentFlag.AlignHCenter)
        layout.addStretch(1)

    def show_chosen(self, station: str) -> None:
        """Mark a station as the present one."""
        self._buttons[station].setChecked(True)
