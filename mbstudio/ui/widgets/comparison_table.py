"""Numbers of several populations side by side: one row a quantity, one column a population."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem

from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations import (
    FactorTest,
    Interval,
    Need,
    Population,
    compare,
    moments,
    size_distribution,
)
from mbstudio.core.populations.population import Weighting
from mbstudio.core.populations.sieving import SieveSeries
from mbstudio.core.units import unit_label
from mbstudio.scene.figures.population_style import readable_scale
from mbstudio.ui.language import mark, tr

_ROW = 25

FACTOR_ROWS = (
    (mark("Bodies"), mark("Bodies whose factor could be measured")),
    (mark("Mean"), mark("Mean; by mass, each body is weighted by its volume")),
    (
        mark("Mean from"),
        mark("95 % interval of the mean by drawing the bodies again; none of fewer than ten"),
    ),
    (mark("Mean to"), mark("95 % interval of the mean by drawing the bodies again; none of fewer than ten")),
    (mark("Std. dev."), mark("Sample standard deviation")),
    (
        mark("δ mean"),
        mark("100 |mean − mean of the first| / |mean of the first|: the paper's error of the mean"),
    ),
    (mark("δ std. dev."), mark("The same for the standard deviations")),
    (mark("K-S D"), mark("Kolmogorov–Smirnov: largest distance of the two cumulative distributions")),
    (
        mark("K-S p"),
        mark(
            "Probability of such a D for two independent samples of one distribution. Avatars depend on "
            "their grains, so theirs is too large. Undefined by mass"
        ),
    ),
    (
        mark("p, adjusted"),
        mark(
            "Probability of such a difference by chance, adjusted after Holm for all factors together. "
            "Avatars are "
            "compared with their own grains by signed ranks"
        ),
    ),
    (mark("Wasserstein"), mark("Area between the two cumulative distributions, in the factor's unit")),
)
SIZE_ROWS = (
    ("D10", mark("Effective size: 10 % of the mass is finer")),
    ("D30", mark("30 % of the mass is finer")),
    ("D50", mark("Median size by mass")),
    ("D60", mark("60 % of the mass is finer")),
    ("D90", mark("90 % of the mass is finer")),
    ("C_u", mark("Coefficient of uniformity D60 / D10")),
    ("C_c", mark("Coefficient of curvature D30² / (D10 D60)")),
)
NEED_ROWS = (
    (mark("Mean size"), mark("Mean size by mass; the size is the intermediate axis b")),
    ("D10", mark("Effective size: 10 % of the mass is finer")),
    ("D50", mark("Median size by mass")),
    ("D90", mark("90 % of the mass is finer")),
)
_NAMES = {"grains": mark("grains"), "avatars": mark("avatars"), "clones": mark("clones")}


def name_of(population: Population) -> str:
    """Return what a population is called in the window."""
    return tr(_NAMES[population.name]) if population.name in _NAMES else population.name


class ComparisonTable(QTableWidget):
    """A small table without choice whose height is that of its rows."""

    def __init__(self, name: str, rows: Sequence[tuple[str, str]]) -> None:
        super().__init__(len(rows), 1)
        self._rows = rows
        self.setAccessibleName(name)
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.setShowGrid(False)
        self.setAlternatingRowColors(True)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(_ROW)
        for policy in (self.setHorizontalScrollBarPolicy, self.setVerticalScrollBarPolicy):
            policy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setSectionsClickable(False)
        header.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        self.setFixedHeight(_ROW * len(rows) + 31)

    def fill(self, names: Sequence[str], columns: Sequence[Sequence[str]], units: Sequence[str]) -> None:
        """Show one column a population; `units` stand behind the names of the rows."""
        self.clear()
        self.setColumnCount(1 + len(names))
        self.horizontalHeader().setSectionResizeMode(0, QHeaderView.ResizeMode.ResizeToContents)
        for place, name in enumerate(("", *names)):
            head = QTableWidgetItem(name)
            head.setTextAlignment(_side(place))
            self.setHorizontalHeaderItem(place, head)
        for row, (title, tip) in enumerate(self._rows):
            words = f"{tr(title)} [{units[row]}]" if units[row] else tr(title)
            for place, text in enumerate((words, *(column[row] for column in columns))):
                item = QTableWidgetItem(text)
                item.setToolTip(tr(tip))
                item.setTextAlignment(_side(place))
                self.setItem(row, place, item)

    def text(self, row: str, column: int) -> str:
        """Return what stands in the row of this name."""
        place = [title for title, _ in self._rows].index(row)
        cell = self.item(place, column)
        return "" if cell is None else cell.text()


def fill_factor(
    table: ComparisonTable,
    populations: Sequence[Population],
    factor: str,
    by: Weighting,
    means: Sequence[Interval | None] = (),
    tests: Sequence[FactorTest | None] = (),
) -> None:
    """Show mean and deviation of a factor, and how far each population is from the first."""
    scale, unit = readable_scale(populations, factor)
    shown = FACTORS[factor].unit(unit)
    columns = []
    for place, population in enumerate(populations):
        values = population.values(factor)
        column = [str(len(values))] + ["–"] * (len(FACTOR_ROWS) - 1)
        if len(values):
            mean, deviation = moments(values, population.weights(factor, by))
            column[1], column[4] = _number(scale * mean), _number(scale * deviation)
            interval = means[place] if place < len(means) else None
            if interval is not None:
                column[2:4] = [_number(scale * end) for end in (interval.low, interval.high)]
        found = compare(populations[0], population, [factor], by=by).get(factor) if place else None
        if found is not None:
            column[5:9] = [
                _percent(found.mean_error), _percent(found.deviation_error), f"{found.ks:.3f}",
                "–" if not np.isfinite(found.p) else "< 0.001" if found.p < 0.001 else f"{found.p:.3f}",
            ]  # fmt: skip
            column[10] = _number(scale * found.wasserstein)
            test = tests[place] if place < len(tests) else None
            if test is not None and np.isfinite(test.p_adjusted):
                column[9] = "< 0.001" if test.p_adjusted < 0.001 else f"{test.p_adjusted:.3f}"
        columns.append(column)
    units = ["", shown, shown, shown, shown, "", "", "", "", "", shown]
    table.fill([name_of(population) for population in populations], columns, units)


def fill_sizes(table: ComparisonTable, populations: Sequence[Population], sieves: SieveSeries | None) -> None:
    """Show the sizes of sieve curves, and the coefficients of uniformity and curvature."""
    scale, unit = readable_scale(populations, "intermediate")
    columns = []
    for population in populations:
        curve = size_distribution(population, sieves)
        sizes = [_number(scale * curve.diameter(percent)) for percent in (10, 30, 50, 60, 90)]
        columns.append([*sizes, _number(curve.cu), _number(curve.cc)])
    lengths = [unit_label(unit)] * 5
    table.fill([name_of(population) for population in populations], columns, [*lengths, "", ""])


def fill_needs(table: ComparisonTable, needs: Sequence[Need]) -> None:
    """Show the precision that sizes have, and how many bodies the wanted one needs; dashes without needs."""
    reached, needed = ["–"] * len(NEED_ROWS), ["–"] * len(NEED_ROWS)
    for row, need in enumerate(needs[: len(NEED_ROWS)]):
        width = 100 * need.found.half_width
        reached[row] = f"± {width:.1f} %" if np.isfinite(width) else "–"
        if need.needed is not None:
            needed[row] = f"{need.needed}" + (" ✓" if need.is_enough else "")
    table.fill([tr("reached"), tr("needed")], [reached, needed], [""] * len(NEED_ROWS))


def _side(column: int) -> Qt.AlignmentFlag:
    side = Qt.AlignmentFlag.AlignLeft if column == 0 else Qt.AlignmentFlag.AlignRight
    return side | Qt.AlignmentFlag.AlignVCenter


def _number(value: float) -> str:
    if not np.isfinite(value):
        return "–"
    # Zeros behind the point take the room of digits.
    digits = 4 if abs(value) >= 0.1 else 3 if abs(value) >= 0.01 else 2
    return f"{value:.{digits}g}"


def _percent(value: float) -> str:
    return f"{value:.2f} %" if np.isfinite(value) else "–"
