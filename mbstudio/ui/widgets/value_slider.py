"""A slider with its name, a box for its value, a lock, and words below: double click leads to zero."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QEvent, QRect, Qt, Signal
from PySide6.QtGui import QColor, QHideEvent, QMouseEvent, QPainter, QPaintEvent
from PySide6.QtWidgets import (
    QDoubleSpinBox,
    QGridLayout,
    QSlider,
    QStyle,
    QStyleOptionSlider,
    QToolButton,
    QWidget,
)

from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label

STEPS = 1000


class DragSlider(QSlider):
    """A slider whose handle comes to where it is pressed, and stays under the hand.

    Attributes
    ----------
    zero_asked : signal
        A double click.
    """

    zero_asked = Signal()

    def __init__(self) -> None:
        super().__init__(Qt.Orientation.Horizontal)
        self.setRange(0, STEPS)
        self.setPageStep(STEPS // 20)
        self.setSingleStep(STEPS // 100)
        self.zero: float | None = None
        self._grip = 0.0

    def _handle(self) -> QRect:
        option = QStyleOptionSlider()
        self.initStyleOption(option)
        part = QStyle.SubControl.SC_SliderHandle
        return self.style().subControlRect(QStyle.ComplexControl.CC_Slider, option, part, self)

    def _value_at(self, x: float) -> int:
        wide = self._handle().width()
        return QStyle.sliderValueFromPosition(0, STEPS, round(x - wide / 2), self.width() - wide)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() != Qt.MouseButton.LeftButton:
            event.ignore()
            return
        handle, x = self._handle(), event.position().x()
        on_it = handle.left() <= x <= handle.right()
        # Pressed beside its middle, the handle stays where it is.
        self._grip = x - handle.center().x() if on_it else 0.0
        self.setSliderDown(True)
        if not on_it:
            self.setSliderPosition(self._value_at(x))

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self.isSliderDown():
            self.setSliderPosition(self._value_at(event.position().x() - self._grip))

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton and self.isSliderDown():
            self.setSliderDown(False)

    def hideEvent(self, event: QHideEvent) -> None:
        """Let go: a hand whose panel was closed sends no more events."""
        self.setSliderDown(False)
        super().hideEvent(event)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.EnabledChange and not self.isEnabled():
            self.setSliderDown(False)
        super().changeEvent(event)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        self.zero_asked.emit()

    def paintEvent(self, event: QPaintEvent) -> None:
        if self.zero is not None:
            painter = QPainter(self)
            x = round(7 + self.zero * (self.width() - 14))
            painter.fillRect(x - 1, self.height() // 2 - 7, 2, 14, QColor(self.palette().mid().color()))
            painter.end()
        super().paintEvent(event)


class ValueSlider(QWidget):
    """One number: as a slider, and as a box in the units that people read.

    Parameters
    ----------
    title : str
    icons : Icons
    tip : str
    unit : str

    Attributes
    ----------
    moved : signal (float)
        While the slider is being dragged.
    settled : signal (float)
        A new value: the slider was let go, or the box or the keyboard was used.
    lock_changed : signal (bool)
    """

    moved = Signal(float)
    settled = Signal(float)
    lock_changed = Signal(bool)

    def __init__(self, title: str, icons: Icons, tip: str = "", unit: str = "", lock: bool = True) -> None:
        super().__init__()
        self.title = title
        self._low, self._high, self._zero, self._value = 0.0, 1.0, 0.0, 0.0
        self._least, self._most = 0.0, 1.0
        self._dragged = False
        self._read: Callable[[float], float] = float
        self._write: Callable[[float], float] = float
        self.slider, self.box, self.lock = DragSlider(), QDoubleSpinBox(), QToolButton()
        self.slider.setAccessibleName(title)
        self.box.setAccessibleName(tr("{title}, value", title=title))
        self.box.setButtonSymbols(QDoubleSpinBox.ButtonSymbols.NoButtons)
        self.box.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.box.setKeyboardTracking(False)
        self.box.setFixedWidth(92)
        self.box.setSuffix(f" {unit}" if unit else "")
        self.lock.setCheckable(True)
        self.lock.setToolTip(tr("Lock: noise and Randomise leave “{title}” unchanged", title=title))
        self.lock.setAccessibleName(tr("Lock {title}", title=title))
        if not lock:  # shown before it has a parent it would be a window of its own
            self.lock.hide()
        icons.set(self.lock, "ph.lock-simple-open")
        self.lock.toggled.connect(
            lambda on: icons.set(
                self.lock, "ph.lock-simple-fill" if on else "ph.lock-simple-open", "accent" if on else "muted"
            )
        )
        self._name = label(title, "key")
        self._words = label("", "hint")
        layout = QGridLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setHorizontalSpacing(6)
        layout.setVerticalSpacing(0)
        layout.addWidget(self._name, 0, 0)
        layout.addWidget(self._words, 0, 1, 1, 3, Qt.AlignmentFlag.AlignRight)
        layout.addWidget(self.slider, 1, 0, 1, 2)
        layout.addWidget(self.box, 1, 2)
        layout.addWidget(self.lock, 1, 3)
        layout.setColumnStretch(1, 1)
        middle = tr("Double-click to return to the middle.")
        for widget in (self._name, self.slider):
            widget.setToolTip(f"{tip}\n{middle}".strip())
        self.slider.valueChanged.connect(self._slid)
        self.slider.sliderReleased.connect(self._released)
        self.slider.zero_asked.connect(lambda: self._settle(self._zero))
        self.box.valueChanged.connect(lambda shown: self._settle(self._write(shown)))
        self.lock.toggled.connect(self.lock_changed)

    def set_range(
        self,
        low: float,
        high: float,
        zero: float,
        *,
        read: Callable[[float], float] = float,
        write: Callable[[float], float] = float,
        decimals: int = 3,
        beyond: float = 0.0,
    ) -> None:
        """Take a range, its middle, and how values are written in the box and read from it.

        In the box values may be written that lie beyond the slider's range by the share `beyond` of it.
        """
        self._low, self._high, self._zero = low, max(high, low + 1e-9), zero
        self._read, self._write = read, write
        self.slider.zero = (zero - self._low) / (self._high - self._low)
        self.box.blockSignals(True)
        self.box.setDecimals(decimals)
        more = beyond * (self._high - self._low)
        self._least, self._most = self._low - more, self._high + more
        ends = sorted((read(self._least), read(self._most)))
        self.box.setRange(*ends)
        self.box.setSingleStep(abs(read(self._high) - read(self._low)) / 50)
        self.box.blockSignals(False)
        self.slider.update()

    @property
    def value(self) -> float:
        return self._value

    def set_value(self, value: float, words: str = "") -> None:
        """Show a value, silently; the handle stays under a hand that holds it."""
        self._words.setText(words)
        self._show_in_box(value)
        if not self.slider.isSliderDown():
            self._value = value
            self.slider.blockSignals(True)
            self.slider.setValue(round(STEPS * (value - self._low) / (self._high - self._low)))
            self.slider.blockSignals(False)

    def set_amber(self, amber: bool) -> None:
        """Show that the value was held at the edge of what is reasonable."""
        state = "true" if amber else "false"
        for widget in (self.box, self.slider):
            if widget.property("amber") != state:
                widget.setProperty("amber", state)
                widget.style().unpolish(widget)
                widget.style().polish(widget)

    def _show_in_box(self, value: float) -> None:
        if not self.box.hasFocus() or self.slider.isSliderDown():
            self.box.blockSignals(True)
            self.box.setValue(self._read(value))
            self.box.blockSignals(False)

    def _slid(self, place: int) -> None:
        self._value = self._low + (self._high - self._low) * place / STEPS
        self._show_in_box(self._value)
        if self.slider.isSliderDown():
            self._dragged = True
            self.moved.emit(self._value)
        else:
            self.settled.emit(self._value)

    def _released(self) -> None:
        if self._dragged:
            self._dragged = False
            self.settled.emit(self._value)

    def _settle(self, value: float) -> None:
        value = min(max(value, self._least), self._most)
        self.slider.blockSignals(True)
        self.slider.setValue(round(STEPS * (value - self._low) / (self._high - self._low)))
        self.slider.blockSignals(False)
        self._value = value
        self._show_in_box(value)
        self.settled.emit(value)
