"""The bar above the view that moves the faces of the clipping box."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QToolButton
from superqt import QRangeSlider

from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label, quiet_button

STEPS = 1000


class ClipBar(QFrame):
    """Two handles for each of x, y and z.

    Attributes
    ----------
    moved : signal (int, float, float)
        Axis (0, 1, 2) and the shares, 0 to 1, at which its faces are to stand.
    reset : signal
    closed : signal
    """

    moved = Signal(int, float, float)
    reset = Signal()
    closed = Signal()

    def __init__(self, icons: Icons) -> None:
        super().__init__()
        self.setObjectName("dock")
        layout = QHBoxLayout(self)
        layout.setContentsMargins(14, 4, 8, 4)
        layout.setSpacing(8)
        layout.addWidget(label(tr("Clip"), "heading"))
        self.sliders: list[QRangeSlider] = []
        for number, axis in enumerate("xyz"):
            slider = QRangeSlider(Qt.Orientation.Horizontal)
            slider.setRange(0, STEPS)
            slider.setValue((0, STEPS))
            slider.setMinimumWidth(60)
            slider.setToolTip(tr("Show only what lies between these two positions along {axis}", axis=axis))
            slider.setAccessibleName(tr("Clip along {axis}", axis=axis))
            slider.valueChanged.connect(lambda ends, place=number: self._told(place, ends))
            layout.addWidget(label(axis, "key"))
            layout.addWidget(slider, 1)
            self.sliders.append(slider)
        again = quiet_button(tr("Reset"))
        again.setToolTip(tr("Show everything again and keep the clipping box"))
        again.clicked.connect(self.reset)
        layout.addWidget(again)
        close = QToolButton()
        icons.set(close, "ph.x")
        close.setToolTip(tr("Remove the clipping box"))
        close.setAccessibleName(tr("Remove the clipping box"))
        close.clicked.connect(self.closed)
        layout.addWidget(close)

    def show_shares(self, shares: list[tuple[float, float]]) -> None:
        """Move the handles, silently."""
        for slider, (low, high) in zip(self.sliders, shares, strict=True):
            slider.blockSignals(True)
            slider.setValue((round(low * STEPS), round(high * STEPS)))
            slider.blockSignals(False)

    def _told(self, axis: int, ends: tuple[int, int]) -> None:
        self.moved.emit(axis, ends[0] / STEPS, ends[1] / STEPS)
