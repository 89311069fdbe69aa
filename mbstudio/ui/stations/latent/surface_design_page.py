"""Asking for a grain by its factors, and adding to it what makes one parent differ from another."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QHBoxLayout,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from mbstudio.core.cloning.surface_studio import SHAPE_FACTORS
from mbstudio.core.units import unit_label
from mbstudio.ui.language import tr
from mbstudio.ui.stations.latent.factor_titles import TITLES, decimals_of
from mbstudio.ui.stations.latent.surface_work import SurfaceWork
from mbstudio.ui.widgets.forms import label, row, rule


class SurfaceDesignPage(QWidget):
    """Factors with a box each, those that are ticked are asked for; below, a difference of two parents.

    Attributes
    ----------
    asked : dict of str to QCheckBox
    values : dict of str to QDoubleSpinBox
    find_button : QPushButton
    plus, minus : QComboBox
    strength : QDoubleSpinBox
    add_button : QPushButton
    """

    def __init__(self, work: SurfaceWork) -> None:
        super().__init__()
        self._work = work
        self.asked = {name: QCheckBox(tr(TITLES[name])) for name in SHAPE_FACTORS}
        self.values = {name: QDoubleSpinBox() for name in SHAPE_FACTORS}
        self.find_button = QPushButton(tr("Find a grain"))
        self.find_button.setToolTip(
            tr("Make a grain with these factors of the parent that is nearest to them (inverse design)")
        )
        self.plus, self.minus = QComboBox(), QComboBox()
        self.strength = QDoubleSpinBox()
        self.strength.setRange(-2.0, 2.0)
        self.strength.setSingleStep(0.1)
        self.strength.setValue(0.5)
        self.add_button = QPushButton(tr("Add the difference"))
        self.add_button.setToolTip(
            tr("Size and roughness change by the ratio of the two parents, the others by their difference")
        )
        self._hint = label("", "hint", wrap=True)
        self._lay_out()
        for name, box in self.asked.items():
            box.toggled.connect(self.values[name].setEnabled)
            box.toggled.connect(lambda _: self._show_ready())
            self.values[name].setEnabled(False)
            self.values[name].setAccessibleName(tr("{title}, value", title=tr(TITLES[name])))
        self.find_button.clicked.connect(self.look_for_it)
        self.add_button.clicked.connect(self.add_difference)
        work.style_taken.connect(self.refresh)
        work.grain_changed.connect(self._follow)
        self.refresh()

    def _lay_out(self) -> None:
        layout = QVBoxLayout(self)
        layout.setContentsMargins(14, 10, 14, 10)
        layout.setSpacing(8)
        layout.addWidget(label(tr("A grain with these factors"), "heading"))
        layout.addWidget(
            label(tr("Tick what matters. What is not ticked comes as the parent has it."), "hint", wrap=True)
        )
        for name, box in self.asked.items():
            line = QHBoxLayout()
            line.addWidget(box, 1)
            line.addWidget(self.values[name])
            self.values[name].setFixedWidth(120)
            layout.addLayout(line)
        layout.addWidget(self.find_button)
        layout.addWidget(self._hint)
        layout.addWidget(rule())
        layout.addWidget(label(tr("Add a difference"), "heading"))
        layout.addWidget(
            label(
                tr("The factors of the grain change as those of the first parent differ from the second's."),
                "hint",
                wrap=True,
            )
        )
        layout.addWidget(row(tr("First parent"), self.plus, tr("Towards this one")))
        layout.addWidget(row(tr("Second parent"), self.minus, tr("Away from this one")))
        layout.addWidget(row(tr("Strength s"), self.strength, tr("How much of the difference is added")))
        layout.addWidget(self.add_button)
        layout.addStretch(1)

    def refresh(self) -> None:
        """Take the parents and ranges of another style."""
        style = self._work.style
        self._show_ready()
        if style is None:
            return
        names = [parent.name for parent in style.parents]
        for place, field in enumerate((self.plus, self.minus)):
            with QSignalBlocker(field):
                field.clear()
                field.addItems(names)
                field.setCurrentIndex(min(place, len(names) - 1))
        for name, (low, middle, high) in self._work.ranges.items():
            box = self.values[name]
            box.setDecimals(decimals_of(name, middle))
            box.setSingleStep((high - low) / 50)
            wide = name in ("size", "roughness")
            box.setRange(10.0 ** -box.decimals(), 100 * high if wide else 1.0)
            box.setSuffix(f" {unit_label(style.unit)}" if name == "size" else "")
            box.setValue(middle)

    def _follow(self) -> None:
        """Show what the grain has, where nothing else is asked for."""
        grain = self._work.at_rest
        if grain is None or grain is not self._work.grain:
            return
        for name, value in grain.values.items():
            if not self.asked[name].isChecked():
                self.values[name].setValue(value)
        self._show_ready()

    def _show_ready(self) -> None:
        ready = self._work.style is not None
        self.find_button.setEnabled(ready and any(box.isChecked() for box in self.asked.values()))
        self.add_button.setEnabled(ready)
        missed = ready and self._work.is_held and self._work.grain is self._work.at_rest
        told = tr("The grain is as near to what was asked for as these surfaces allow.")
        self._hint.setText(told if missed else "")

    @property
    def targets(self) -> dict[str, float]:
        """What is asked for."""
        return {name: self.values[name].value() for name, box in self.asked.items() if box.isChecked()}

    def look_for_it(self) -> None:
        """Find a grain with the factors that are ticked."""
        targets = self.targets
        if targets:
            words = ", ".join(f"{name} {value:.3g}" for name, value in targets.items())
            self._work.find(targets, tr("found: {factors}", factors=words))

    def add_difference(self) -> None:
        """Change the grain as the first parent differs from the second."""
        self._work.add(self.plus.currentIndex(), self.minus.currentIndex(), self.strength.value())
