"""The table of grains: one row a grain, with its fit if it has one."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from PySide6.QtCore import (
    QAbstractTableModel,
    QItemSelection,
    QItemSelectionModel,
    QModelIndex,
    QPersistentModelIndex,
    QSortFilterProxyModel,
    Qt,
    Signal,
)
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableView

from mbstudio.core.formulas import nominal_diameters
from mbstudio.core.grains import GrainSet
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.units import conversion_factor, unit_label
from mbstudio.ui.language import mark, tr
from mbstudio.ui.widgets.factor_words import factor_short, factor_tip
from mbstudio.ui.widgets.numbers import readable_power_unit

Index = QModelIndex | QPersistentModelIndex
ROOMY, NARROW = 500, 430  # pixels that all columns need, and all but the volume
SORT_ROLE = Qt.ItemDataRole.UserRole
NAME = 3
"""Column of the edge of the scan, or of the names of meshes."""

COLUMNS = (
    mark("Grain"), mark("Volume"), "Dₙ", mark("Edge"), mark("Avatar"), mark("RMS distance"), mark("Verdict"),
)  # fmt: skip
_TIPS = (
    mark("Label of the grain in the label volume"),
    mark("Volume V, by counting voxels"),
    "",  # of D_n: as everywhere
    mark("Whether the edge of the scan cuts the grain, so that its true shape is unknown"),
    mark("Number of control points of its avatar"),
    mark("Root mean square distance between the surfaces of grain and avatar"),
    mark("Whether the avatar is one piece without voids that keeps the volume within 5 %"),
)


class GrainTableModel(QAbstractTableModel):
    """The pandas table of a grain set and the fits, as Qt wants them."""

    def __init__(self) -> None:
        super().__init__()
        self._unit = self._volume_unit = "um"
        self._columns: dict[str, np.ndarray] = {}
        self._names: list[str] = []
        self._files: list[str] = []
        self._labels = np.zeros(0, dtype=int)
        self._fits: Mapping[int, FitResult] = {}

    # ---- content -------------------------------------------------------------------------------

    def set_grains(self, grains: GrainSet | None) -> None:
        """Show another set of grains."""
        self.beginResetModel()
        self._names, self._files = [], []
        if grains is None:
            self._labels, self._columns = np.zeros(0, dtype=int), {}
        else:
            table = grains.table
            volume = table["volume"].to_numpy(float)
            self._unit = grains.unit
            self._volume_unit = readable_power_unit(
                float(np.median(volume)) if len(volume) else 1.0, grains.unit, 3
            )
            self._labels = table["label"].to_numpy(int)
            self._columns = {
                "volume": volume * conversion_factor(self._unit, self._volume_unit) ** 3,
                "dn": nominal_diameters(volume),
                "border": table["touches_border"].to_numpy(bool),
            }
            if grains.is_of_meshes:
                self._names = [str(name) for name in table["name"]]
                self._files = [str(file) for file in table["file"]] if "file" in table else []
        self.endResetModel()

    def set_fits(self, fits: Mapping[int, FitResult]) -> None:
        """Show other fits of the same grains."""
        self._fits = fits
        if len(self._labels):
            self.dataChanged.emit(self.index(0, 4), self.index(len(self._labels) - 1, len(COLUMNS) - 1))

    @property
    def has_names(self) -> bool:
        """Whether the grains are called by the files of their meshes; an edge cuts none of them."""
        return bool(self._names)

    def label(self, row: int) -> int:
        """Return the label of the grain in a row."""
        return int(self._labels[row])

    def row(self, label: int) -> int | None:
        """Return the row of a label, or None."""
        rows = np.flatnonzero(self._labels == label)
        return int(rows[0]) if len(rows) else None

    # ---- Qt's questions --------------------------------------------------------------------------

    def rowCount(self, parent: Index | None = None) -> int:
        return 0 if parent is not None and parent.isValid() else len(self._labels)

    def columnCount(self, parent: Index | None = None) -> int:
        return 0 if parent is not None and parent.isValid() else len(COLUMNS)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> Any:
        if orientation != Qt.Orientation.Horizontal:
            return None
        if role == Qt.ItemDataRole.DisplayRole:
            unit = unit_label(self._unit)
            heads = {
                1: factor_short("volume", self._volume_unit),
                2: factor_short("dn", self._unit),
                5: tr("RMS [{unit}]", unit=unit),
            }
            if self._names:
                heads[NAME] = tr("Mesh")
            return heads.get(section, tr(COLUMNS[section]))
        if role == Qt.ItemDataRole.ToolTipRole:
            if section == NAME and self._names:
                return tr("File that the grain came from; with a number where it holds several")
            if section == 1 and self._names:
                return tr("Volume V of the mesh")
            return tr(_TIPS[section]) if _TIPS[section] else factor_tip("dn")
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return self._alignment(section)
        return None

    def data(self, index: Index, role: int = 0) -> Any:
        if not index.isValid():
            return None
        row, column = index.row(), index.column()
        if role == Qt.ItemDataRole.DisplayRole:
            return self._text(row, column)
        if role == SORT_ROLE:
            return self._value(row, column)
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return self._alignment(column)
        if role == Qt.ItemDataRole.ToolTipRole and column == NAME and self._files:
            return self._files[row]
        if role == Qt.ItemDataRole.ToolTipRole and column == 6:
            fit = self._fits.get(self.label(row))
            told = (*fit.verdict.reasons, *fit.verdict.warnings) if fit else ()
            return "\n".join(told) or None
        return None

    @staticmethod
    def _alignment(column: int) -> Qt.AlignmentFlag:
        side = Qt.AlignmentFlag.AlignLeft if column in (NAME, 6) else Qt.AlignmentFlag.AlignRight
        return side | Qt.AlignmentFlag.AlignVCenter

    def _value(self, row: int, column: int) -> float | str:
        fit = self._fits.get(self.label(row))
        if column == 0:
            return self.label(row)
        if column == NAME and self._names:
            return self._names[row]
        if column in (1, 2, 3):
            return float(self._columns[("volume", "dn", "border")[column - 1]][row])
        if fit is None:
            return float("inf") if column == 5 else -1.0
        return (float(fit.avatar.n), fit.verdict.rms, float(fit.verdict.valid))[column - 4]

    def _text(self, row: int, column: int) -> str:
        fit = self._fits.get(self.label(row))
        if column == 0:
            return str(self.label(row))
        if column == 1:
            volume = float(self._columns["volume"][row])
            return f"{volume:,.0f}" if 1000 <= volume < 1e6 else f"{volume:#.3g}"
        if column == 2:
            return f"{self._columns['dn'][row]:.1f}"
        if column == NAME:
            if self._names:
                return self._names[row]
            return tr("cut") if self._columns["border"][row] else tr("inside")
        if fit is None:
            return "–"
        return (
            f"n = {fit.avatar.n}",
            f"{fit.verdict.rms:#.3g}",
            tr("valid") if fit.verdict.valid else tr("not valid"),
        )[column - 4]


class GrainTable(QTableView):
    """The table with sorting; tells the labels of the rows that are chosen.

    Attributes
    ----------
    chosen : signal (list of int, int or None)
        Labels of all chosen rows, and that of the row with the cursor.
    """

    chosen = Signal(object, object)

    def __init__(self) -> None:
        super().__init__()
        self.content = GrainTableModel()
        self._sorted = QSortFilterProxyModel(self)
        self._sorted.setSourceModel(self.content)
        self._sorted.setSortRole(SORT_ROLE)
        self.setModel(self._sorted)
        self.setAccessibleName(tr("Grains"))
        self.setSortingEnabled(True)
        self.sortByColumn(0, Qt.SortOrder.AscendingOrder)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.setAlternatingRowColors(True)
        self.setShowGrid(False)
        self.setMouseTracking(True)
        self.setTabKeyNavigation(False)
        self.setWordWrap(False)
        self.setTextElideMode(Qt.TextElideMode.ElideMiddle)  # numbers of files stand at their ends
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(27)
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setMinimumSectionSize(52)
        header.setMaximumSectionSize(240)
        header.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        self.selectionModel().selectionChanged.connect(self._rows_chosen)
        self.selectionModel().currentRowChanged.connect(self._rows_chosen)
        self._quiet = False
        self.content.modelReset.connect(self._arrange_columns)

    def select_labels(self, labels: Collection[int], current: int | None) -> None:
        """Choose the rows of labels, and put the cursor on one, without telling it."""
        if set(labels) == set(self.chosen_labels()) and current == self._current():
            return
        flags = QItemSelectionModel.SelectionFlag
        rows = QItemSelection()
        for label in labels:
            row = self.content.row(label)
            if row is not None:
                index = self._sorted.mapFromSource(self.content.index(row, 0))
                rows.select(index, index)
        self._quiet = True
        try:
            place = None if current is None else self.content.row(current)
            index = (
                QModelIndex() if place is None else self._sorted.mapFromSource(self.content.index(place, 0))
            )
            self.selectionModel().setCurrentIndex(index, flags.NoUpdate)
            self.selectionModel().select(rows, flags.ClearAndSelect | flags.Rows)
            if index.isValid():
                self.scrollTo(index)
        finally:
            self._quiet = False

    def chosen_labels(self) -> list[int]:
        """Return the labels of the chosen rows."""
        rows = self.selectionModel().selectedRows()
        return [self.content.label(self._sorted.mapToSource(index).row()) for index in rows]

    def _current(self) -> int | None:
        index = self.currentIndex()
        return self.content.label(self._sorted.mapToSource(index).row()) if index.isValid() else None

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._arrange_columns()
        super().resizeEvent(event)

    def _arrange_columns(self) -> None:
        # Beside plots not every column has room: the nominal diameter tells the volume as well, a grain that
        # the edge cuts has no avatar, and the panel at station Fit names the mesh.
        self.setColumnHidden(1, self.width() < ROOMY)
        self.setColumnHidden(NAME, self.width() < NARROW)
        # A name stands beside the number.
        header = self.horizontalHeader()
        named = self.content.has_names
        header.moveSection(header.visualIndex(NAME), 1 if named else NAME)
        mode = QHeaderView.ResizeMode
        header.setSectionResizeMode(NAME, mode.ResizeToContents if named else mode.Stretch)

    def labels_in_order(self) -> list[int]:
        """Return the labels as they stand in the table."""
        return [
            self.content.label(self._sorted.mapToSource(self._sorted.index(row, 0)).row())
            for row in range(self._sorted.rowCount())
        ]

    def _rows_chosen(self, *_: object) -> None:
        if not self._quiet:
            self.chosen.emit(self.chosen_labels(), self._current())
