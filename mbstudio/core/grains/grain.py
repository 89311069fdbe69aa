"""One grain: a binary mask with the size and place of its voxels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from mbstudio.core.units import VoxelSize

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, eq=False)
class Grain:
    """A grain as the scan shows it.

    Attributes
    ----------
    mask : bool array, shape (Z, Y, X)
        True inside; cropped to the grain's bounding box (no margin), one 26-connected piece.
    voxel_size : VoxelSize
    origin : tuple of float
        Position (x, y, z) of the centre of ``mask[0, 0, 0]``, in the unit of `voxel_size`, in
        the frame of the scan or mesh that it came from.
    label : int or None
        Its number in the label volume.
    touches_border : bool
        Whether the scan cuts it off, so that its true shape is unknown.
    name : str
        A short name for tables and file names.
    """

    mask: Bool[np.ndarray, "Z Y X"]
    voxel_size: VoxelSize
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    label: int | None = None
    touches_border: bool = False
    name: str = "grain"

    @property
    def unit(self) -> str:
        return self.voxel_size.unit

    @cached_property
    def voxel_count(self) -> int:
        return int(np.count_nonzero(self.mask))

    @property
    def volume(self) -> float:
        """Volume in unit**3, by counting voxels."""
        return self.voxel_count * self.voxel_size.volume

    @property
    def nominal_diameter(self) -> float:
        """Diameter D_n of the sphere of the same volume, in unit."""
        return float((6 * self.volume / np.pi) ** (1 / 3))

    @cached_property
    def centroid(self) -> Float[np.ndarray, "3"]:
        """Centre of volume (x, y, z) in unit."""
        return self.voxel_size.positions(np.argwhere(self.mask).mean(axis=0)[None], self.origin)[0]

    @classmethod
    def from_mask(cls, mask: np.ndarray, voxel_size: str | VoxelSize, **kwargs: object) -> Grain:
        raise AssertionError("written by the grains package")

    @classmethod
    def from_mesh(cls, mesh: str | Path | trimesh.Trimesh, resolution: int = 120, unit: str | None = None) -> Grain:
        raise AssertionError("written by the grains package")
