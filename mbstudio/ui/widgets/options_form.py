"""The options of a fit method as a form that opens on demand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QVBoxLayout, QWidget

from mbstudio.core.errors import FitError
from mbstudio.core.imaging.options import find_options, read_options
from mbstudio.core.imaging.steps import Method
from mbstudio.core.options import Option
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import empty, label, quiet_button, row
from mbstudio.ui.widgets.option_fields import make_field, option_title, read_value, set_value


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
        known = find_options(method).list_options().options
        if method != self._method:
            self._build(method, known)
        for name, option in known.items():
            field = self.fields[name]
            field.blockSignals(True)
            set_value(field, options.get(name, option.default))
            field.blockSignals(False)
        self._refusal.hide()

    def _build(self, method: Method, known: Mapping[str, Option]) -> None:
        empty(self._layout)
        self._method = method
        self.fields = {name: make_field(option, self._tell) for name, option in known.items()}
        for name, field in self.fields.items():
            tip = f"<p>{known[name].meaning}</p>"  # rich text, so that Qt breaks the lines
            self._layout.addWidget(row(option_title(name), field, tip))

    def _tell(self) -> None:
        if self._method is None:
            return
        try:
            options = read_options(
                self._method, [f"{name}={read_value(field)}" for name, field in self.fields.items()]
            )
        except FitError as error:
            self._refusal.setText(str(error))
            self._refusal.show()
            return
        self._refusal.hide()
        self.changed.emit(options)
