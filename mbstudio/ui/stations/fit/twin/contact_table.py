"""The table of a twin's contacts: sorted by any column, a row a pair."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt, Signal
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableView

from mbstudio.core.twin.fabric import LEAST_PROBABILITY
from mbstudio.core.twin.kept_twin import KeptTwin
from mbstudio.ui.language import tr

_Index = QModelIndex | QPersistentModelIndex


class ContactModel(QAbstractTableModel):
    """What the table shows."""

    def __init__(self) -> None:
        super().__init__()
        self.rows = pd.DataFrame()
        self._columns: list[tuple[str, str, Callable[[Any], str]]] = []

    def show_twin(self, twin: KeptTwin | None, all_pairs: bool) -> None:
        """Take the pairs of a twin: contacts alone, or near misses too."""
        self.beginResetModel()
        rows = pd.DataFrame() if twin is None else twin.contacts if all_pairs else twin.touching
        self.rows = rows.sort_values("gap", kind="stable").reset_index(drop=True) if len(rows) else rows
        self._columns = [
            ("a", tr("a"), str),
            ("b", tr("b"), str),
            ("gap", tr("Gap"), _number),
            ("gap_deviation", "±", _number),
            ("probability", "P", _share),
            ("area", tr("Area"), _number),
            ("kind", tr("Kind"), _kind),
        ]
        self.endResetModel()

    def rowCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008  # Qt's own default
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008  # Qt's own default
        return 0 if parent.isValid() else len(self._columns)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> Any:
        if orientation == Qt.Orientation.Horizontal and section < len(self._columns):
            if role == Qt.ItemDataRole.DisplayRole:
                return self._columns[section][1]
            if role == Qt.ItemDataRole.ToolTipRole:
                return _tip(self._columns[section][0])
        return None

    def data(self, index: _Index, role: int = 0) -> Any:
        if not index.isValid():
            return None
        name, _, words = self._columns[index.column()]
        if role == Qt.ItemDataRole.DisplayRole:
            return words(self.rows[name].iloc[index.row()])
        if role == Qt.ItemDataRole.TextAlignmentRole:
            side = Qt.AlignmentFlag.AlignLeft if name == "kind" else Qt.AlignmentFlag.AlignRight
            return side | Qt.AlignmentFlag.AlignVCenter
        return None

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        if not len(self.rows) or not 0 <= column < len(self._columns):
            return
        self.beginResetModel()
        self.rows = self.rows.sort_values(
            self._columns[column][0], ascending=order == Qt.SortOrder.AscendingOrder, kind="stable"
        ).reset_index(drop=True)
        self.endResetModel()


class ContactTable(QTableView):
    """Tells which pair was chosen.

    Attributes
    ----------
    chosen : signal (int, int, float array of shape (3,))
        Labels of the pair, and where it touches.
    """

    chosen = Signal(int, int, object)

    def __init__(self) -> None:
        super().__init__()
        self.content = ContactModel()
        self.setModel(self.content)
        self.setAccessibleName(tr("Contacts"))
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setAlternatingRowColors(True)
        self.setShowGrid(False)
        self.setTabKeyNavigation(False)
        self.setWordWrap(False)
        self.setTextElideMode(Qt.TextElideMode.ElideNone)
        self.setSortingEnabled(True)
        self.horizontalHeader().setSortIndicator(2, Qt.SortOrder.AscendingOrder)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(25)
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setMinimumSectionSize(34)
        header.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        self.selectionModel().currentRowChanged.connect(lambda now, _: self._choose(now.row()))

    def show_twin(self, twin: KeptTwin | None, all_pairs: bool) -> None:
        """Show the pairs of a twin, in the order that was chosen."""
        self.content.show_twin(twin, all_pairs)
        header = self.horizontalHeader()
        self.content.sort(header.sortIndicatorSection(), header.sortIndicatorOrder())

    def _choose(self, row: int) -> None:
        rows = self.content.rows
        if 0 <= row < len(rows):
            found = rows.iloc[row]
            self.chosen.emit(int(found["a"]), int(found["b"]), found[["x", "y", "z"]].to_numpy(float))


def _number(value: float) -> str:
    return f"{value:.3g}".replace("-", "\N{MINUS SIGN}") if np.isfinite(value) else "–"


def _share(value: float) -> str:
    return f"{value:.2f}"


def _kind(value: str) -> str:
    return tr("facet") if value == "facet" else tr("point")


def _tip(name: str) -> str:
    return {
        "a": tr("Number of the first grain"),
        "b": tr("Number of the second grain"),
        "gap": tr("Least distance between the two surfaces; negative where they overlap"),
        "gap_deviation": tr("Standard deviation of the gap"),
        "probability": tr(
            "Probability that the gap is 0.1 voxel or less; from {least:.0%} the pair counts as a contact",
            least=LEAST_PROBABILITY,
        ),
        "area": tr("Area where the gap is within 0.1 voxel of its least"),
        "kind": tr("Facet: the gap is even over four times the area that two balls would have"),
    }[name]
