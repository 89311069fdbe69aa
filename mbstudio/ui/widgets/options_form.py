"""The options of a fit method as a form that opens on demand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QCheckBox, QComboBox, QLineEdit, QSpinBox, QVBoxLayout, QWidget

from mbstudio.core.errors import FitError
from mbstudio.core.imaging.options import option_notes, plain_options, read_options
from mbstudio.core.imaging.steps import Method
from mbstudio.ui.language import mark, tr
from mbstudio.ui.widgets.forms import FIELD, empty, label, quiet_button, row

MOST = 2**31 - 1
_TITLES = {
    "generations": mark("Generations"),
    "working_side": mark("Working side"),
    "hull_points": mark("Hull points"),
    "cavities": mark("Cavities"),
    "learning_rate": mark("Learning rate"),
    "adam_share": mark("Adam share"),
    "beta1": mark("Beta1"),
    "beta2": mark("Beta2"),
    "epsilon": mark("Epsilon"),
    "momentum": mark("Momentum"),
    "batch_points": mark("Batch points"),
    "weight": mark("Weight"),
    "radius_offset": mark("Radius offset"),
    "common_factor": mark("Common factor"),
    "parameter": mark("Parameter"),
    "least_k": mark("Least k"),
    "reduction": mark("Reduction"),
    "unit": mark("Unit"),
    "hull": mark("Hull"),
    "zeroed": mark("Zeroed"),
    "used_up": mark("Used up"),
    "clustering": mark("Clustering"),
}


class OptionsForm(QWidget):
    """One row for each option of a method; hidden until asked for.

    Attributes
    ----------
    changed : signal (dict)
        The options that are not at their defaults.
    """

    changed = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._method: Method | None = None
        self._shown: tuple[Method, Mapping[str, Any]] | None = None
        self.fields: dict[str, QWidget] = {}
        self.open_button = quiet_button(tr("Options of the method …"))
        self.open_button.setCheckable(True)
        self._refusal = label("", "hint", wrap=True)
        self._refusal.hide()
        self._rows = QWidget()
        self._layout = QVBoxLayout(self._rows)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._rows.hide()
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        for part in (self.open_button, self._rows, self._refusal):
            layout.addWidget(part)
        self.open_button.toggled.connect(self._open)

    def _open(self, opened: bool) -> None:
        if opened and self._shown is not None:
            self.show_options(*self._shown)
        self._rows.setVisible(opened)

    def show_options(self, method: Method, options: Mapping[str, Any]) -> None:
        """Show the options of a method as they stand; those not in `options` at their defaults."""
        self._shown = method, options
        # Built only when it is opened: the methods' modules bring their kernels along.
        if not self.open_button.isChecked():
            return
        known = plain_options(method)
        if method != self._method:
            self._build(method, known)
        for name, (_, default) in known.items():
            field = self.fields[name]
            field.blockSignals(True)
            _set(field, options.get(name, default))
            field.blockSignals(False)
        self._refusal.hide()

    def _build(self, method: Method, known: Mapping[str, tuple[Any, Any]]) -> None:
        empty(self._layout)
        notes = option_notes(method)
        self._method, self.fields = method, {}
        for name, (kind, _) in known.items():
            field = self._field(kind)
            self.fields[name] = field
            tip = f"<p>{notes.get(name, '')}</p>"  # rich text, so that Qt breaks the lines
            plain = name.replace("_", " ").capitalize()
            self._layout.addWidget(row(tr(_TITLES[name]) if name in _TITLES else plain, field, tip))

    def _field(self, kind: Any) -> QWidget:
        if kind is bool:
            switch = QCheckBox()
            switch.toggled.connect(self._tell)
            return switch
        if kind is int:
            number = QSpinBox()
            number.setRange(0, MOST)
            number.setKeyboardTracking(False)
            number.valueChanged.connect(self._tell)
            return number
        if kind is float:
            # A line: these numbers go from 1e-8 to 1, and a spin box shows fixed decimals.
            line = QLineEdit()
            line.setFixedWidth(FIELD)
            line.editingFinished.connect(self._tell)
            return line
        choice = QComboBox()
        choice.addItems(get_args(kind))
        choice.currentIndexChanged.connect(self._tell)
        return choice

    def _tell(self) -> None:
        if self._method is None:
            return
        try:
            options = read_options(
                self._method, [f"{name}={_text(field)}" for name, field in self.fields.items()]
            )
        except FitError as error:
            self._refusal.setText(str(error))
            self._refusal.show()
            return
        self._refusal.hide()
        self.changed.emit(options)


def _set(field: QWidget, value: Any) -> None:
    if isinstance(field, QCheckBox):
        field.setChecked(value)
    elif isinstance(field, QSpinBox):
        field.setValue(value)
    elif isinstance(field, QComboBox):
        field.setCurrentText(value)
    elif isinstance(field, QLineEdit):
        field.setText(f"{value!r}")


def _text(field: QWidget) -> str:
    if isinstance(field, QCheckBox):
        return "yes" if field.isChecked() else "no"
    if isinstance(field, QSpinBox):
        return str(field.value())
    if isinstance(field, QComboBox):
        return field.currentText()
    return field.text() if isinstance(field, QLineEdit) else ""
