"""The gallery: grains, avatars and clones as pictures, with order and ranges of their factors."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QComboBox,
    QDoubleSpinBox,
    QFrame,
    QHBoxLayout,
    QPushButton,
    QStackedWidget,
    QTabBar,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.ui.icons import Icons
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.gallery.body_list import OWN, Bodies, BodyList, rows_in_order
from mbstudio.ui.widgets.factor_words import factor_heading, factor_title
from mbstudio.ui.widgets.forms import label, quiet_button

KINDS = ("grains", "avatars", "clones")
_TITLES = {"grains": mark("Grains"), "avatars": mark("Avatars"), "clones": mark("Clones")}
_HINTS = {
    "grains": mark("There are no grains yet.\nFind them at station Grains."),
    "avatars": mark("There are no avatars yet.\nFit them at station Fit."),
    "clones": mark("There are no clones yet.\nGenerate them at station Style."),
}


class RangeRow(QWidget):
    """One range: a factor, from, to.

    Attributes
    ----------
    changed : signal
    """

    changed = Signal()

    def __init__(self, bodies: Bodies, icons: Icons) -> None:
        super().__init__()
        self._bodies = bodies
        self.factor = QComboBox()
        self.factor.setAccessibleName(tr("Factor of the range"))
        for name in bodies.columns:
            unit = "" if name in OWN else FACTORS[name].unit(bodies.unit)
            words = tr(OWN[name]) if name in OWN else FACTORS[name].symbol or factor_title(name)
            self.factor.addItem(f"{words} ({unit})" if unit else words, name)
            self.factor.setItemData(
                self.factor.count() - 1, _heading(name, bodies.unit), Qt.ItemDataRole.ToolTipRole
            )
        self.low, self.high = QDoubleSpinBox(), QDoubleSpinBox()
        for field, words in ((self.low, tr("Range from")), (self.high, tr("Range to"))):
            field.setAccessibleName(words)
            field.setButtonSymbols(QDoubleSpinBox.ButtonSymbols.NoButtons)
            field.setFixedWidth(74)
            field.setKeyboardTracking(False)
            field.valueChanged.connect(lambda _: self.changed.emit())
        self.remove = QToolButton()
        icons.set(self.remove, "ph.x")
        self.remove.setToolTip(tr("Remove this range"))
        self.remove.setAccessibleName(tr("Remove this range"))
        layout = QHBoxLayout(self)
        layout.setContentsMargins(14, 0, 8, 4)
        layout.setSpacing(6)
        layout.addWidget(self.factor, 1)
        layout.addWidget(self.low)
        layout.addWidget(label(tr("to"), "key"))
        layout.addWidget(self.high)
        layout.addWidget(self.remove)
        self.factor.currentIndexChanged.connect(lambda _: self._take_factor())
        self._take_factor()

    def _take_factor(self) -> None:
        """Begin with the whole range of the factor."""
        column = self._bodies.columns[self.factor.currentData()]
        known = column[np.isfinite(column)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
        # Four digits of the range; rounded outwards, so that the whole range holds all.
        digits = int(np.clip(4 - np.ceil(np.log10(max(high - low, 1e-9))), 0, 8))
        step = 10.0**-digits
        for field, value in (
            (self.low, np.floor(low / step) * step),
            (self.high, np.ceil(high / step) * step),
        ):
            field.blockSignals(True)
            field.setDecimals(digits)
            field.setRange(np.floor(low / step) * step, np.ceil(high / step) * step)
            field.setValue(value)
            field.blockSignals(False)
        self.changed.emit()

    def range(self) -> tuple[str, float, float]:
        """Return factor, lower and upper end."""
        slack = 0.5 * 10.0 ** -self.low.decimals()
        return self.factor.currentData(), self.low.value() - slack, self.high.value() + slack


def _heading(name: str, unit: str) -> str:
    return tr(OWN[name]) if name in OWN else factor_heading(name, unit)


class Gallery(QFrame):
    """Tabs for the kinds, a line for the order, ranges, and the grid.

    Attributes
    ----------
    kind_changed : signal (str)
        Other bodies are looked at; answer with `show_bodies`.
    measure_asked : signal
        The factors are wanted.
    """

    kind_changed = Signal(str)
    measure_asked = Signal()

    def __init__(self, icons: Icons) -> None:
        super().__init__()
        self.setObjectName("plots")
        self.setMinimumWidth(360)
        self._icons = icons
        self.bodies: Bodies | None = None
        self.ranges: list[RangeRow] = []
        self.tabs = QTabBar()
        self.tabs.setExpanding(False)
        self.tabs.setDrawBase(False)
        self.tabs.setAccessibleName(tr("Kind of bodies"))
        for kind in KINDS:
            self.tabs.addTab(tr(_TITLES[kind]))
        self.sort = QComboBox()
        self.sort.setAccessibleName(tr("Order by"))
        self.falling = QToolButton()
        self.falling.setCheckable(True)
        icons.set(self.falling, "ph.sort-descending")
        self.falling.setToolTip(tr("Largest first"))
        self.falling.setAccessibleName(tr("Largest first"))
        self.add = QToolButton()
        icons.set(self.add, "ph.funnel")
        self.add.setToolTip(tr("Show only bodies with a factor in a range"))
        self.add.setAccessibleName(tr("Add a range"))
        self.all = QToolButton()
        icons.set(self.all, "ph.selection-all")
        self.all.setToolTip(tr("Select all bodies shown, also in the table, the plots and the view"))
        self.all.setAccessibleName(tr("Select all that are shown"))
        self.list = BodyList()
        self._hint = label("", "emptyPlot", wrap=True)
        self._hint.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._pages = QStackedWidget()
        self._pages.addWidget(self.list)
        self._pages.addWidget(self._hint)
        self._count = label("", "hint")
        self.measure: QPushButton = quiet_button(tr("Measure more factors"))
        self.measure.setToolTip(
            tr("Measure the shape factors of grains and avatars, to order and filter by them")
        )
        self._lay_out()
        self.tabs.currentChanged.connect(lambda _: self.kind_changed.emit(self.kind))
        self.sort.currentIndexChanged.connect(lambda _: self._arrange())
        self.falling.toggled.connect(lambda _: self._arrange())
        self.add.clicked.connect(self.add_range)
        self.all.clicked.connect(lambda: self.list.selectAll())
        self.measure.clicked.connect(self.measure_asked)

    def _lay_out(self) -> None:
        line = QHBoxLayout()
        line.setContentsMargins(14, 6, 8, 6)
        line.setSpacing(6)
        line.addWidget(label(tr("Order by"), "key"))
        line.addWidget(self.sort, 1)
        for button in (self.falling, self.add, self.all):
            line.addWidget(button)
        self._range_lines = QVBoxLayout()
        self._range_lines.setSpacing(0)
        foot = QHBoxLayout()
        foot.setContentsMargins(14, 2, 8, 4)
        foot.addWidget(self._count, 1)
        foot.addWidget(self.measure)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.tabs)
        layout.addLayout(line)
        layout.addLayout(self._range_lines)
        layout.addWidget(self._pages, 1)
        layout.addLayout(foot)

    @property
    def kind(self) -> str:
        """The kind that is looked at."""
        return KINDS[self.tabs.currentIndex()]

    def set_counts(self, counts: dict[str, int]) -> None:
        """Say how many of each kind there are."""
        for place, kind in enumerate(KINDS):
            count = counts.get(kind, 0)
            title = tr(_TITLES[kind])
            self.tabs.setTabText(place, f"{title} ({count:,})" if count else title)

    def show_bodies(self, bodies: Bodies | None) -> None:
        """Show other bodies; order and ranges stay where they still mean something."""
        before = [row.range() for row in self.ranges]
        same_kind = self.bodies is not None and bodies is not None and self.bodies.kind == bodies.kind
        for row in list(self.ranges):
            self._remove(row)
        self.bodies = bodies
        sort = self.sort.currentData()
        self.sort.blockSignals(True)
        self.sort.clear()
        self.sort.addItem(tr("Number"), "")
        for name in () if bodies is None else bodies.columns:
            self.sort.addItem(_heading(name, bodies.unit), name)  # type: ignore[union-attr]
        self.sort.setCurrentIndex(max(0, self.sort.findData(sort)))
        self.sort.blockSignals(False)
        for factor, low, high in before if same_kind else ():
            if bodies is not None and factor in bodies.columns:
                row = self.add_range()
                row.factor.setCurrentIndex(row.factor.findData(factor))
                row.low.setValue(low)
                row.high.setValue(high)
        there = bodies is not None and len(bodies.keys) > 0
        for widget in (self.sort, self.falling, self.add, self.all):
            widget.setEnabled(there)
        # Bodies of which nothing was measured have no factor that a range could be of.
        self.add.setEnabled(there and bodies is not None and bool(bodies.columns))
        self.measure.setVisible(there and bodies is not None and "sphericity" not in bodies.columns)
        self._arrange()

    def add_range(self) -> RangeRow:
        """Add a range, at first of all values that there are."""
        assert self.bodies is not None
        row = RangeRow(self.bodies, self._icons)
        row.changed.connect(self._arrange)
        row.remove.clicked.connect(lambda: self._remove(row))
        self.ranges.append(row)
        self._range_lines.addWidget(row)
        return row

    def _remove(self, row: RangeRow) -> None:
        self.ranges.remove(row)
        self._range_lines.removeWidget(row)
        row.hide()
        row.deleteLater()
        self._arrange()

    def _arrange(self) -> None:
        bodies = self.bodies
        if bodies is None or not len(bodies.keys):
            self.list.show_bodies(None, np.zeros(0, dtype=int), "")
            self._hint.setText(tr(_HINTS[self.kind]))
            self._pages.setCurrentIndex(1)
            self._count.setText("")
            return
        chosen = self.list.chosen_keys()
        sort = self.sort.currentData() or ""
        rows = rows_in_order(bodies, [row.range() for row in self.ranges], sort, self.falling.isChecked())
        self.list.show_bodies(bodies, rows, sort)
        self.list.select_keys(chosen, None)
        self._hint.setText(tr("No body lies in these ranges."))
        self._pages.setCurrentIndex(0 if len(rows) else 1)
        count = len(bodies.keys)
        self._count.setText(
            tr("{shown:,} of {count:,}", shown=len(rows), count=count) if len(rows) != count else f"{count:,}"
        )
