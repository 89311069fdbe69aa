"""The workbench: where one edit changes labels, and what follows from that is kept in step.

An edit reads masks of grains and writes labels into boxes. The workbench gives pieces that have come apart
numbers of their own, and measures anew what the table says of each grain that has changed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import edt
import numpy as np
from jaxtyping import Bool, Int, Shaped

from mbstudio.core.errors import EditError
from mbstudio.core.grains.editing.boxes import Voxel, box_of_row, crop_to, holds, joined, widened, within
from mbstudio.core.grains.editing.label_volume import Box, LabelVolume
from mbstudio.core.grains.pieces import label_pieces
from mbstudio.core.scan.field_of_view import FieldOfView
from mbstudio.core.units import VoxelSize

if TYPE_CHECKING:
    import pandas as pd

    from mbstudio.core.scan.scan import Scan

CRUMB_VOXELS = 27
"""Pieces of at most so many voxels that an edit cuts off are no grains."""

_BOX_COLUMNS = ("z0", "z1", "y0", "y1", "x0", "x1")


@dataclass
class Workbench:
    """The labels while one edit is made.

    Attributes
    ----------
    volume : LabelVolume
    table : DataFrame
        The grains before the edit.
    voxel_size, origin
        As of the grain set.
    view : FieldOfView or None
        None if it is not known.
    last_label : int
        The highest number that a grain has ever had.
    scan : Scan or None
        For edits that look at grey values.
    changed : set of int
        Grains whose voxels have changed, new ones among them.
    gone : set of int
        Grains that are no more.
    notes : list of str
        What should be told of the edit.
    """

    volume: LabelVolume
    table: pd.DataFrame
    voxel_size: VoxelSize
    origin: tuple[float, float, float]
    view: FieldOfView | None
    last_label: int
    scan: Scan | None = None
    changed: set[int] = field(default_factory=set)
    gone: set[int] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        missing = [name for name in _BOX_COLUMNS if name not in self.table]
        if missing:
            raise EditError(
                f"The table of the grains has no column '{missing[0]}': find or load the grains again."
            )
        self._labels: np.ndarray = self.table["label"].to_numpy()
        self._given = self.last_label
        self._boxes: dict[int, Box] = {}
        self._rows: dict[int, dict[str, Any]] = {}
        self._flags: dict[int, bool] = {}
        self._accepted: set[int] = set()
        self._touched: set[int] = set()

    # ---- reading -------------------------------------------------------------------------------

    @property
    def shape(self) -> tuple[int, int, int]:
        return self.volume.shape

    def has(self, label: int) -> bool:
        """Whether there is a grain of this number now."""
        if label in self._boxes:
            return True
        return label not in self.gone and bool((self._labels == label).any())

    def require(self, labels: Iterable[int]) -> None:
        """Refuse grains that there are not.

        Raises
        ------
        EditError
            For the first that there is not, by number.
        """
        for label in labels:
            if not self.has(label):
                raise EditError(
                    f"There is no grain {label}: the table names {len(self._labels):,} grains, up to number "
                    f"{int(self._labels.max(initial=0))}."
                )

    def box(self, label: int) -> Box:
        """Return the bounding box of a grain."""
        if label in self._boxes:
            return self._boxes[label]
        row = int(np.flatnonzero(self._labels == label)[0])
        return box_of_row([self.table[name].iat[row] for name in _BOX_COLUMNS])

    def box_with_margin(self, label: int, margin: int) -> Box:
        """Return the bounding box of a grain with a margin, as far as the volume reaches."""
        return widened(self.box(label), margin, self.shape)

    def read(self, box: Box) -> Int[np.ndarray, "z y x"]:
        """Return the labels in a box, read-only."""
        return self.volume.read(box)

    def label_at(self, voxel: Sequence[int], what: str) -> int:
        """Return the label at a voxel; EditError, by `what` it is, if that lies outside the scan."""
        if not holds(self.shape, voxel):
            raise EditError(
                f"{what} (z, y, x) = {tuple(voxel)} lies outside the scan of {self.shape} voxels: choose one "
                "inside."
            )
        z, y, x = (int(at) for at in voxel)
        return int(self.volume.read((slice(z, z + 1), slice(y, y + 1), slice(x, x + 1)))[0, 0, 0])

    def seen(self, box: Box) -> Bool[np.ndarray, "z y x"]:
        """Return what the scan has seen of a box."""
        if self.view is None or self.view.is_whole_box:
            return np.ones(tuple(part.stop - part.start for part in box), dtype=bool)
        return np.asarray(self.view.mask[box])

    def grey(self, box: Box) -> Shaped[np.ndarray, "z y x"]:
        """Return the grey values in a box.

        Raises
        ------
        EditError
            If there is no scan, or it is not of the labels' shape.
        """
        if self.scan is None:
            raise EditError("This edit looks at grey values: give the scan that the grains were found in.")
        if self.scan.shape != self.shape:
            raise EditError(
                f"The scan has {self.scan.shape} voxels and the labels {self.shape}: give the scan that the "
                "grains were found in."
            )
        return np.asarray(self.scan.voxels[box])

    def anchor(self, label: int) -> Voxel:
        """Return a voxel deep inside a grain, by which it can be found in another segmentation."""
        box = self.box(label)
        inside = self.read(box) == label
        middle = tuple(round(float(at)) for at in np.argwhere(inside).mean(axis=0))
        if not inside[middle]:
            depth = edt.edt(np.ascontiguousarray(inside), anisotropy=self.voxel_size.zyx, black_border=True)
            middle = tuple(int(at) for at in np.unravel_index(int(depth.argmax()), inside.shape))
        z, y, x = (part.start + at for part, at in zip(box, middle, strict=True))
        return z, y, x

    # ---- changing ------------------------------------------------------------------------------

    def new_label(self) -> int:
        """Return a number that no grain has ever had."""
        self._given += 1
        return self._given

    def write(self, box: Box, values: Int[np.ndarray, "z y x"]) -> set[int]:
        """Put labels into a box and settle what follows; return the grains that this has changed.

        Pieces that no longer hang together with their grain become grains of their own, or go if they are
        crumbs; notes tell both.
        """
        before = self.read(box)
        differing = before != values
        if not differing.any():
            return set()
        cropped = crop_to(differing, box)
        assert cropped is not None
        inner = within(cropped, box)
        before, values, differing = before[inner], values[inner], differing[inner]
        touched = {int(label) for label in np.union1d(before[differing], values[differing]) if label}
        sources = {
            label: {int(other) for other in np.unique(before[values == label]) if other}
            for label in touched
            if not self.has(label)
        }
        self.volume = self.volume.written(cropped, values)
        self._touched = touched
        for label in sorted(touched):
            self._settle(label, cropped, sources.get(label))
        return touched

    def remove(self, label: int) -> None:
        """Take a grain away."""
        box = self.box(label)
        values = self.read(box).copy()
        values[values == label] = 0
        self.volume = self.volume.written(box, values)
        self._forget(label)

    def set_excluded(self, labels: Iterable[int], excluded: bool) -> None:
        """Set or take the mark by which grains are left out of what follows."""
        self._flags.update(dict.fromkeys(labels, excluded))

    def is_excluded(self, label: int) -> bool:
        """Whether a grain is left out of what follows."""
        if label in self._flags:
            return self._flags[label]
        if "excluded" not in self.table:
            return False
        return bool(self.table.loc[self._labels == label, "excluded"].any())

    def accept(self, labels: Iterable[int]) -> None:
        """Mark grains as looked at and right; a grain that changes loses the mark."""
        self._accepted.update(labels)

    def settled_table(self) -> pd.DataFrame:
        """Return the table of the grains as they are now."""
        import pandas as pd  # imported late: it takes a third of a second

        table = self.table
        stale = np.isin(self._labels, list(self.gone | self._rows.keys()))
        if self._rows or stale.any():
            added = pd.DataFrame(
                [self._rows[label] for label in sorted(self._rows)], columns=list(table.columns)
            ).astype(dict(table.dtypes))
            kept = table[~stale]
            table = pd.concat([kept, added]) if len(kept) and len(added) else (added if len(added) else kept)
            table = table.sort_values("label", kind="stable").reset_index(drop=True)
        flags = {label: flag for label, flag in self._flags.items() if label not in self.gone}
        if "excluded" in table or any(flags.values()):
            labels = table["label"].to_numpy()
            column = (
                table["excluded"].to_numpy().copy() if "excluded" in table else np.zeros(len(table), bool)
            )
            for flag in (True, False):
                column[np.isin(labels, [label for label, given in flags.items() if given is flag])] = flag
            table = table.assign(excluded=column)
        if self._accepted:
            marked = table["label"].isin(self._accepted).to_numpy()
            if "accepted" in table:
                marked = marked | table["accepted"].to_numpy()
            table = table.assign(accepted=marked)
        return table

    # ---- settling ------------------------------------------------------------------------------

    def _settle(self, label: int, box: Box, sources: set[int] | None) -> None:
        """Bring one grain into order after labels in a box have changed."""
        region = joined((self.box(label), box)) if self.has(label) else box
        values = self.read(region)
        inside = values == label
        if not inside.any():
            self._forget(label)
            return
        if sources and all(self.is_excluded(source) for source in sources):
            self._flags[label] = True
        pieces, counts = label_pieces(inside)
        if len(counts) > 1:
            inside = pieces == 1 + int(counts.argmax())
            self._part(label, region, values.copy(), pieces, counts)
        self._measure(label, region, inside)

    def _part(
        self,
        label: int,
        region: Box,
        values: Int[np.ndarray, "z y x"],
        pieces: Int[np.ndarray, "z y x"],
        counts: Int[np.ndarray, " n"],
    ) -> None:
        """Give all pieces of a grain but the largest numbers of their own; crumbs go."""
        crumbs, made = 0, []
        for number in np.argsort(-counts, kind="stable")[1:] + 1:
            piece = pieces == number
            if counts[number - 1] <= CRUMB_VOXELS:
                values[piece] = 0
                crumbs += int(counts[number - 1])
                continue
            other = self.new_label()
            values[piece] = other
            made.append(other)
            if self.is_excluded(label):
                self._flags[other] = True
            self._measure(other, region, piece)
        self.volume = self.volume.written(region, values)
        if made:
            self.notes.append(
                f"Grain {label} came apart: what no longer hangs together with it became "
                f"{'grain' if len(made) == 1 else 'grains'} {', '.join(map(str, made))}."
            )
        if crumbs:
            self.notes.append(f"Crumbs of {crumbs} voxels came off grain {label} and were removed.")

    def _forget(self, label: int) -> None:
        self._boxes.pop(label, None)
        self._rows.pop(label, None)
        self._flags.pop(label, None)
        self.changed.discard(label)
        if label <= self.last_label:
            self.gone.add(label)

    def _measure(self, label: int, region: Box, inside: Bool[np.ndarray, "z y x"]) -> None:
        """Note what the table says of a grain that lies in a region."""
        box = crop_to(inside, region)
        assert box is not None
        mask = inside[within(box, region)]
        count = int(np.count_nonzero(mask))
        middle = []
        for axis, part in enumerate(box):
            counts = mask.sum(axis=tuple(other for other in range(3) if other != axis))
            middle.append(float(counts @ np.arange(part.start, part.stop)) / count)
        ends = (end for part in box for end in (part.start, part.stop))
        x, y, z = self.voxel_size.positions(np.array([middle]), self.origin)[0]
        self._boxes[label] = box
        self._rows[label] = {
            "label": label,
            "voxels": count,
            "volume": count * self.voxel_size.volume,
            **dict(zip(_BOX_COLUMNS, ends, strict=True)),
            "x": float(x),
            "y": float(y),
            "z": float(z),
            "touches_border": self._is_cut(mask, box),
            "excluded": self.is_excluded(label),
            "accepted": False,
        }
        self.gone.discard(label)
        self.changed.add(label)

    def _is_cut(self, mask: Bool[np.ndarray, "z y x"], box: Box) -> bool:
        if self.view is not None:
            return self.view.cuts(mask, box)
        nz, ny, nx = self.shape
        whole = FieldOfView(0, np.ones((ny, nx), dtype=bool), (nz, ny, nx))
        if whole.cuts(mask, box):
            return True
        # Where the field of view is not known, what has touched its border may do so still.
        return self._touches_unknown_border(box)

    def _touches_unknown_border(self, box: Box) -> bool:
        """Whether a grain that reached into this box touched a border other than the faces of the scan."""
        low = [self.table[name].to_numpy() for name in ("z0", "y0", "x0")]
        high = [self.table[name].to_numpy() for name in ("z1", "y1", "x1")]
        flagged = self.table["touches_border"].to_numpy().copy()
        for part, count, start, stop in zip(box, self.shape, low, high, strict=True):
            flagged &= (start > 0) & (stop < count) & (start < part.stop) & (stop > part.start)
        if not flagged.any():
            return False
        return not self._touched.isdisjoint(self._labels[flagged].tolist())
