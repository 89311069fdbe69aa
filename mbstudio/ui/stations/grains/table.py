"""The table of grains: one row a grain, with its fit if it has one."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import cast

import numpy as np
from PySide6.QtCore import (
    QItemSelection,
    QItemSelectionModel,
    QItemSelectionRange,
    QModelIndex,
    QPoint,
    QSettings,
    Qt,
    Signal,
)
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QMenu, QTableView

from mbstudio.core.grains.suspicion.suspects import Suspect
from mbstudio.ui.language import tr
from mbstudio.ui.stations.grains.table_model import (
    COLUMNS,
    COUNT,
    NAME,
    RMS,
    SHARE,
    VERDICT,
    VOLUME,
    GrainTableModel,
)

ROOM = ((SHARE, 580), (VOLUME, 500), (NAME, 430), (RMS, 330), (COUNT, 260), (VERDICT, 240))
"""Columns that go first when the table is narrow, and the pixels that it needs to show each."""
_MORE_ROOM = 110
"""Pixels more for each of the columns that are there only sometimes."""
_HIDDEN = "table/hidden"


class GrainTable(QTableView):
    """The table with sorting; tells the labels of the rows that are chosen.

    The person chooses the columns from the menu of the heading. Until then, columns that say least go where
    there is no room for them.

    Parameters
    ----------
    settings : QSettings, optional
        Keeps the choice of columns.

    Attributes
    ----------
    chosen : signal (list of int, int or None)
        Labels of all chosen rows, and that of the row with the cursor.
    menu_asked : signal (int or None, QPoint)
        Label of the row that was clicked with the right button, and the place on the screen.
    """

    chosen = Signal(object, object)
    menu_asked = Signal(object, object)

    def __init__(self, settings: QSettings | None = None) -> None:
        super().__init__()
        self._settings = settings
        self._quiet = False
        self._kept: tuple[list[int], int | None] = ([], None)
        self.content = GrainTableModel(self)
        self.setModel(self.content)
        self.setAccessibleName(tr("Grains"))
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
        self.verticalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        # Of its own, and empty: Qt would ask each cell of each column whether it is chosen.
        header.setSelectionModel(QItemSelectionModel(self.content, header))
        header.setMinimumSectionSize(52)
        header.setMaximumSectionSize(240)
        header.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        header.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        header.customContextMenuRequested.connect(self._offer_columns)
        self.selectionModel().selectionChanged.connect(self._rows_chosen)
        self.selectionModel().currentRowChanged.connect(self._rows_chosen)
        self.content.modelReset.connect(self._arrange_columns)
        self.content.sorting.connect(self._keep_choice)
        self.content.sorted.connect(self._choose_what_was_kept)
        self.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.customContextMenuRequested.connect(self._ask_menu)
        self.setSortingEnabled(True)
        self.sortByColumn(0, Qt.SortOrder.AscendingOrder)

    def set_suspects(self, suspects: Mapping[int, Suspect]) -> None:
        """Show how suspicious the grains are, in a column that is there as soon as some are known."""
        before = self._needless
        self.content.set_suspects(suspects)
        if self._needless != before:
            self._arrange_columns()

    # ---- the selection -------------------------------------------------------------------------

    def select_labels(self, labels: Collection[int], current: int | None) -> None:
        """Choose the rows of labels, and put the cursor on one, without telling it."""
        if current != self._current() or set(labels) != set(self.chosen_labels()):
            self._choose_rows(labels, current)

    def _choose_rows(self, labels: Collection[int], current: int | None) -> None:
        model, flags = self.selectionModel(), QItemSelectionModel.SelectionFlag
        rows, last = QItemSelection(), len(COLUMNS) - 1
        place_of = self.content.createIndex  # rows that exist need not be asked for
        for first, end in _runs(self.content.rows(labels)):
            rows.append(QItemSelectionRange(place_of(first, 0), place_of(end, last)))
        place = None if current is None else self.content.row(current)
        index = QModelIndex() if place is None else self.content.index(place, 0)
        self._quiet = True
        try:
            # In silence, and emptied first: Qt compares each range that goes with each that comes.
            model.blockSignals(True)
            model.reset()
            model.select(rows, flags.Select)
            model.blockSignals(False)
            model.setCurrentIndex(index, flags.NoUpdate)
            if index.isValid():
                self.scrollTo(index)
        finally:
            self._quiet = False
        self.viewport().update()

    def chosen_labels(self) -> list[int]:
        """Return the labels of the chosen rows."""
        # Qt's list is a sequence, which its annotations do not say.
        ranges = cast("Sequence[QItemSelectionRange]", self.selectionModel().selection())
        steps = np.zeros(self.content.rowCount() + 1, int)
        np.add.at(steps, [part.top() for part in ranges], 1)
        np.add.at(steps, [part.bottom() + 1 for part in ranges], -1)
        return self.content.labels(np.flatnonzero(steps.cumsum())).tolist()

    def labels_in_order(self) -> list[int]:
        """Return the labels as they stand in the table."""
        return self.content.labels(slice(None)).tolist()

    def _current(self) -> int | None:
        index = self.currentIndex()
        return self.content.label(index.row()) if index.isValid() else None

    def _keep_choice(self) -> None:
        """Let go of the selection while rows change their places: Qt would follow each cell of it."""
        self._kept = self.chosen_labels(), self._current()
        model = self.selectionModel()
        model.blockSignals(True)
        model.reset()
        model.blockSignals(False)

    def _choose_what_was_kept(self) -> None:
        self._choose_rows(*self._kept)

    def _rows_chosen(self, *_: object) -> None:
        if not self._quiet:
            self.chosen.emit(self.chosen_labels(), self._current())

    def _ask_menu(self, place: QPoint) -> None:
        index = self.indexAt(place)
        label = self.content.label(index.row()) if index.isValid() else None
        self.menu_asked.emit(label, self.viewport().mapToGlobal(place))

    # ---- the columns ---------------------------------------------------------------------------

    @property
    def hidden_columns(self) -> set[str] | None:
        """Names of the columns that the person does not want to see; None before there was a choice."""
        given = self._settings.value(_HIDDEN) if self._settings is not None else None
        return None if given is None else set(str(given).split(",")) - {""}

    def choose_columns(self, hidden: Collection[str] | None) -> None:
        """Hide these columns from now on; None lets the table's width decide."""
        if self._settings is not None:
            if hidden is None:
                self._settings.remove(_HIDDEN)
            else:
                self._settings.setValue(_HIDDEN, ",".join(sorted(hidden)))
        self._arrange_columns()

    def column_menu(self) -> QMenu:
        """Return the menu that chooses the columns; the labels of the grains always stay."""
        menu = QMenu(self)
        for place, column in enumerate(COLUMNS[1:], 1):
            words = self.content.headerData(place, Qt.Orientation.Horizontal, Qt.ItemDataRole.DisplayRole)
            action = menu.addAction(words)
            action.setCheckable(True)
            action.setChecked(not self.isColumnHidden(place))
            action.triggered.connect(lambda shown, name=column.name: self._show_column(name, shown))
        menu.addSeparator()
        action = menu.addAction(tr("By the width of the table"))
        action.setCheckable(True)
        action.setChecked(self.hidden_columns is None)
        action.triggered.connect(lambda _: self.choose_columns(None))
        return menu

    @property
    def _needless(self) -> set[str]:
        """Names of the columns that would say the same, or nothing, of all grains."""
        needless = set() if self.content.has_excluded else {"use"}
        return needless if self.content.has_suspects else needless | {"suspicion"}

    def _show_column(self, name: str, shown: bool) -> None:
        hidden = {column.name for place, column in enumerate(COLUMNS) if self.isColumnHidden(place)}
        hidden -= self._needless
        self.choose_columns(hidden - {name} if shown else hidden | {name})

    def _offer_columns(self, place: QPoint) -> None:
        menu = self.column_menu()
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        menu.popup(self.horizontalHeader().mapToGlobal(place))

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._arrange_columns()
        super().resizeEvent(event)

    def _arrange_columns(self) -> None:
        # Beside plots not every column has room: the nominal diameter tells the volume as well, a grain that
        # the edge cuts has no avatar, and the panel at station Fit names the mesh.
        hidden = self.hidden_columns
        needless = self._needless
        if hidden is None:
            room = self.width() - _MORE_ROOM * len({"use", "suspicion"} - needless)
            hidden = {COLUMNS[place].name for place, needed in ROOM if room < needed}
        for place, column in enumerate(COLUMNS):
            self.setColumnHidden(place, column.name in hidden | needless)
        # A name stands beside the number.
        header = self.horizontalHeader()
        named = self.content.has_names
        header.moveSection(header.visualIndex(NAME), 1 if named else NAME)
        mode = QHeaderView.ResizeMode
        header.setSectionResizeMode(NAME, mode.ResizeToContents if named else mode.Stretch)


def _runs(rows: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield first and last of each run of rows that follow each other; `rows` are sorted."""
    if len(rows):
        ends = [0, *(np.flatnonzero(np.diff(rows) > 1) + 1).tolist(), len(rows)]
        for begin, end in pairwise(ends):
            yield int(rows[begin]), int(rows[end - 1])
