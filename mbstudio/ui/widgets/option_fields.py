"""Fields of forms that hold an option and nothing that it refuses, made from its descriptor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtWidgets import QCheckBox, QComboBox, QDoubleSpinBox, QLineEdit, QSpinBox, QWidget

from mbstudio.core.options import Option
from mbstudio.ui.language import mark, tr
from mbstudio.ui.widgets.forms import FIELD

MOST = 2**31 - 1
_TITLES = {
    "adam_share": mark("Adam share"),
    "batch_points": mark("Batch points"),
    "beta1": mark("Beta1"),
    "beta2": mark("Beta2"),
    "binary": mark("Binary files"),
    "blocks_from": mark("In blocks from"),
    "cavities": mark("Cavities"),
    "cells": mark("Cells across"),
    "classes": mark("Sizes in a specimen"),
    "clustering": mark("Clustering"),
    "common_factor": mark("Common factor"),
    "epsilon": mark("Epsilon"),
    "error": mark("Error at most"),
    "generations": mark("Generations"),
    "hours": mark("Hours of the example, at most"),
    "hull": mark("Hull"),
    "hull_points": mark("Hull points"),
    "learning_rate": mark("Learning rate"),
    "least_k": mark("Least k"),
    "momentum": mark("Momentum"),
    "nodes": mark("Surface nodes"),
    "ntry": mark("Monte Carlo points"),
    "padding": mark("Cells around"),
    "parameter": mark("Parameter"),
    "poured": mark("Grains in the example"),
    "radius_offset": mark("Radius offset"),
    "reduction": mark("Reduction"),
    "scaled": mark("Scaled automatically"),
    "shell": mark("Contact mesh, cells"),
    "unit": mark("Unit"),
    "used_up": mark("When used up"),
    "weight": mark("Weight"),
    "working_side": mark("Working side"),
    "zeroed": mark("Zeroed"),
}
_UNITS = {"% of Dₙ": mark("% of Dₙ")}


def option_title(name: str) -> str:
    """Return what an option is called in a form; one that has no title of its own is read from its name."""
    return tr(_TITLES[name]) if name in _TITLES else name.replace("_", " ").capitalize()


def make_field(option: Option, tell: Callable[[], object]) -> QWidget:
    """Return the field of an option at its default; `tell` is called when a person changes it."""
    field: QWidget
    if option.kind is bool:
        field = QCheckBox()
        field.toggled.connect(lambda _: tell())
    elif option.choices:
        field = QComboBox()
        field.addItems(option.choices)
        field.currentIndexChanged.connect(lambda _: tell())
    elif option.kind is int:
        field = QSpinBox()
        low, high = option.minimum, option.maximum
        field.setRange(0 if low is None else int(low), MOST if high is None else int(high))
        field.setKeyboardTracking(False)
        field.valueChanged.connect(lambda _: tell())
    elif option.kind is float and option.step is not None:
        field = _real_field(option, option.step)
        field.valueChanged.connect(lambda _: tell())
    else:
        # A line: these numbers go from 1e-8 to 1, and a spin box shows fixed decimals.
        field = QLineEdit()
        field.setFixedWidth(FIELD)
        field.editingFinished.connect(tell)
    field.blockSignals(True)
    set_value(field, option.default)
    field.blockSignals(False)
    return field


def _real_field(option: Option, step: float) -> QDoubleSpinBox:
    field = QDoubleSpinBox()
    field.setDecimals(2)
    field.setSingleStep(step)
    low, high = option.minimum, option.maximum
    field.setRange(-1e9 if low is None else low, 1e9 if high is None else high)
    field.setKeyboardTracking(False)
    if option.unit:
        field.setSuffix(f" {tr(_UNITS.get(option.unit, option.unit))}")
    return field


def set_value(field: QWidget, value: Any) -> None:
    """Show a value in the field of an option."""
    if isinstance(field, QCheckBox):
        field.setChecked(value)
    elif isinstance(field, QSpinBox | QDoubleSpinBox):
        field.setValue(value)
    elif isinstance(field, QComboBox):
        field.setCurrentText(value)
    elif isinstance(field, QLineEdit):
        field.setText(value if isinstance(value, str) else f"{value!r}")


def read_value(field: QWidget) -> Any:
    """Return the value in the field of an option; of what is typed in, the text."""
    if isinstance(field, QCheckBox):
        return field.isChecked()
    if isinstance(field, QSpinBox | QDoubleSpinBox):
        return field.value()
    if isinstance(field, QComboBox):
        return field.currentText()
    return field.text() if isinstance(field, QLineEdit) else None
