"""The options of a DEM target as a form; spheres are chosen by their number or by what they reach."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QDoubleSpinBox, QSpinBox, QVBoxLayout, QWidget

from mbstudio.core.dem.formats.clump_files import CLUMP_GOAL
from mbstudio.core.dem.target import Target
from mbstudio.core.goals import MOST_PARTS
from mbstudio.core.options import Option
from mbstudio.ui.language import mark, tr
from mbstudio.ui.widgets.forms import empty, row
from mbstudio.ui.widgets.option_fields import make_field, option_title, read_value

# Measure, name, first value, greatest value, step, decimals; values of errors in percent.
_AIMS = (
    ("iou", mark("IoU at least"), 0.95, 0.999, 0.01, 3),
    ("hausdorff", mark("Hausdorff at most"), 3.0, 50.0, 0.5, 2),
    ("volume", mark("Volume error at most"), 1.0, 50.0, 0.5, 2),
    ("inertia", mark("Inertia error at most"), 1.0, 50.0, 0.5, 2),
)
_TIPS = {
    "": mark("Every grain gets this many spheres"),
    "iou": mark(
        "Volume that clump and avatar share, over the volume of their union, with as few spheres as possible"
    ),
    "hausdorff": mark("Largest distance between the two surfaces over Dₙ, with as few spheres as possible"),
    "volume": mark("Error of the clump's volume, with as few spheres as possible"),
    "inertia": mark("Error of the clump's inertia tensor, with as few spheres as possible"),
}


class ClumpChoice(QWidget):
    """How many spheres: a number, or as few as reach a limit.

    Attributes
    ----------
    changed : signal
    """

    changed = Signal()

    def __init__(self, spheres: Option) -> None:
        super().__init__()
        self.by = QComboBox()
        self.by.addItem(tr("A number"), "")
        for measure, title, *_ in _AIMS:
            self.by.addItem(tr(title), measure)
        self.number = QSpinBox()
        self.number.setRange(int(spheres.minimum or 2), int(spheres.maximum or 2000))
        self.number.setValue(int(spheres.default))
        self.limit = QDoubleSpinBox()
        self.most = QSpinBox()
        self.most.setRange(2, 2000)
        self.most.setValue(MOST_PARTS)
        for field in (self.number, self.limit, self.most):
            field.setKeyboardTracking(False)
        self._number_row = row(tr("Spheres in each clump"), self.number, tr(_TIPS[""]))
        self._limit_row = row(tr("Limit"), self.limit, "")
        self._most_row = row(
            tr("Maximum number of spheres"),
            self.most,
            tr("If this many do not reach the goal, the best clump is used"),
        )
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(10)
        by = row(
            tr("Choose spheres by"), self.by, tr("Number of spheres, or the goal for the clump of each grain")
        )
        for part in (
            by,
            self._number_row,
            self._limit_row,
            self._most_row,
        ):
            layout.addWidget(part)
        self.by.currentIndexChanged.connect(self._show_measure)
        for whole in (self.number, self.most):
            whole.valueChanged.connect(lambda _: self.changed.emit())
        self.limit.valueChanged.connect(lambda _: self.changed.emit())
        self._show_measure()

    @property
    def values(self) -> dict[str, Any]:
        """The options ``spheres`` and ``clump_target``."""
        measure = str(self.by.currentData())
        number = self.number.value()
        if not measure:
            return {"spheres": number, CLUMP_GOAL: ""}
        percent = "" if measure == "iou" else " %"
        aim = f"{measure} {self.limit.value():g}{percent}"
        return {"spheres": number, CLUMP_GOAL: f"{aim} and n {self.most.value()}"}

    def aim_at(self, measure: str, limit: float | None = None) -> None:
        """Choose a measure ('' for a number of spheres) and its limit, errors in percent."""
        self.by.setCurrentIndex(max(0, self.by.findData(measure)))
        if limit is not None:
            self.limit.setValue(limit)

    def _show_measure(self) -> None:
        measure = str(self.by.currentData())
        self._number_row.setVisible(not measure)
        self._limit_row.setVisible(bool(measure))
        self._most_row.setVisible(bool(measure))
        for name, _, first, greatest, step, decimals in _AIMS:
            if name == measure:
                self.limit.blockSignals(True)
                self.limit.setDecimals(decimals)
                self.limit.setRange(10**-decimals, greatest)
                self.limit.setSingleStep(step)
                self.limit.setSuffix("" if name == "iou" else " %")
                self.limit.setValue(first)
                self.limit.setToolTip(tr(_TIPS[name]))
                self.limit.blockSignals(False)
        self.changed.emit()


class TargetForm(QWidget):
    """One row for each option of a DEM target.

    Attributes
    ----------
    changed : signal
    """

    changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._layout = QVBoxLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._layout.setSpacing(10)
        self.fields: dict[str, QWidget] = {}
        self.clumps: ClumpChoice | None = None

    def show_target(self, target: Target) -> None:
        """Show the options of a target at their defaults; of spheres what was chosen before."""
        before = None if self.clumps is None else self._chosen_clumps()
        empty(self._layout)
        self.fields, self.clumps = {}, None
        for name, option in target.options.items():
            if name == "spheres" and CLUMP_GOAL in target.options:
                self.clumps = ClumpChoice(option)
                if before is not None:
                    self._choose_clumps(before)
                self.clumps.changed.connect(self.changed)
                self._layout.addWidget(self.clumps)
            elif name != CLUMP_GOAL:
                field = self.fields[name] = make_field(option, self.changed.emit)
                self._layout.addWidget(row(option_title(name), field, option.meaning))
        cells, error = self.fields.get("cells"), self.fields.get("error")
        if isinstance(error, QDoubleSpinBox) and cells is not None:
            error.setSpecialValueText(tr("by the cells"))
            error.valueChanged.connect(lambda value: cells.setEnabled(value == 0))
        self.setVisible(bool(target.options))

    @property
    def values(self) -> dict[str, Any]:
        """A value for every option of the target."""
        given = {name: read_value(field) for name, field in self.fields.items()}
        return given if self.clumps is None else {**self.clumps.values, **given}

    def _chosen_clumps(self) -> Mapping[str, Any]:
        clumps = self.clumps
        assert clumps is not None
        return {
            "by": clumps.by.currentData(), "limit": clumps.limit.value(),
            "number": clumps.number.value(), "most": clumps.most.value(),
        }  # fmt: skip

    def _choose_clumps(self, chosen: Mapping[str, Any]) -> None:
        clumps = self.clumps
        assert clumps is not None
        clumps.aim_at(chosen["by"], chosen["limit"] if chosen["by"] else None)
        clumps.number.setValue(chosen["number"])
        clumps.most.setValue(chosen["most"])
