"""All grains of a scan: the label volume and one table row a grain."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import GrainError
from mbstudio.core.grains.editing.boxes import box_of_row
from mbstudio.core.grains.editing.editable import EditableGrains
from mbstudio.core.grains.editing.label_volume import LabelVolume
from mbstudio.core.grains.editing.records import Edit
from mbstudio.core.grains.grain import Grain
from mbstudio.core.grains.grain_mesh import GrainMesh
from mbstudio.core.grains.pieces import without_cavities
from mbstudio.core.grains.suspicion.scoring import rank_grains
from mbstudio.core.grains.verdict import SegmentationVerdict
from mbstudio.core.scan.field_of_view import FieldOfView
from mbstudio.core.units import VoxelSize

if TYPE_CHECKING:
    import pandas as pd
    import trimesh

    from mbstudio.core.scan.scan import Scan


_BESIDE = 2  # voxels between the boxes of grains that may touch


@dataclass(frozen=True, eq=False)
class GrainSet(EditableGrains):
    """The grains of one scan.

    Attributes
    ----------
    label_volume : LabelVolume
        0 outside all grains, else the grain's label; an array that is given becomes one.
    table : pandas.DataFrame
        One row a grain, in the order of its labels, with the columns ``label``, ``voxels``,
        ``volume`` (unit**3; of a mesh exactly, else by counting voxels), ``z0, z1, y0, y1, x0, x1``
        (bounding box in voxels, half open), ``x, y, z`` (centroid in unit) and ``touches_border``; where
        grains were excluded by hand also ``excluded``, where some were accepted also ``accepted``; grains
        of mesh files also have a ``name`` and the ``file`` that they came from.
    voxel_size : VoxelSize
    origin : tuple of float
        Position (x, y, z) of the centre of voxel [0, 0, 0], as in the scan.
    meshes : mapping of int to GrainMesh
        By label, the exact surfaces of grains of mesh files; empty for those of scans.
    verdict : SegmentationVerdict or None
        How well the scan bears the grains out; None where it was not compared with them.
    view : FieldOfView or None
        What the scan has seen; None if that is not known.
    edits : tuple of Edit
        How the grains were corrected by hand since they were found, the first first.
    last_label : int
        The highest number that a grain has ever had; the highest of the table by default.
    stamps : mapping of int to object
        Of grains that were corrected by hand: what tells this form of it from every other.
    """

    label_volume: LabelVolume
    table: pd.DataFrame
    voxel_size: VoxelSize
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    meshes: Mapping[int, GrainMesh] = field(default_factory=lambda: MappingProxyType({}))
    verdict: SegmentationVerdict | None = None
    view: FieldOfView | None = None
    edits: tuple[Edit, ...] = ()
    last_label: int = 0
    stamps: Mapping[int, object] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        if isinstance(self.label_volume, np.ndarray):
            object.__setattr__(self, "label_volume", LabelVolume(self.label_volume))
        highest = int(self.table["label"].max()) if len(self.table) else 0
        object.__setattr__(self, "last_label", max(self.last_label, highest))

    @property
    def labels(self) -> Int[np.ndarray, "Z Y X"]:
        """The label of every voxel, read-only; 0 outside all grains.

        After edits by hand it is put together when it is first asked for; `label_volume` is read at once.
        """
        return self.label_volume.whole()

    @property
    def unit(self) -> str:
        return self.voxel_size.unit

    def __len__(self) -> int:
        return len(self.table)

    def __getitem__(self, index: int) -> Grain:
        """Return the grain in row `index` of the table."""
        return self._cut_out(self.table.iloc[index])

    def __iter__(self) -> Iterator[Grain]:
        return (self[index] for index in range(len(self)))

    def grain(self, label: int, *, fill_cavities: bool = True) -> Grain:
        """Return the grain with this label, its cavities filled or kept; GrainError if there is none."""
        rows = np.flatnonzero(self.table["label"].to_numpy() == label)
        if not len(rows):
            raise GrainError(
                f"There is no grain {label}: the labels run from 1 to {int(self.table['label'].max())}."
            )
        return self._cut_out(self.table.iloc[int(rows[0])], fill_cavities)

    def body(self, label: int, *, fill_cavities: bool = False) -> Grain | trimesh.Trimesh:
        """Return what is to be measured: the mesh that a grain came from, else the grain of voxels.

        Parameters
        ----------
        fill_cavities : bool
            Whether cavities that a mesh keeps do not count: then it is the grain of voxels, filled.

        Raises
        ------
        GrainError
            If there is no such grain.
        """
        mesh = self.meshes.get(label)
        if mesh is None or (fill_cavities and mesh.has_voids):
            return self.grain(label)
        return mesh.to_trimesh(self.unit)

    def has(self, label: int) -> bool:
        """Return whether there is a grain of this number."""
        return bool((self.table["label"].to_numpy() == label).any())

    def voxel_inside(self, label: int) -> tuple[int, int, int]:
        """Return the voxel (z, y, x) of a grain nearest to its middle; GrainError if there is none."""
        rows = np.flatnonzero(self.table["label"].to_numpy() == label)
        if not len(rows):
            raise GrainError(f"There is no grain {label}.")
        row = self.table.iloc[int(rows[0])]
        box = box_of_row([row[f"{axis}{end}"] for axis in "zyx" for end in (0, 1)])
        places = np.argwhere(self.label_volume.read(box) == label)
        away = ((places - places.mean(axis=0)) * self.voxel_size.zyx) ** 2
        z, y, x = (places[int(away.sum(axis=1).argmin())] + [part.start for part in box]).tolist()
        return z, y, x

    def shares_body(self, other: GrainSet, label: int) -> bool:
        """Return whether a grain of another set is the same here, voxel by voxel."""
        return self.has(label) and other.has(label) and self.body_key(label) == other.body_key(label)

    def body_key(self, label: int) -> Hashable:
        """Return what is equal for one grain in two grain sets if no edit between them has touched it."""
        return (
            self.label_volume.family, label, self.stamps.get(label), self.meshes.get(label), self.voxel_size,
            self.origin,
        )  # fmt: skip

    def changed_since(self, before: GrainSet) -> frozenset[int] | None:
        """Return which grains are other voxels than in a grain set before, came or went.

        None if these did not come from each other by corrections: then nothing need be the same.
        """
        if before.label_volume.family is not self.label_volume.family:
            return None
        stamped = before.stamps.keys() | self.stamps.keys()
        changed = {label for label in stamped if before.stamps.get(label) is not self.stamps.get(label)}
        gone_or_new = set(before.table["label"].tolist()) ^ set(self.table["label"].tolist())
        return frozenset(changed | gone_or_new)

    def outdated_since(self, before: GrainSet) -> frozenset[int]:
        """Return which grains have changed since a grain set before, or lie close to what has.

        All, if these did not come from each other by corrections.
        """
        labels, changed = self.table["label"].to_numpy(), self.changed_since(before)
        if changed is None:
            return frozenset(labels.tolist())
        if not changed:
            return frozenset()
        boxes = np.concatenate(
            [_ends(grains.table[grains.table["label"].isin(changed)]) for grains in (before, self)]
        )
        ends, near = _ends(self.table), np.zeros(len(labels), dtype=bool)
        for box in boxes:
            apart = (ends[:, 0] > box[1] + _BESIDE) | (ends[:, 1] < box[0] - _BESIDE)
            near |= ~apart.any(axis=1)
        return frozenset(labels[near].tolist())

    def suspicion(
        self,
        scan: Scan | None = None,
        *,
        residuals: Mapping[int, float] | None = None,
        progress: Callable[[float, str], None] | None = None,
    ) -> pd.DataFrame:
        """Return which grains are probably several, or parts of one, the most suspicious first.

        See :func:`~mbstudio.core.grains.suspicion.scoring.rank_grains`.
        """
        return rank_grains(self.label_volume, self.table, self.voxel_size, scan, residuals, progress)

    def name_of(self, label: int) -> str:
        """Return what a grain is called: by its file, or by its number."""
        if not self.is_of_meshes:
            return f"grain {label}"
        names: list[str] = self.table.loc[self.table["label"] == label, "name"].tolist()
        return str(names[0])

    @property
    def is_of_meshes(self) -> bool:
        """Whether the grains are bodies of mesh files and not of a scan."""
        return "name" in self.table

    @property
    def interior_labels(self) -> list[int]:
        """Labels of the grains that do not touch the border and are not excluded."""
        return list(self._interior_labels)

    @cached_property
    def _interior_labels(self) -> tuple[int, ...]:
        wanted = ~self.table["touches_border"].to_numpy()
        if "excluded" in self.table:
            wanted &= ~self.table["excluded"].to_numpy()
        return tuple(self.table["label"].to_numpy()[wanted].tolist())

    @property
    def excluded_labels(self) -> frozenset[int]:
        """Labels of the grains that were excluded by hand."""
        if "excluded" not in self.table:
            return frozenset()
        return frozenset(self.table.loc[self.table["excluded"].to_numpy(), "label"].tolist())

    @property
    def accepted_labels(self) -> frozenset[int]:
        """Labels of the grains that were looked at and accepted, and have not changed since."""
        if "accepted" not in self.table:
            return frozenset()
        return frozenset(self.table.loc[self.table["accepted"].to_numpy(), "label"].tolist())

    def _cut_out(self, row: pd.Series, fill_cavities: bool = True) -> Grain:
        """Cut the grain out of the label volume; what other labels fill inside it is its own if filled."""
        label = int(row["label"])
        box = box_of_row([row[f"{axis}{end}"] for axis in "zyx" for end in (0, 1)])
        solid = self.label_volume.read(box) == label
        mask = without_cavities(solid) if fill_cavities else solid
        mask.flags.writeable = False
        corner = self.voxel_size.positions(np.array([[part.start for part in box]]), self.origin)[0]
        origin = (float(corner[0]), float(corner[1]), float(corner[2]))
        return Grain(
            mask, self.voxel_size, origin, label, bool(row["touches_border"]),
            str(row.get("name", f"grain {label}")),
            filled_voxels=int(np.count_nonzero(mask) - np.count_nonzero(solid)),
            segmented=True,
        )  # fmt: skip


def _ends(table: pd.DataFrame) -> Int[np.ndarray, "n 2 3"]:
    """Return first and last ends (z, y, x) of the boxes of a table's grains."""
    low, high = (table[[f"{axis}{end}" for axis in "zyx"]].to_numpy() for end in (0, 1))
    return np.stack((low, high), axis=1)
