"""A specimen as a form: how many particles, their sieve curve, the box; and the curve drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QHBoxLayout,
    QHeaderView,
    QPushButton,
    QSpinBox,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from mbstudio.core.dem.specimen.specimen import SpecimenPlan, target_curve
from mbstudio.core.errors import ExportError
from mbstudio.core.populations.sieving import SizeDistribution
from mbstudio.core.units import conversion_factor, unit_label
from mbstudio.ui.language import tr
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.forms import label, quiet_button, row
from mbstudio.ui.widgets.plots import Plot

_UNITS = ("um", "mm", "cm", "m")
_FIRST = ((0.1, 0.0), (0.2, 35.0), (0.4, 90.0), (0.6, 100.0))
_ROWS = 5  # of the table, seen at once
_ROW = 25


class CurvePlot(Plot):
    """The wanted sieve curve and that of the specimen."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme, tr("Size"), tr("Finer by mass [%]"), tr("Sieve curve of the specimen"))
        self.setFixedHeight(176)
        self.setLogMode(x=True, y=False)
        self.setMouseEnabled(x=False, y=False)
        for side in ("bottom", "left"):
            self.getAxis(side).enableAutoSIPrefix(False)
        self.setYRange(0, 100, padding=0.04)
        self.getAxis("left").setTicks([[(float(share), str(share)) for share in (0, 25, 50, 75, 100)]])
        self._legend = self.getPlotItem().addLegend(offset=(6, 4), labelTextSize="11px")
        self._wanted = self.plot([], [], name=tr("target"), symbol="o", symbolSize=5)
        self._found = self.plot([], [], name=tr("specimen"))
        self.repaint_theme()

    def repaint_theme(self) -> None:
        super().repaint_theme()
        if not hasattr(self, "_wanted"):
            return
        tokens = self._theme.tokens
        self._wanted.setPen(pg.mkPen(tokens.muted, width=1.5, style=Qt.PenStyle.DashLine))
        self._wanted.setSymbolBrush(pg.mkBrush(tokens.muted))
        self._wanted.setSymbolPen(pg.mkPen(None))
        self._found.setPen(pg.mkPen(tokens.accent, width=2))
        self._legend.setLabelTextColor(tokens.muted)
        for _, words in self._legend.items:
            words.setText(words.text)

    def show_curves(self, wanted: SizeDistribution | None, found: SizeDistribution | None) -> None:
        """Draw both curves in the unit of the wanted one, or that of the specimen where none is wanted."""
        shown = wanted or found
        self._legend.setVisible(wanted is not None)
        if shown is None:
            self._wanted.setData([], [])
            self._found.setData([], [])
            return
        self.set_names(tr("Size [{unit}]", unit=unit_label(shown.unit)), tr("Finer by mass [%]"))
        if wanted is None:
            self._wanted.setData([], [])
        else:
            self._wanted.setData(wanted.sizes, wanted.finer)
        low, high = shown.sizes[[0, -1]]
        if low == high:  # of bodies of one size
            low, high = 0.9 * low, 1.1 * high
        self.setXRange(*np.log10([low, high]), padding=0.06)
        ends = [(float(np.log10(size)), f"{size:.3g}") for size in (low, np.sqrt(low * high), high)]
        self.getAxis("bottom").setTicks([ends])
        if found is None:
            self._found.setData([], [])
        else:
            f = conversion_factor(found.unit, shown.unit)
            self._found.setData(np.append(found.sizes[0], found.sizes) * f, np.append(0.0, found.finer))


class SpecimenForm(QWidget):
    """Asks for a specimen.

    Attributes
    ----------
    changed : signal
        Anything, the switch too.
    sizes_asked : signal
        The curve of the avatars themselves, for the table.
    measuring_asked : signal
        The sizes of the avatars that are not known yet.
    """

    changed = Signal()
    sizes_asked = Signal()
    measuring_asked = Signal()

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.switch = QCheckBox(tr("Fill a specimen"))
        self.switch.setToolTip(
            tr(
                "Particles made from the avatars, as they are or scaled to a sieve curve: a table for "
                "every target, and input decks that pour them for LIGGGHTS and LAMMPS"
            )
        )
        self.count = QSpinBox()
        self.count.setRange(1, 1_000_000)
        self.count.setValue(500)
        self.sizes = QComboBox()
        self.sizes.addItem(tr("Of the avatars"), "own")
        self.sizes.addItem(tr("By a curve, scaled"), "curve")
        self.unit = QComboBox()
        for unit in _UNITS:
            self.unit.addItem(unit_label(unit), unit)
        self.unit.setCurrentIndex(1)
        self.width_field = QDoubleSpinBox()
        self.width_field.setRange(0, 1e9)
        self.width_field.setDecimals(3)
        self.width_field.setSpecialValueText(tr("automatic"))
        self.seed = QSpinBox()
        self.seed.setRange(0, 2**31 - 1)
        for field in (self.count, self.width_field, self.seed):
            field.setKeyboardTracking(False)
            field.valueChanged.connect(lambda _: self.changed.emit())
        self.table = self._make_table()
        self.plot = CurvePlot(theme)
        self.summary = label("", "hint", wrap=True)
        self.measure_button = QPushButton(tr("Measure the avatars"))
        self.measure_button.clicked.connect(self.measuring_asked)
        self.measure_button.hide()
        self.refusal = label("", "refusal", wrap=True)
        self._by_hand = self._make_curve()
        self._inside = QWidget()
        inside = QVBoxLayout(self._inside)
        inside.setContentsMargins(0, 0, 0, 0)
        inside.setSpacing(10)
        inside.addWidget(row(tr("Particles"), self.count, tr("Avatars, each as often, randomly rotated")))
        inside.addWidget(
            row(
                tr("Sizes"),
                self.sizes,
                tr("Keep every avatar as large as it is, or scale the avatars to a sieve curve"),
            )
        )
        inside.addWidget(row(tr("Unit"), self.unit, tr("Unit of the curve and of the box width")))
        inside.addWidget(self._by_hand)
        inside.addWidget(self.refusal)
        inside.addWidget(self.plot)
        inside.addWidget(self.summary)
        inside.addWidget(self.measure_button)
        inside.addWidget(
            row(
                tr("Width of the box"),
                self.width_field,
                tr("Width of the insertion box; automatic: about half its height"),
            )
        )
        inside.addWidget(row(tr("Seed"), self.seed, tr("The same seed gives the same specimen")))
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.switch)
        layout.addWidget(self._inside)
        self.switch.toggled.connect(self._inside.setVisible)
        self.switch.toggled.connect(lambda _: self.changed.emit())
        self.unit.currentIndexChanged.connect(lambda _: self._curve_changed())
        self.sizes.currentIndexChanged.connect(lambda _: self._sizes_chosen())
        self.table.itemChanged.connect(lambda _: self._curve_changed())
        self._inside.hide()
        self.set_points([size for size, _ in _FIRST], [finer for _, finer in _FIRST], "mm")

    def _make_curve(self) -> QWidget:
        """Return the table of a curve with the buttons below it; hidden until avatars are to be scaled."""
        more, less, own = (quiet_button(text) for text in (tr("Add"), tr("Remove"), tr("As the avatars")))
        more.setToolTip(tr("Add a row below"))
        less.setToolTip(tr("Remove the row"))
        own.setToolTip(tr("Fill in the sieve curve of all avatars that are exported"))
        more.clicked.connect(self.add_row)
        less.clicked.connect(self.remove_row)
        own.clicked.connect(self.sizes_asked)
        buttons = QHBoxLayout()
        buttons.setSpacing(0)
        for button in (more, less, own):
            buttons.addWidget(button)
        buttons.addStretch(1)
        by_hand = QWidget()
        layout = QVBoxLayout(by_hand)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(10)
        layout.addWidget(self.table)
        layout.addLayout(buttons)
        by_hand.hide()
        return by_hand

    def _make_table(self) -> QTableWidget:
        table = QTableWidget(0, 2)
        table.setAccessibleName(tr("Sieve curve"))
        table.setHorizontalHeaderLabels([tr("Size"), tr("Finer by mass [%]")])
        table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        table.horizontalHeader().setHighlightSections(False)
        table.verticalHeader().hide()
        table.verticalHeader().setDefaultSectionSize(_ROW)
        table.setAlternatingRowColors(True)
        table.setTabKeyNavigation(False)
        table.setFixedHeight(_ROW * _ROWS + 33)
        return table

    # ---- what was chosen -----------------------------------------------------------------------

    @property
    def is_wanted(self) -> bool:
        return self.switch.isChecked()

    def curve(self) -> SizeDistribution:
        """Return the wanted curve; ExportError if the table holds none."""
        rows = []
        for place in range(self.table.rowCount()):
            words = [self._text(place, column) for column in (0, 1)]
            if not any(words):
                continue
            try:
                rows.append([float(word.replace(",", ".")) for word in words])
            except ValueError as error:
                raise ExportError(
                    tr(
                        "Row {row} of the sieve curve contains '{words}'. Enter a size and a percentage.",
                        row=place + 1,
                        words=" ".join(words),
                    )
                ) from error
        sizes, finer = zip(*rows, strict=True) if rows else ((), ())
        return target_curve(sizes, finer, str(self.unit.currentData()))

    def plan(self) -> SpecimenPlan | None:
        """Return the specimen, None where none is wanted; ExportError if what is written is none."""
        if not self.is_wanted:
            return None
        width = self.width_field.value() or None
        return SpecimenPlan(
            self.count.value(),
            self.curve() if self.is_scaled else None,
            self.seed.value(),
            width=width,
            width_unit=self.chosen_unit,
        )

    @property
    def is_scaled(self) -> bool:
        """Whether the avatars are scaled to the curve of the table."""
        return self.sizes.currentData() == "curve"

    @property
    def chosen_unit(self) -> str:
        """Unit of the curve and of the box width."""
        return str(self.unit.currentData())

    def scale(self, scaled: bool) -> None:
        """Choose whether the avatars are scaled."""
        self.sizes.setCurrentIndex(self.sizes.findData("curve" if scaled else "own"))

    def set_points(self, sizes: Sequence[float], finer: Sequence[float], unit: str) -> None:
        """Take over a curve."""
        for field in (self.table, self.unit):
            field.blockSignals(True)
        self.unit.setCurrentIndex(max(0, self.unit.findData(unit)))
        self.table.setRowCount(len(sizes))
        for place, pair in enumerate(zip(sizes, finer, strict=True)):
            for column, value in enumerate(pair):
                self._write(place, column, f"{value:.5g}")
        for field in (self.table, self.unit):
            field.blockSignals(False)
        self._curve_changed()

    # ---- the table -----------------------------------------------------------------------------

    def add_row(self) -> None:
        """Put an empty row below the one that is chosen, or at the end."""
        place = self.table.currentRow() + 1 or self.table.rowCount()
        self.table.blockSignals(True)
        self.table.insertRow(place)
        for column in (0, 1):
            self._write(place, column, "")
        self.table.blockSignals(False)
        self.table.setCurrentCell(place, 0)
        self._curve_changed()

    def remove_row(self) -> None:
        """Take the chosen row away, or the last."""
        place = self.table.currentRow() if self.table.currentRow() >= 0 else self.table.rowCount() - 1
        if place >= 0:
            self.table.removeRow(place)
        self._curve_changed()

    def _text(self, place: int, column: int) -> str:
        item = self.table.item(place, column)
        return "" if item is None else item.text().strip()

    def _write(self, place: int, column: int, text: str) -> None:
        item = QTableWidgetItem(text)
        item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.table.setItem(place, column, item)

    def _curve_changed(self) -> None:
        unit = unit_label(str(self.unit.currentData()))
        self.table.setHorizontalHeaderLabels([tr("Size [{unit}]", unit=unit), tr("Finer by mass [%]")])
        self.width_field.setSuffix(f" {unit}")
        self.changed.emit()

    def _sizes_chosen(self) -> None:
        self._by_hand.setVisible(self.is_scaled)
        self.changed.emit()

    # ---- what came of it -----------------------------------------------------------------------

    def offer_measuring(self, words: str) -> None:
        """Say what measuring the avatars would take, with a button that does it; no words: nothing to do."""
        self.measure_button.setVisible(bool(words))
        if words:
            self.plot.show_curves(None, None)
            self.summary.setText(words)
            self.summary.show()

    def refuse(self, words: str) -> None:
        """Say what is wrong with the curve; nothing hides it."""
        self.refusal.setText(words)
        self.refusal.setVisible(bool(words))
        if words:
            self.plot.show_curves(None, None)
            self.summary.hide()

    def show_result(
        self, wanted: SizeDistribution | None, found: SizeDistribution | None, words: str
    ) -> None:
        """Draw the wanted curve and the specimen's, with its numbers in words."""
        self.plot.show_curves(wanted, found)
        self.summary.setText(words)
        self.summary.setVisible(bool(words))
