"""Shape factors of a grain and its avatar side by side."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem

from mbstudio.core.metrics import ShapeFactors
from mbstudio.core.units import conversion_factor, unit_label
from mbstudio.ui.widgets.numbers import readable_power_unit

# Attribute, sign, power of the unit, what it is.
_ROWS = (
    ("volume", "V", 3, "Volume"),
    ("area", "A", 2, "Surface area"),
    ("sphericity", "Sphericity", 0, "π^(1/3) (6V)^(2/3) / A"),
    ("circularity", "Circularity", 0, "π D_s / P_p, with P_p the perimeter of the maximum projection"),
    ("csf", "CSF", 0, "Corey shape factor L_s / √(L_i L_l)"),
    ("dn", "D_n", 1, "Nominal diameter (6V/π)^(1/3)"),
    ("ds", "D_s", 1, "Diameter of the circle with the maximum projected area A_p: √(4 A_p/π)"),
    ("dns", "D_ns", 0, "D_n / D_s"),
)
_HEADS = ("Factor", "Grain", "Avatar", "Error")
_POWERS = {1: "", 2: "²", 3: "³"}


class FactorsTable(QTableWidget):
    """Eight factors: grain, avatar and the relative error of the avatar."""

    def __init__(self) -> None:
        super().__init__(len(_ROWS), 4)
        self._cells = [[QTableWidgetItem() for _ in range(4)] for _ in _ROWS]
        self.setAccessibleName("Shape factors of grain and avatar")
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(26)
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
            for row in range(len(_ROWS)):
                item = self._cells[row][column]
                item.setTextAlignment(side | Qt.AlignmentFlag.AlignVCenter)
                item.setToolTip(_ROWS[row][3])
                self.setItem(row, column, item)
            head = QTableWidgetItem(_HEADS[column])
            head.setTextAlignment(side | Qt.AlignmentFlag.AlignVCenter)
            self.setHorizontalHeaderItem(column, head)
        self.setFixedHeight(26 * len(_ROWS) + 31)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)

    def show_factors(self, grain: ShapeFactors | None, avatar: ShapeFactors | None) -> None:
        """Fill the table; what is None stays empty."""
        known = grain or avatar
        for row, (name, sign, power, _) in enumerate(_ROWS):
            truth = getattr(grain, name) if grain is not None else None
            value = getattr(avatar, name) if avatar is not None else None
            unit, factor = "", 1.0
            if known is not None and power:
                shown = readable_power_unit(getattr(known, name), known.unit, power)
                unit = f" [{unit_label(shown)}{_POWERS[power]}]"
                factor = conversion_factor(known.unit, shown) ** power
            self._cells[row][0].setText(sign + unit)
            self._cells[row][1].setText("" if truth is None else f"{truth * factor:#.4g}")
            self._cells[row][2].setText("" if value is None else f"{value * factor:#.4g}")
            error = "" if truth is None or value is None else f"{100 * (value - truth) / truth:+.2f}%"
            self._cells[row][3].setText(error)
