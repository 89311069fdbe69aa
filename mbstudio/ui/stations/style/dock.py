"""What comes of a style: curves of the training, the clones with their factors, their quality, the judge."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QAbstractItemView,
    QFrame,
    QHeaderView,
    QStackedWidget,
    QTabBar,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
)

from mbstudio.core.populations import Population
from mbstudio.scene.figures.population_style import readable_scale
from mbstudio.ui.language import tr
from mbstudio.ui.stations.style.judge_table import JudgeTable
from mbstudio.ui.stations.style.quality_table import QualityTable
from mbstudio.ui.stations.style.surface_samples import SurfaceSampleView
from mbstudio.ui.stations.style.training_plots import TrainingPlots
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.factor_words import factor_short, factor_title
from mbstudio.ui.widgets.numbers import four_digits

SHOWN = ("dn", "volume", "area", "sphericity", "circularity", "dns", "csf")


class CloneTable(QTableWidget):
    """One row a clone; sorts by a click on a head.

    Attributes
    ----------
    chosen : signal (int or None)
        The clone of the row with the cursor.
    """

    chosen = Signal(object)

    def __init__(self) -> None:
        super().__init__(0, 1 + len(SHOWN))
        self.setAccessibleName(tr("Clones"))
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setShowGrid(False)
        self.setAlternatingRowColors(True)
        self.setTabKeyNavigation(False)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(25)
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setMinimumSectionSize(52)
        header.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        self._quiet = False
        self.itemSelectionChanged.connect(self._emit_choice)

    def show_clones(self, clones: Population | None) -> None:
        """Fill the table anew."""
        self._quiet = True
        self.setSortingEnabled(False)
        self.setRowCount(0 if clones is None else len(clones))
        heads = [tr("Clone")]
        for place, factor in enumerate(SHOWN, 1):
            scale, unit = (1.0, "um") if clones is None else readable_scale([clones], factor)
            heads.append(factor_short(factor, None if clones is None else unit))
            for row, value in enumerate([] if clones is None else clones.column(factor)):
                self.setItem(row, place, _number(scale * float(value)))
        for row in range(self.rowCount()):
            item = QTableWidgetItem()
            item.setData(Qt.ItemDataRole.DisplayRole, row + 1)
            item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
            self.setItem(row, 0, item)
        for place, head in enumerate(heads):
            item = QTableWidgetItem(head)
            item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
            item.setToolTip("" if not place else factor_title(SHOWN[place - 1]))
            self.setHorizontalHeaderItem(place, item)
        self.sortByColumn(0, Qt.SortOrder.AscendingOrder)
        self.setSortingEnabled(True)
        self._quiet = False

    def select(self, clone: int | None) -> None:
        """Choose a row, without telling it."""
        self._quiet = True
        self.clearSelection()
        for row in range(self.rowCount()):
            item = self.item(row, 0)
            if item is not None and item.data(Qt.ItemDataRole.DisplayRole) == clone:
                self.selectRow(row)
                self.scrollToItem(item)
        self._quiet = False

    def _emit_choice(self) -> None:
        if not self._quiet:
            rows = self.selectionModel().selectedRows()
            item = self.item(rows[0].row(), 0) if rows else None
            self.chosen.emit(None if item is None else int(item.data(Qt.ItemDataRole.DisplayRole)))


class StyleDock(QFrame):
    """Four pages: training, clones, quality, judge."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("plots")
        self.setMinimumHeight(190)
        self.training = TrainingPlots(theme)
        self.clones = CloneTable()
        self.quality = QualityTable(theme)
        self.judge = JudgeTable(theme)
        self.tabs = QTabBar()
        self.tabs.setExpanding(False)
        self.tabs.setDrawBase(False)
        self.tabs.setAccessibleName(tr("What is shown of the style"))
        self._stack = QStackedWidget()
        self.samples = SurfaceSampleView()
        self._learned = QStackedWidget()
        self._learned.addWidget(self.training)
        self._learned.addWidget(self.samples)
        for title, page in (
            (tr("Training"), self._learned), (tr("Clones"), self.clones), (tr("Quality"), self.quality),
            (tr("Judge"), self.judge),
        ):  # fmt: skip
            self.tabs.addTab(title)
            self._stack.addWidget(page)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.tabs)
        layout.addWidget(self._stack, 1)
        self.tabs.currentChanged.connect(self._stack.setCurrentIndex)

    def show_surfaces(self, shown: bool) -> None:
        """Show parents and clones of surfaces on the first page, or curves of a training."""
        self._learned.setCurrentWidget(self.samples if shown else self.training)
        self.tabs.setTabText(0, tr("Parents and clones") if shown else tr("Training"))

    def open_page(self, name: str) -> None:
        """Turn to 'training', 'clones', 'quality' or 'judge'."""
        self.tabs.setCurrentIndex(("training", "clones", "quality", "judge").index(name))


class _Number(QTableWidgetItem):
    """A number that sorts as one."""

    def __lt__(self, other: QTableWidgetItem) -> bool:
        role = Qt.ItemDataRole.UserRole
        return bool(self.data(role) < other.data(role))


def _number(value: float) -> QTableWidgetItem:
    known = bool(np.isfinite(value))
    item = _Number(four_digits(value))
    item.setData(Qt.ItemDataRole.UserRole, value if known else float("inf"))
    item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
    return item
