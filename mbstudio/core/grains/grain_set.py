"""All grains of a scan: the label volume and one table row a grain."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import GrainError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.grains.grain_mesh import GrainMesh
from mbstudio.core.grains.pieces import without_cavities
from mbstudio.core.grains.verdict import SegmentationVerdict
from mbstudio.core.units import VoxelSize

if TYPE_CHECKING:
    import pandas as pd
    import trimesh


@dataclass(frozen=True, eq=False)
class GrainSet:
    """The grains of one scan.

    Attributes
    ----------
    labels : int array, shape (Z, Y, X)
        0 outside all grains, else the grain's label.
    table : pandas.DataFrame
        One row a grain, in the order of its labels, with the columns ``label``, ``voxels``,
        ``volume`` (unit**3; of a mesh exactly, else by counting voxels), ``z0, z1, y0, y1, x0, x1``
        (bounding box in voxels, half open), ``x, y, z`` (centroid in unit) and ``touches_border``; grains
        of mesh files also have a ``name`` and the ``file`` that they came from.
    voxel_size : VoxelSize
    origin : tuple of float
        Position (x, y, z) of the centre of voxel [0, 0, 0], as in the scan.
    meshes : mapping of int to GrainMesh
        By label, the exact surfaces of grains of mesh files; empty for those of scans.
    verdict : SegmentationVerdict or None
        How well the scan bears the grains out; None where it was not compared with them.
    """

    labels: Int[np.ndarray, "Z Y X"]
    table: pd.DataFrame
    voxel_size: VoxelSize
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    meshes: Mapping[int, GrainMesh] = field(default_factory=lambda: MappingProxyType({}))
    verdict: SegmentationVerdict | None = None

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
        """Labels of the grains that do not touch the border."""
        return [int(label) for label in self.table.loc[~self.table["touches_border"], "label"]]

    def _cut_out(self, row: pd.Series, fill_cavities: bool = True) -> Grain:
        """Cut the grain out of the label volume; what other labels fill inside it is its own if filled."""
        label = int(row["label"])
        box = tuple(slice(int(row[f"{axis}0"]), int(row[f"{axis}1"])) for axis in "zyx")
        solid = self.labels[box] == label
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
