"""Shape factors of a grain and its avatar side by side."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem

from mbstudio.core.metrics import FactorIntervals, ShapeFactors
from mbstudio.core.metrics.factor_table import FACTORS, FITTED_FACTORS
from mbstudio.core.units import conversion_factor
from mbstudio.ui.language import mark, tr
from mbstudio.ui.widgets.factor_words import factor_short, factor_tip
from mbstudio.ui.widgets.numbers import four_digits, readable_power_unit

_SHOWN = ("volume", "area", "sphericity", "circularity", "csf", "dn", "ds", "dns")
_HEADS = (mark("Factor"), mark("Grain"), mark("Avatar"), mark("Error"))
_INTERVAL_HEAD = mark("From–to")
_HEIGHT, _DOUBLE_HEIGHT = 26, 42


class FactorsTable(QTableWidget):
    """Eight factors: grain, avatar and the relative error of the avatar."""

    def __init__(self) -> None:
        super().__init__(len(_SHOWN), 4)
        self._grain: ShapeFactors | None = None
        self._avatar: ShapeFactors | None = None
        self._intervals: FactorIntervals | None = None
        self._cells = [[QTableWidgetItem() for _ in range(4)] for _ in _SHOWN]
        self.setAccessibleName(tr("Shape factors of grain and avatar"))
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(_HEIGHT)
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.setShowGrid(False)
        self.setAlternatingRowColors(True)
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setSectionsClickable(False)
        header.setMinimumSectionSize(30)
        header.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        for column in (0, 3):
            header.setSectionResizeMode(column, QHeaderView.ResizeMode.ResizeToContents)
        for column in range(4):
            side = Qt.AlignmentFlag.AlignLeft if column == 0 else Qt.AlignmentFlag.AlignRight
            for row in range(len(_SHOWN)):
                item = self._cells[row][column]
                item.setTextAlignment(side | Qt.AlignmentFlag.AlignVCenter)
                item.setToolTip(factor_tip(_SHOWN[row]))
                self.setItem(row, column, item)
            head = QTableWidgetItem(tr(_HEADS[column]))
            head.setTextAlignment(side | Qt.AlignmentFlag.AlignVCenter)
            self.setHorizontalHeaderItem(column, head)
        self._set_row_height(_HEIGHT)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)

    @property
    def has_grain(self) -> bool:
        """Whether a grain's factors are shown."""
        return self._grain is not None

    @property
    def has_intervals(self) -> bool:
        """Whether the grain's column shows intervals."""
        return self._intervals is not None

    def show_factors(self, grain: ShapeFactors | None, avatar: ShapeFactors | None) -> None:
        """Fill the table; what is None stays empty. Another grain takes its intervals away."""
        if grain != self._grain:
            self._intervals = None
        self._grain, self._avatar = grain, avatar
        self._fill()

    def show_intervals(self, intervals: FactorIntervals | None) -> None:
        """Show between what the grain's factors lie, or again its factors themselves."""
        self._intervals = intervals
        self._fill()

    def _fill(self) -> None:
        grain, avatar = self._grain, self._avatar
        known = grain or avatar
        if head := self.horizontalHeaderItem(1):
            head.setText(tr(_HEADS[1] if self._intervals is None else _INTERVAL_HEAD))
        # From and to stand on lines of their own: there is no room for them side by side.
        mode = QHeaderView.ResizeMode
        self._set_row_height(_HEIGHT if self._intervals is None else _DOUBLE_HEIGHT)
        self.horizontalHeader().setSectionResizeMode(
            1, mode.Stretch if self._intervals is None else mode.ResizeToContents
        )
        for row, name in enumerate(_SHOWN):
            power = FACTORS[name].power
            truth = getattr(grain, name) if grain is not None else None
            value = getattr(avatar, name) if avatar is not None else None
            shown, factor = None, 1.0
            if known is not None and power:
                shown = readable_power_unit(getattr(known, name), known.unit, power)
                factor = conversion_factor(known.unit, shown) ** power
            self._cells[row][0].setText(factor_short(name, shown) + (" *" if name in FITTED_FACTORS else ""))
            self._cells[row][1].setText(self._grain_text(name, truth, factor))
            self._cells[row][2].setText("" if value is None else self._avatar_text(value * factor))
            error = "" if truth is None or value is None else f"{100 * (value - truth) / truth:+.2f}%"
            self._cells[row][3].setText(error)
            self._mark(row, name, value)

    def _grain_text(self, name: str, truth: float | None, factor: float) -> str:
        if truth is None:
            return ""
        if self._intervals is None:
            return four_digits(truth * factor)
        low, high = self._intervals.intervals[name]
        digits = _digits_beside_intervals(low * factor)
        return "–\n".join(f"{bound * factor:#.{digits}g}".rstrip(".") for bound in (low, high))

    def _avatar_text(self, value: float) -> str:
        if self._intervals is None:
            return four_digits(value)
        return f"{value:#.{_digits_beside_intervals(value)}g}".rstrip(".")

    def _set_row_height(self, height: int) -> None:
        for row in range(len(_SHOWN)):
            self.setRowHeight(row, height)
        self.setFixedHeight(height * len(_SHOWN) + 31)

    def _mark(self, row: int, name: str, value: float | None) -> None:
        """Set the error in bold where the avatar lies outside the grain's interval."""
        outside = False
        if self._intervals is not None and value is not None:
            low, high = self._intervals.intervals[name]
            outside = not low <= value <= high
        cell = self._cells[row][3]
        font = cell.font()
        font.setBold(outside)
        cell.setFont(font)
        meaning = factor_tip(name)
        if name in FITTED_FACTORS:
            meaning = tr(
                "{meaning}. * The search fits volume and area, so that this error is small by construction; "
                "it shows no likeness of edges or curvature",
                meaning=meaning,
            )
        if outside:
            meaning = tr("{meaning}. The avatar lies outside the grain's interval.", meaning=meaning)
        cell.setToolTip(meaning)


def _digits_beside_intervals(value: float) -> int:
    """Return how many digits there is room for: leading zeros take that of one."""
    return 4 if value >= 0.01 else 3
