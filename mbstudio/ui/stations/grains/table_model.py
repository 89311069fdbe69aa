"""What the table of grains shows: whole columns at a time, sorted by their numbers, with gaps at the end."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from PySide6.QtCore import QAbstractTableModel, QModelIndex, QObject, QPersistentModelIndex, Qt, Signal

from mbstudio.core.formulas import nominal_diameters
from mbstudio.core.grains import GrainSet
from mbstudio.core.grains.suspicion.suspects import Suspect
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.units import conversion_factor, unit_label
from mbstudio.ui.language import mark, tr
from mbstudio.ui.widgets.factor_words import factor_short, factor_tip
from mbstudio.ui.widgets.numbers import readable_power_unit

Index = QModelIndex | QPersistentModelIndex


@dataclass(frozen=True)
class Column:
    """A column of the table.

    Attributes
    ----------
    name : str
        Stable: settings speak of it.
    title, tip : str
        Marked for translation; empty where a factor's own words are used.
    of_fit : bool
        Whether it tells of the grain's avatar.
    is_text : bool
        Whether it stands at the left.
    """

    name: str
    title: str
    tip: str
    of_fit: bool = False
    is_text: bool = False


COLUMNS = (
    Column("label", mark("Grain"), mark("Label of the grain in the label volume")),
    Column("volume", "", mark("Volume V, by counting voxels")),
    Column("dn", "", ""),
    Column(
        "border",
        mark("Edge"),
        mark("Whether the edge of the scan cuts the grain, so that its true shape is unknown"),
        is_text=True,
    ),
    Column("n", mark("Avatar"), mark("Number of control points of its avatar"), of_fit=True),
    Column(
        "rms",
        mark("RMS [{unit}]"),
        mark("Root mean square distance between the surfaces of grain and avatar"),
        of_fit=True,
    ),
    Column(
        "share",
        mark("RMS [%]"),
        mark("Root mean square distance between the surfaces, in percent of the grain's nominal diameter"),
        of_fit=True,
    ),
    Column(
        "verdict",
        mark("Verdict"),
        mark("Whether the avatar is one piece without voids that keeps the volume within 5 %"),
        of_fit=True,
        is_text=True,
    ),
    Column(
        "use",
        mark("Part"),
        mark(
            "Whether the grain takes part in fits, populations, learning and export, or is excluded by hand"
        ),
        is_text=True,
    ),
    Column(
        "suspicion",
        mark("Suspicion"),
        mark("How likely the grain is several grains, or a part of one: 0 to 1"),
    ),
)
VOLUME, NAME, COUNT, RMS, SHARE, VERDICT, SUSPICION = 1, 3, 4, 5, 6, 7, 9
"""Places of columns; that of the edge holds the names of meshes, which no edge cuts."""


class GrainTableModel(QAbstractTableModel):
    """The pandas table of a grain set and the fits, as Qt wants them.

    Parameters
    ----------
    parent : QObject, optional
        The table, with which it goes.

    Attributes
    ----------
    sorting, sorted : signal
        Rows are about to change their places, and have.
    """

    sorting = Signal()
    sorted = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._unit = self._volume_unit = "um"
        self._labels = np.zeros(0, dtype=int)
        self._values: dict[str, np.ndarray] = {}
        self._names: list[str] = []
        self._files: list[str] = []
        self._fits: Mapping[int, FitResult] = {}
        self._changed: frozenset[int] = frozenset()
        self._suspects: Mapping[int, Suspect] = {}
        self._accepted: frozenset[int] = frozenset()
        self._sorted_by = (0, Qt.SortOrder.AscendingOrder)
        self._order = np.zeros(0, dtype=int)  # places of grains, row by row
        self._rows = np.zeros(0, dtype=int)  # rows, grain by grain

    # ---- content -------------------------------------------------------------------------------

    def set_grains(self, grains: GrainSet | None) -> None:
        """Show another set of grains."""
        self.beginResetModel()
        self._names, self._files = [], []
        if grains is None:
            self._labels, self._values = np.zeros(0, dtype=int), {}
        else:
            table = grains.table
            volume = table["volume"].to_numpy(float)
            self._unit = grains.unit
            self._volume_unit = readable_power_unit(
                float(np.median(volume)) if len(volume) else 1.0, grains.unit, 3
            )
            self._labels = table["label"].to_numpy(int)
            self._values = {
                "label": self._labels,
                "volume": volume * conversion_factor(self._unit, self._volume_unit) ** 3,
                "dn": nominal_diameters(volume),
                "border": table["touches_border"].to_numpy(float),
                "use": np.isin(self._labels, list(grains.excluded_labels)).astype(float),
            }
            if grains.is_of_meshes:
                self._names = [str(name) for name in table["name"]]
                self._files = [str(file) for file in table["file"]] if "file" in table else []
            self._accepted = grains.accepted_labels
        self._take_fits()
        self._take_suspects()
        self._put_in_order()
        self.endResetModel()

    def set_fits(self, fits: Mapping[int, FitResult], changed: Collection[int] = ()) -> None:
        """Show other fits of the same grains; some grains may have changed since they were fitted."""
        self._fits, self._changed = fits, frozenset(changed)
        self._take_fits()
        if COLUMNS[self._sorted_by[0]].of_fit:
            self._change_order()
        elif len(self._labels):
            first = next(place for place, column in enumerate(COLUMNS) if column.of_fit)
            self.dataChanged.emit(self.index(0, first), self.index(len(self._labels) - 1, len(COLUMNS) - 1))

    def _take_fits(self) -> None:
        """Bring the columns of fits up to date: NaN where a grain has none."""
        of_fits = {name: np.full(len(self._labels), np.nan) for name in ("n", "rms", "verdict")}
        for place, label in enumerate(self._labels.tolist()) if self._fits else ():
            fit = self._fits.get(label)
            if fit is not None:
                of_fits["n"][place] = fit.avatar.n
                of_fits["rms"][place] = fit.verdict.rms
                of_fits["verdict"][place] = fit.verdict.valid
        self._values |= of_fits
        if len(self._labels):
            self._values["share"] = 100 * of_fits["rms"] / self._values["dn"]

    def set_suspects(self, suspects: Mapping[int, Suspect]) -> None:
        """Show how suspicious the grains are."""
        self._suspects = suspects
        self._take_suspects()
        if self._sorted_by[0] == SUSPICION:
            self._change_order()
        elif len(self._labels):
            last = len(self._labels) - 1
            self.dataChanged.emit(self.index(0, SUSPICION), self.index(last, SUSPICION))

    def _take_suspects(self) -> None:
        """Bring the column of suspicion up to date: accepted grains count as none, others as not scored."""
        scores = np.full(len(self._labels), np.nan)
        for place, label in enumerate(self._labels.tolist()):
            one = self._suspects.get(label)
            if label in self._accepted:
                scores[place] = 0.0
            elif one is not None:
                scores[place] = one.score
        self._values["suspicion"] = scores

    @property
    def has_suspects(self) -> bool:
        """Whether it is known of some grain how suspicious it is."""
        return bool(len(self._labels)) and bool(np.isfinite(self._values["suspicion"]).any())

    @property
    def has_excluded(self) -> bool:
        """Whether some grain is excluded by hand."""
        return bool(len(self._labels)) and bool(self._values["use"].any())

    @property
    def has_names(self) -> bool:
        """Whether the grains are called by the files of their meshes; an edge cuts none of them."""
        return bool(self._names)

    def label(self, row: int) -> int:
        """Return the label of the grain in a row."""
        return int(self._labels[self._order[row]])

    def labels(self, rows: np.ndarray | slice) -> np.ndarray:
        """Return the labels of the grains in these rows."""
        return self._labels[self._order[rows]]

    def row(self, label: int) -> int | None:
        """Return the row of a label, or None."""
        rows = self.rows((label,))
        return int(rows[0]) if len(rows) else None

    def rows(self, labels: Collection[int]) -> np.ndarray:
        """Return the rows of labels, sorted; those that are no grain's have none."""
        wanted = np.fromiter(labels, int, len(labels))
        return np.sort(self._rows[np.isin(self._labels, wanted)])

    # ---- order ---------------------------------------------------------------------------------

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        """Sort by a column; grains that have nothing there stand at the end, whichever way."""
        # Qt asks twice where only the column is another.
        if 0 <= column < len(COLUMNS) and (column, order) != self._sorted_by:
            self._sorted_by = column, order
            self._change_order()

    def _change_order(self) -> None:
        """Sort again, and tell the view which rows went where."""
        self.sorting.emit()
        self.layoutAboutToBeChanged.emit()
        before = self.persistentIndexList()
        grains = [int(self._order[index.row()]) for index in before]
        self._put_in_order()
        self.changePersistentIndexList(
            before,
            [self.index(int(self._rows[g]), i.column()) for g, i in zip(grains, before, strict=True)],
        )
        self.layoutChanged.emit()
        self.sorted.emit()

    def _put_in_order(self) -> None:
        column, order = self._sorted_by
        if column == NAME and self._names:
            # Ranks, so that equal names stay in their order whichever way they are sorted.
            values = np.unique(np.array(self._names), return_inverse=True)[1].astype(float)
        else:
            values = self._values[COLUMNS[column].name].astype(float) if len(self._labels) else np.zeros(0)
        # NumPy puts NaN last.
        self._order = np.argsort(values if order == Qt.SortOrder.AscendingOrder else -values, kind="stable")
        self._rows = np.empty_like(self._order)
        self._rows[self._order] = np.arange(len(self._order))

    # ---- Qt's questions --------------------------------------------------------------------------

    def rowCount(self, parent: Index | None = None) -> int:
        return 0 if parent is not None and parent.isValid() else len(self._labels)

    def columnCount(self, parent: Index | None = None) -> int:
        return 0 if parent is not None and parent.isValid() else len(COLUMNS)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> Any:
        if orientation != Qt.Orientation.Horizontal:
            return None
        if role == Qt.ItemDataRole.DisplayRole:
            return self._heading(section)
        if role == Qt.ItemDataRole.ToolTipRole:
            if section == NAME and self._names:
                return tr("File that the grain came from; with a number where it holds several")
            if section == VOLUME and self._names:
                return tr("Volume V of the mesh")
            tip = COLUMNS[section].tip
            return tr(tip) if tip else factor_tip("dn")
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return self._alignment(section)
        return None

    def _heading(self, section: int) -> str:
        name, title = COLUMNS[section].name, COLUMNS[section].title
        if name == "volume":
            return factor_short("volume", self._volume_unit)
        if name == "dn":
            return factor_short("dn", self._unit)
        if name == "border" and self._names:
            return tr("Mesh")
        return tr(title, unit=unit_label(self._unit)) if "{unit}" in title else tr(title)

    def data(self, index: Index, role: int = 0) -> Any:
        if not index.isValid():
            return None
        grain, column = int(self._order[index.row()]), index.column()
        if role == Qt.ItemDataRole.DisplayRole:
            return self._text(grain, column)
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return self._alignment(column)
        if role == Qt.ItemDataRole.ToolTipRole and column == NAME and self._files:
            return self._files[grain]
        if role == Qt.ItemDataRole.ToolTipRole and column == SUSPICION:
            one = self._suspects.get(int(self._labels[grain]))
            return one.reasons.replace("; ", "\n") or None if one is not None else None
        if role == Qt.ItemDataRole.ToolTipRole and column == VERDICT:
            fit = self._fits.get(int(self._labels[grain]))
            if int(self._labels[grain]) in self._changed:
                return tr("The grain was corrected after it was fitted: fit it again.")
            told = (*fit.verdict.reasons, *fit.verdict.warnings) if fit else ()
            return "\n".join(told) or None
        return None

    @staticmethod
    def _alignment(column: int) -> Qt.AlignmentFlag:
        side = Qt.AlignmentFlag.AlignLeft if COLUMNS[column].is_text else Qt.AlignmentFlag.AlignRight
        return side | Qt.AlignmentFlag.AlignVCenter

    def _text(self, grain: int, column: int) -> str:
        name = COLUMNS[column].name
        if name == "border" and self._names:
            return self._names[grain]
        value = float(self._values[name][grain])
        if np.isnan(value):
            return "–"
        if name == "label":
            return str(int(value))
        if name == "volume":
            return f"{value:,.0f}" if 1000 <= value < 1e6 else f"{value:#.3g}"
        if name == "dn":
            return f"{value:.1f}"
        if name == "border":
            return tr("cut") if value else tr("inside")
        if name == "n":
            return f"n = {int(value)}"
        if name == "suspicion":
            return tr("accepted") if int(self._labels[grain]) in self._accepted else f"{value:.2f}"
        if name == "use":
            return tr("excluded") if value else tr("yes")
        if name == "verdict" and int(self._labels[grain]) in self._changed:
            return tr("changed")
        if name == "verdict":
            return tr("valid") if value else tr("not valid")
        return f"{value:#.3g}"
