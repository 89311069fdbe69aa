"""The bar above the flat slices: layout, how grains are drawn over them, and the grey window."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QAction, QResizeEvent
from PySide6.QtWidgets import QBoxLayout, QFrame, QHBoxLayout, QSlider, QToolButton
from superqt import QDoubleRangeSlider

from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label

ROOMY = 480  # pixels: wide enough for one row


class SliceBar(QFrame):
    """Buttons, the opacity of the grains' fill, and the grey values shown black and white.

    Attributes
    ----------
    fill_changed : signal (float)
        Opacity, 0 to 1.
    window_changed : signal (float, float)
        Grey values.
    fill : QSlider
        In percent.
    window_slider : QDoubleRangeSlider
    """

    fill_changed = Signal(float)
    window_changed = Signal(float, float)

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("dock")
        self._rows = QBoxLayout(QBoxLayout.Direction.TopToBottom, self)
        layout = self._rows
        layout.setContentsMargins(8, 2, 8, 4)
        layout.setSpacing(4)
        self._buttons = QHBoxLayout()
        self._buttons.setSpacing(2)
        layout.addLayout(self._buttons)
        self._fill_name = label(tr("Fill"), "key")
        self.fill = QSlider(Qt.Orientation.Horizontal)
        self.fill.setRange(0, 100)
        self.fill.setMinimumWidth(40)
        self.fill.setToolTip(tr("How strongly grains are filled with their colours"))
        self.fill.setAccessibleName(tr("Opacity of the grains"))
        self._buttons.addWidget(self._fill_name)
        self._buttons.addWidget(self.fill, 1)
        greys = QHBoxLayout()
        greys.setSpacing(6)
        self.window_slider = QDoubleRangeSlider(Qt.Orientation.Horizontal)
        self.window_slider.setToolTip(tr("Grey values shown black and white"))
        self.window_slider.setAccessibleName(tr("Grey values shown black and white"))
        self.window_slider.setMinimumWidth(60)
        self._grey_name = label(tr("Grey"), "key")
        greys.addWidget(self._grey_name)
        greys.addWidget(self.window_slider, 1)
        self._greys = greys
        layout.addLayout(greys)
        self.fill.valueChanged.connect(lambda value: self.fill_changed.emit(value / 100))
        self.window_slider.valueChanged.connect(lambda ends: self.window_changed.emit(*ends))

    def resizeEvent(self, event: QResizeEvent) -> None:
        directions = QBoxLayout.Direction
        self._rows.setDirection(directions.LeftToRight if self.width() >= ROOMY else directions.TopToBottom)
        super().resizeEvent(event)

    def add_buttons(self, actions: list[QAction], auto: QAction) -> None:
        """Put buttons of commands before the fill, and the one of the grey window behind its slider."""
        for place, action in enumerate(actions):
            self._buttons.insertWidget(place, _button(action))
        self._greys.addWidget(_button(auto))

    def show_fill(self, opacity: float, has_grains: bool) -> None:
        """Show an opacity, silently; without grains there is nothing to fill."""
        self.fill.blockSignals(True)
        self.fill.setValue(round(100 * opacity))
        self.fill.blockSignals(False)
        for widget in (self.fill, self._fill_name):
            widget.setEnabled(has_grains)

    def show_window(self, low: float, high: float, ends: tuple[float, float] | None) -> None:
        """Show a grey window between the ends that it can have, silently; None where there are no greys."""
        for widget in (self.window_slider, self._grey_name):
            widget.setEnabled(ends is not None)
        if ends is None:
            return
        slider = self.window_slider
        slider.blockSignals(True)
        slider.setRange(min(ends[0], low), max(ends[1], high))
        slider.setValue((low, high))
        slider.blockSignals(False)


def _button(action: QAction) -> QToolButton:
    button = QToolButton()
    button.setDefaultAction(action)
    button.setIconSize(QSize(18, 18))
    button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
    button.setAccessibleName(action.text())
    return button
