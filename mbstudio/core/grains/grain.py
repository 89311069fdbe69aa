"""One grain: a binary mask with the size and place of its voxels."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Bool, Float

from mbstudio.core.errors import GrainError, GrainWarning
from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.grains.mesh_voxels import MeshVoxels, voxelise_mesh, voxelise_meshes
from mbstudio.core.grains.pieces import bounding_box, label_pieces, without_cavities
from mbstudio.core.units import VoxelSize

if TYPE_CHECKING:
    import trimesh

    from mbstudio.core.meshes.bodies import Cavities


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
        return nominal_diameter(self.volume)

    @cached_property
    def centroid(self) -> Float[np.ndarray, "3"]:
        """Centre of volume (x, y, z) in unit."""
        centroid: np.ndarray = self.voxel_size.positions(
            np.argwhere(self.mask).mean(axis=0)[None], self.origin
        )[0]
        return centroid

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
        cavities: Cavities = "fill",
    ) -> Grain:
        """Make a grain of a closed surface mesh, in the mesh's own frame.

        Parameters
        ----------
        mesh : str, Path or trimesh.Trimesh
            An STL, PLY, OBJ, OFF, 3MF, GLB or glTF file, or the mesh itself. Seams at textures, copied and
            degenerate triangles and mixed windings are mended.
        resolution : int
            Number of voxels across the longest side of the bounding box.
        unit : str
            Unit of the coordinates; needed unless the file (3MF, GLB, glTF) or mesh (``Trimesh.units``)
            says it.
        name : str, optional
            The file's name without ending by default.
        cavities : {"fill", "keep"}
            Fill cavities that the body encloses, with a `GrainWarning`, or keep them.

        Raises
        ------
        MeshError
            If the file cannot be read, or the mesh is not one closed body; the message gives the
            number of open edges, and where the largest hole is.
        UnitError
            If no unit is given.
        GrainError
            If the resolution is too coarse for the mesh.
        """
        return _grain_of(voxelise_mesh(mesh, resolution, unit, name, cavities))

    @classmethod
    def from_meshes(
        cls,
        meshes: str | Path | Sequence[str | Path],
        resolution: int = 120,
        unit: str | None = None,
        *,
        cavities: Cavities = "fill",
    ) -> list[Grain]:
        """Make one grain of each body in mesh files; see `from_mesh`.

        Parameters
        ----------
        meshes : str, Path, or sequence of them
            Files, folders of meshes, and patterns such as ``"stones/*.ply"``.

        Returns
        -------
        list of Grain
            Named by their files: ``stone``, or ``stone#1`` and ``stone#2`` where a file holds two bodies.
        """
        return [_grain_of(body) for body in voxelise_meshes(meshes, resolution, unit, cavities)]

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


def grain_from_mask(
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
    """Make a grain of a mask; see `Grain.from_mask`."""
    if keep not in ("error", "largest"):
        raise ValueError(f"keep='{keep}' is not known: use 'error' or 'largest'.")
    size = VoxelSize.parse(voxel_size, unit)
    inside = _as_booleans(np.asarray(mask), name)
    pieces, counts = label_pieces(inside)
    if len(counts) > 1:
        if keep == "error":
            raise GrainError(
                f"The mask of '{name}' has {len(counts)} separate pieces "
                f"({', '.join(str(count) for count in sorted(counts, reverse=True)[:4])} voxels, ...): "
                "a grain is one piece; pass keep='largest' to take the largest."
            )
        inside = pieces == 1 + int(counts.argmax())
    box = bounding_box(inside)
    inside = inside[box].copy()
    cavity = 0
    if fill_cavities:
        filled = without_cavities(inside)
        cavity = int(np.count_nonzero(filled)) - int(np.count_nonzero(inside))
        if cavity:
            warnings.warn(
                f"The mask of '{name}' had enclosed cavities of {cavity} voxels, which were filled; "
                "pass fill_cavities=False here and cavities='keep' to the fit to keep them.",
                GrainWarning,
                stacklevel=3,
            )
            inside = filled
    inside.flags.writeable = False
    corner = size.positions(np.array([[part.start for part in box]]), origin)[0]
    place = (float(corner[0]), float(corner[1]), float(corner[2]))
    return Grain(inside, size, place, label, touches_border, name, filled_voxels=cavity)


def _grain_of(body: MeshVoxels) -> Grain:
    grain = grain_from_mask(
        body.mask, body.voxel_size, origin=body.origin, fill_cavities=False, name=body.name
    )
    return replace(grain, filled_voxels=body.filled_voxels) if body.filled_voxels else grain


def _as_booleans(mask: np.ndarray, name: str) -> Bool[np.ndarray, "Z Y X"]:
    """Return the mask as booleans; GrainError unless it is 3-D, two-valued and not empty."""
    if mask.ndim != 3 or 0 in mask.shape:
        raise GrainError(
            f"The mask of '{name}' has shape {mask.shape}: it needs three axes (z, y, x), none empty."
        )
    if mask.dtype.kind not in "buif":
        raise GrainError(f"The mask of '{name}' has type {mask.dtype}: give booleans.")
    if mask.dtype != bool:
        if mask.dtype.kind == "f" and not np.isfinite(mask).all():
            raise GrainError(f"The mask of '{name}' contains values that are not finite: give booleans.")
        high = mask.max()
        if not ((mask == 0) | (mask == high)).all():
            raise GrainError(
                f"The mask of '{name}' contains more than 0 and one other value: give booleans, "
                "for example labels == 7 or grey > threshold."
            )
        mask = mask != 0
    if not mask.any():
        raise GrainError(f"The mask of '{name}' is empty: give a mask with at least one voxel of the grain.")
    return mask
