"""The small pieces that panels are made of: headings, hints, rows, sliders with their number."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QComboBox,
    QDoubleSpinBox,
    QFrame,
    QHBoxLayout,
    QLabel,
    QLayout,
    QPushButton,
    QScrollArea,
    QSlider,
    QSpinBox,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from mbstudio.ui.language import tr


def label(text: str, role: str, wrap: bool = False) -> QLabel:
    """Return a label in one of the style sheet's roles (title, subtitle, heading, hint, key, ...)."""
    result = QLabel(text)
    result.setObjectName(role)
    result.setWordWrap(wrap)
    if wrap:
        result.setMinimumWidth(10)
    return result


def rule() -> QFrame:
    """Return a thin line between two groups."""
    line = QFrame()
    line.setObjectName("rule")
    return line


def primary_button(text: str) -> QPushButton:
    """Return the one main button of a panel."""
    button = QPushButton(text)
    button.setProperty("primary", "true")
    button.setCursor(Qt.CursorShape.PointingHandCursor)
    return button


def set_primary(button: QPushButton, is_primary: bool) -> None:
    """Make a button the main one of its panel, or one like others."""
    wanted = "true" if is_primary else ""
    if button.property("primary") != wanted:
        button.setProperty("primary", wanted)
        button.style().unpolish(button)
        button.style().polish(button)


def quiet_button(text: str) -> QPushButton:
    """Return a button without a frame, for what is needed seldom."""
    button = QPushButton(text)
    button.setProperty("quiet", "true")
    return button


def badge(kind: str = "quiet") -> QLabel:
    """Return a pill of one or two words; see :func:`set_badge`."""
    pill = QLabel()
    pill.setProperty("badge", kind)
    pill.setAlignment(Qt.AlignmentFlag.AlignCenter)
    return pill


def set_badge(pill: QLabel, text: str, kind: str) -> None:
    """Change text and kind (good, bad, quiet) of a pill."""
    pill.setText(text)
    if pill.property("badge") != kind:
        pill.setProperty("badge", kind)
        pill.style().unpolish(pill)
        pill.style().polish(pill)


FIELD = 150  # pixels: all fields of a form are equally wide


def row(title: str, field: QWidget, tip: str = "", unit: str = "") -> QWidget:
    """Return a line of a form: its name on the left, its field (with its unit) on the right."""
    line = QWidget()
    layout = QHBoxLayout(line)
    layout.setContentsMargins(0, 0, 0, 0)
    name = label(title, "key")
    name.setBuddy(field)
    layout.addWidget(name, 1)
    layout.addWidget(field)
    if isinstance(field, QAbstractSpinBox | QComboBox):
        field.setFixedWidth(FIELD)
    if unit and isinstance(field, QSpinBox | QDoubleSpinBox):
        field.setSuffix(f" {unit}")
    field.setAccessibleName(title)
    for widget in (field, name):
        widget.setToolTip(tip)
    return line


def scrolling(page: QWidget) -> QScrollArea:
    """Return a page that scrolls where it is higher than its room."""
    area = QScrollArea()
    area.setWidget(page)
    area.setWidgetResizable(True)
    page.setObjectName("panelBody")
    return area


def empty(layout: QLayout) -> None:
    """Delete all widgets of a layout."""
    while (item := layout.takeAt(0)) is not None:
        widget = item.widget()
        if widget is not None:
            widget.hide()
            widget.deleteLater()


class NumberSlider(QWidget):
    """A slider over a range of real numbers with its value beside its name.

    Parameters
    ----------
    title : str
    low, high, value : float
    step : float
        Smallest change.
    form : str
        How the value is written, for example ``"{:.0%}"``.
    ends : tuple of str, optional
        Words for the two ends, below the slider.
    """

    value_changed = Signal(float)

    def __init__(
        self,
        title: str,
        low: float,
        high: float,
        value: float,
        step: float = 0.01,
        form: str = "{:.2f}",
        tip: str = "",
        ends: tuple[str, str] | None = None,
    ) -> None:
        super().__init__()
        self._low, self._step, self._form = low, step, form
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setRange(0, round((high - low) / step))
        self.slider.setPageStep(max(1, self.slider.maximum() // 10))
        self.slider.setAccessibleName(title)
        self._shown = label("", "key")
        self._shown.setAlignment(Qt.AlignmentFlag.AlignRight)
        head = QHBoxLayout()
        head.addWidget(label(title, "key"), 1)
        head.addWidget(self._shown)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addLayout(head)
        layout.addWidget(self.slider)
        if ends:
            feet = QHBoxLayout()
            feet.addWidget(label(ends[0], "hint"), 1)
            feet.addWidget(label(ends[1], "hint"))
            layout.addLayout(feet)
        self.setToolTip(tip)
        self.slider.valueChanged.connect(self._moved)
        self.set_value(value)
        self._show()

    @property
    def value(self) -> float:
        return self._low + self.slider.value() * self._step

    def set_value(self, value: float) -> None:
        """Move the slider; `value_changed` tells it if it moved."""
        self.slider.setValue(round((value - self._low) / self._step))

    def _moved(self) -> None:
        self._show()
        self.value_changed.emit(self.value)

    def _show(self) -> None:
        self._shown.setText(self._form.format(self.value))


class SliceSlider(QWidget):
    """Position of one slice: visible or not, slider and number in step."""

    moved = Signal(int)
    switched = Signal(bool)

    def __init__(self, axis: str, colour_tip: str) -> None:
        super().__init__()
        self.axis = axis
        self.eye = QToolButton()
        self.eye.setCheckable(True)
        self.eye.setChecked(True)
        self.eye.setText(axis)
        self.eye.setToolTip(tr("Show the slice across {axis} ({colour} frame)", axis=axis, colour=colour_tip))
        self.eye.setAccessibleName(tr("Show the slice across {axis}", axis=axis))
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setAccessibleName(tr("Slice across {axis}", axis=axis))
        self.number = QSpinBox()
        self.number.setButtonSymbols(QSpinBox.ButtonSymbols.NoButtons)
        self.number.setFixedWidth(58)
        self.number.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.number.setAccessibleName(tr("Number of the slice across {axis}", axis=axis))
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.eye)
        layout.addWidget(self.slider, 1)
        layout.addWidget(self.number)
        self.slider.valueChanged.connect(self.number.setValue)
        self.number.valueChanged.connect(self.slider.setValue)
        self.slider.valueChanged.connect(self.moved)
        self.eye.toggled.connect(self.switched)

    def set_count(self, count: int, index: int) -> None:
        """Take the number of slices and the present one, silently."""
        for field in (self.slider, self.number):
            field.blockSignals(True)
            field.setRange(0, count - 1)
            field.setValue(index)
            field.blockSignals(False)

    def set_index(self, index: int) -> None:
        """Take the slice that is shown, silently."""
        for field in (self.slider, self.number):
            field.blockSignals(True)
            field.setValue(index)
            field.blockSignals(False)
