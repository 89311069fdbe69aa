"""Pictures of many bodies in a grid: sorted, filtered by factors, drawn only where they are looked at."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from PySide6.QtCore import (
    QAbstractListModel,
    QItemSelection,
    QItemSelectionModel,
    QModelIndex,
    QObject,
    QPersistentModelIndex,
    QPoint,
    QSize,
    Qt,
    QTimer,
    Signal,
)
from PySide6.QtGui import QIcon, QPixmap
from PySide6.QtWidgets import QAbstractItemView, QListView

from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.ui.language import mark, tr
from mbstudio.ui.widgets.factor_words import factor_title

OWN: Mapping[str, str] = {"suspicion": mark("Suspicion")}
"""Titles of what bodies can be sorted by and is no shape factor."""
SIDE = 72  # pixels of a picture
CELL = QSize(110, 122)
_SHORT = ("dn", "sphericity")
_ONE = {
    "grains": mark("Grain {number}"),
    "avatars": mark("Avatar {number}"),
    "clones": mark("Clone {number}"),
}


@dataclass(frozen=True, eq=False)
class Bodies:
    """Bodies of one kind, one row each.

    Attributes
    ----------
    kind : str
        'grains', 'avatars' or 'clones'.
    keys : int array, shape (bodies,)
        Labels of grains; numbers of clones, from 1.
    columns : mapping of str to float array, shape (bodies,)
        Factors by name; NaN where there is none.
    unit : str
        Of lengths.
    draw : callable
        Called with a row in a worker: returns its picture, uint8 array of shape (SIDE, SIDE, 4).
    """

    kind: str
    keys: Int[np.ndarray, " bodies"]
    columns: Mapping[str, Float[np.ndarray, " bodies"]]
    unit: str
    draw: Callable[[int], np.ndarray]
    pictures: dict[int, QPixmap] = field(default_factory=dict)

    def value(self, factor: str, row: int) -> str:
        """Return a factor of one body with its unit."""
        number = float(self.columns[factor][row])
        unit = FACTORS[factor].unit(self.unit) if factor in FACTORS else ""
        if not np.isfinite(number):
            return "–"
        return f"{number:.2f}" if factor in OWN else f"{number:.4g} {unit}".strip()


def rows_in_order(
    bodies: Bodies, ranges: Sequence[tuple[str, float, float]], sort: str, falling: bool
) -> Int[np.ndarray, " shown"]:
    """Return the rows whose factors lie in all ranges, ordered by a factor ('' for their number).

    A body without a factor that is asked for lies in no range, and comes last in the order.
    """
    inside = np.ones(len(bodies.keys), dtype=bool)
    for factor, low, high in ranges:
        column = bodies.columns.get(factor)
        if column is not None:
            inside &= (column >= low) & (column <= high)
    rows = np.flatnonzero(inside)
    column = bodies.columns.get(sort)
    values = (bodies.keys if column is None else column)[rows].astype(float)
    known = np.isfinite(values)
    order = np.argsort(-values[known] if falling else values[known], kind="stable")
    return np.concatenate([rows[known][order], rows[~known]])


def _symbol(name: str) -> str:
    return tr(OWN[name]) if name in OWN else FACTORS[name].symbol or ""


class _Model(QAbstractListModel):
    """The bodies as Qt wants them; asks for the pictures of those that are painted."""

    wanted = Signal()

    def __init__(self, parent: QObject) -> None:
        # With a parent: a model that only Python holds lives on with the lambdas that hold it.
        super().__init__(parent)
        self.bodies: Bodies | None = None
        self.rows = np.zeros(0, dtype=int)
        self.by = ""
        self.asked: dict[int, None] = {}
        self._blank = QPixmap(SIDE, SIDE)
        self._blank.fill(Qt.GlobalColor.transparent)

    def rowCount(self, parent: QModelIndex | QPersistentModelIndex | None = None) -> int:
        return 0 if parent is not None and parent.isValid() else len(self.rows)

    def data(self, index: QModelIndex | QPersistentModelIndex, role: int = 0) -> Any:
        if not index.isValid() or self.bodies is None:
            return None
        row = int(self.rows[index.row()])
        if role == Qt.ItemDataRole.DecorationRole:
            picture = self.bodies.pictures.get(row)
            if picture is None:
                self.asked[row] = None
                self.wanted.emit()
            return QIcon(picture or self._blank)
        if role == Qt.ItemDataRole.DisplayRole:
            return f"{self.bodies.keys[row]}\n{self._describe_row(row)}"
        if role == Qt.ItemDataRole.ToolTipRole:
            lines = [
                f"{factor_title(name)}: {self.bodies.value(name, row)}"
                for name in self.bodies.columns
                if name in FACTORS
            ]
            one = tr(_ONE[self.bodies.kind], number=self.bodies.keys[row])
            return "\n".join([one, *lines])
        return None

    def _describe_row(self, row: int) -> str:
        """Return the factor that the order is by, else the nominal diameter and the sphericity."""
        assert self.bodies is not None
        shown = [self.by] if self.by in self.bodies.columns else []
        shown += [name for name in _SHORT if name in self.bodies.columns and name not in shown]
        parts = [f"{_symbol(name)} {self.bodies.value(name, row)}".strip() for name in shown]
        return "\n".join(parts[:2])


class BodyList(QListView):
    """The grid.

    Attributes
    ----------
    chosen : signal (list of int, int or None)
        Keys of all chosen bodies, and that of the one with the cursor.
    pictures_wanted : signal (Bodies, list of int)
        Rows that are looked at and have no picture yet; answer with `set_picture`.
    menu_asked : signal (int or None, QPoint)
        Key of the body that was clicked with the right button, and the place on the screen.
    """

    chosen = Signal(object, object)
    pictures_wanted = Signal(object, object)
    menu_asked = Signal(object, object)

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("bodyList")
        self.setAccessibleName(tr("Pictures of bodies"))
        self.content = _Model(self)
        self.setModel(self.content)
        self.setViewMode(QListView.ViewMode.IconMode)
        self.setResizeMode(QListView.ResizeMode.Adjust)
        self.setMovement(QListView.Movement.Static)
        self.setUniformItemSizes(True)
        self.setIconSize(QSize(SIDE, SIDE))
        self.setGridSize(CELL)
        self.setWordWrap(True)
        self.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.verticalScrollBar().setSingleStep(30)
        self._quiet = False
        # What was painted in one turn of the event loop is asked for together.
        self._soon = QTimer(self)
        self._soon.setSingleShot(True)
        self._soon.setInterval(30)
        self._soon.timeout.connect(self._ask)
        self.content.wanted.connect(lambda: self._soon.isActive() or self._soon.start())
        self.selectionModel().selectionChanged.connect(self._say)
        self.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.customContextMenuRequested.connect(self._ask_menu)

    def show_bodies(self, bodies: Bodies | None, rows: np.ndarray, sort: str) -> None:
        """Show bodies in an order."""
        self._quiet = True
        self.content.beginResetModel()
        self.content.bodies, self.content.rows, self.content.by = bodies, rows, sort
        self.content.asked.clear()
        self.content.endResetModel()
        self._quiet = False

    def set_picture(self, bodies: Bodies, row: int, picture: QPixmap) -> None:
        """Show a picture that was made meanwhile."""
        bodies.pictures[row] = picture
        if bodies is self.content.bodies:
            for place in np.flatnonzero(self.content.rows == row):
                index = self.content.index(int(place), 0)
                self.content.dataChanged.emit(index, index, [Qt.ItemDataRole.DecorationRole])

    def keys(self) -> list[int]:
        """Return the keys in the order in which they are shown."""
        bodies = self.content.bodies
        return [] if bodies is None else [int(key) for key in bodies.keys[self.content.rows]]

    def select_keys(self, keys: Collection[int], current: int | None) -> None:
        """Choose bodies by their keys, without telling it."""
        if set(keys) == set(self.chosen_keys()):
            return
        flags, picked = QItemSelectionModel.SelectionFlag, QItemSelection()
        self._quiet = True
        for place, key in enumerate(self.keys()):
            if key in keys:
                index = self.content.index(place, 0)
                picked.select(index, index)
                if key == current:
                    self.selectionModel().setCurrentIndex(index, flags.NoUpdate)
                    self.scrollTo(index)
        self.selectionModel().select(picked, flags.ClearAndSelect)
        self._quiet = False

    def chosen_keys(self) -> list[int]:
        """Return the keys of the chosen bodies."""
        keys = self.keys()
        return [keys[index.row()] for index in self.selectionModel().selectedIndexes()]

    def _say(self, *_: object) -> None:
        if not self._quiet:
            keys, index = self.keys(), self.currentIndex()
            self.chosen.emit(self.chosen_keys(), keys[index.row()] if index.isValid() else None)

    def _ask_menu(self, place: QPoint) -> None:
        index, keys = self.indexAt(place), self.keys()
        key = keys[index.row()] if index.isValid() else None
        self.menu_asked.emit(key, self.viewport().mapToGlobal(place))

    def seen_rows(self) -> list[int]:
        """Return the rows of the bodies that are to be seen now."""
        first = self.indexAt(QPoint(CELL.width() // 2, 2))
        place, rows = max(0, first.row()), []
        while place < len(self.content.rows):
            if self.visualRect(self.content.index(place, 0)).top() > self.viewport().height():
                break
            rows.append(int(self.content.rows[place]))
            place += 1
        return rows

    def _ask(self) -> None:
        # All that are to be seen, not only those just painted: what was asked for before gives way.
        bodies, painted = self.content.bodies, dict(self.content.asked)
        self.content.asked.clear()
        asked = (
            []
            if bodies is None or not painted
            else [row for row in self.seen_rows() if row not in bodies.pictures]
        )
        if bodies is not None and asked:
            self.pictures_wanted.emit(bodies, asked)
