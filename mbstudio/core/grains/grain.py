"""One grain: a binary mask with the size and place of its voxels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

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
    filled_voxels : int
        Voxels of enclosed cavities that were filled when the grain was made.
    segmented : bool
        Whether it was cut out of a segmented scan, whose noise its outline carries: then its area is
        by default that of its smoothed surface (see `mbstudio.measure`).
    """

    mask: Bool[np.ndarray, "Z Y X"]
    voxel_size: VoxelSize
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    label: int | None = None
    touches_border: bool = False
    name: str = "grain"
    filled_voxels: int = 0
    segmented: bool = False

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
    def from_mask(
        cls,
        mask: np.ndarray,
        voxel_size: str | float | Sequence[float] | VoxelSize,
        *,
        unit: str | None = None,
        origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
        keep: Literal["error", "largest"] = "error",
        fill_cavities: bool = True,
        label: int | None = None,
        touches_border: bool = False,
        name: str = "grain",
    ) -> Grain:
        """Make a grain of a mask, cropped to its bounding box.

        Parameters
        ----------
        mask : array, shape (Z, Y, X)
            Booleans, or numbers of exactly two values of which one is 0 (outside).
        voxel_size : str, float, sequence of float or VoxelSize
            As for `VoxelSize.parse`, with `unit` where it is numbers.
        origin : tuple of float
            Position (x, y, z) of the centre of ``mask[0, 0, 0]``; the grain's own origin is moved
            by what is cropped, so that it stays where it was.
        keep : {"error", "largest"}
            What to do with a mask of several 26-connected pieces.
        fill_cavities : bool
            Fill cavities that the grain encloses, with a `GrainWarning`: no metaball has voids.
        label, touches_border, name
            As the attributes.

        Raises
        ------
        GrainError
            If the mask is empty, has other than three axes, more than two values, or (with
            ``keep="error"``) several pieces.
        UnitError
            If the voxel size cannot be understood.
        """
        from mbstudio.core.grains.making import grain_from_mask

        return grain_from_mask(
            mask,
            voxel_size,
            unit=unit,
            origin=origin,
            keep=keep,
            fill_cavities=fill_cavities,
            label=label,
            touches_border=touches_border,
            name=name,
        )

    @classmethod
    def from_mesh(
        cls,
        mesh: str | Path | trimesh.Trimesh,
        resolution: int = 120,
        unit: str | None = None,
        *,
        name: str | None = None,
    ) -> Grain:
        """Make a grain of a closed surface mesh, in the mesh's own frame.

        Parameters
        ----------
        mesh : str, Path or trimesh.Trimesh
            An STL, OBJ or PLY file, or the mesh itself. Equal corners are merged, an inverted
            orientation is turned outwards.
        resolution : int
            Number of voxels across the longest side of the bounding box.
        unit : str
            Unit of the coordinates; needed unless the mesh says it (``Trimesh.units``).
        name : str, optional
            The file's name without ending by default.

        Raises
        ------
        MeshError
            If the file cannot be read, or the mesh is not one closed body; the message gives the
            number of open edges.
        UnitError
            If no unit is given.
        GrainError
            If the resolution is too coarse for the mesh.
        """
        from mbstudio.core.grains.making import grain_from_mesh

        return grain_from_mesh(mesh, resolution, unit, name)

    def surface_mesh(self) -> trimesh.Trimesh:
        """Return the grain's surface: lightly smoothed marching cubes with the voxels' volume.

        Returns
        -------
        trimesh.Trimesh
            Closed, outward, in the frame and unit of the grain; a copy that may be changed.
        """
        return self._surface.copy()

    @cached_property
    def _surface(self) -> trimesh.Trimesh:
        from mbstudio.core.grains.surface import surface_mesh

        return surface_mesh(self.mask, self.voxel_size, self.origin)
