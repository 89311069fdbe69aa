"""Voxels of closed surface meshes, in their own frames."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from mbstudio.core.errors import GrainError, GrainWarning, UnitError
from mbstudio.core.grains.pieces import label_pieces, largest_piece, without_cavities
from mbstudio.core.grains.voxelisation import voxelise
from mbstudio.core.meshes.bodies import Cavities, closed_body, question_size, read_bodies, several_bodies
from mbstudio.core.meshes.listing import find_meshes
from mbstudio.core.units import VoxelSize, parse_unit

if TYPE_CHECKING:
    import trimesh


_TRUE = 0.002
"""Share by which the volume of voxels may differ from the mesh's before they are laid otherwise."""
_TOLD = 0.03
"""Share that is told."""
_ROUNDED = 0.02
"""Share of a voxel that is as good as none or a whole one."""


@dataclass(frozen=True, eq=False)
class MeshVoxels:
    """A body of a mesh as voxels: one piece, with the place of voxel [0, 0, 0] and the body's name."""

    mask: Bool[np.ndarray, "Z Y X"]
    voxel_size: VoxelSize
    origin: tuple[float, float, float]
    name: str
    filled_voxels: int = 0


def voxelise_mesh(
    mesh: str | Path | trimesh.Trimesh,
    resolution: int,
    unit: str | None,
    name: str | None,
    cavities: Cavities = "fill",
) -> MeshVoxels:
    """Return the voxels of the one body of a mesh or mesh file; see `Grain.from_mesh`."""
    require_resolution(resolution)
    if isinstance(mesh, str | Path):
        bodies = read_bodies(mesh, unit, cavities)
        if len(bodies) > 1:
            raise several_bodies(str(mesh), len(bodies))
        return voxelise_body(bodies[0], resolution, str(mesh), name, cavities)
    body = closed_body(mesh, "The mesh", cavities)
    if unit:
        body.units = parse_unit(unit)
    if body.units:
        question_size(float(np.ptp(body.bounds, axis=0).max()), parse_unit(body.units), "The mesh")
    return voxelise_body(body, resolution, "The mesh", name or "grain", cavities)


def voxelise_meshes(
    meshes: str | Path | Sequence[str | Path], resolution: int, unit: str | None, cavities: Cavities = "fill"
) -> Iterator[MeshVoxels]:
    """Yield the voxels of each body in mesh files; see `Grain.from_meshes`."""
    require_resolution(resolution)
    for path in find_meshes(meshes):
        for body in read_bodies(path, unit, cavities):
            yield voxelise_body(body, resolution, body.metadata["file_name"], None, cavities)


def require_resolution(resolution: int) -> None:
    """Refuse a number of voxels along a body that is none."""
    if int(resolution) != resolution or not 4 <= resolution <= 2000:
        raise GrainError(
            f"resolution={resolution} is impossible: give a whole number of voxels from 4 to 2000."
        )


def voxelise_body(
    body: trimesh.Trimesh,
    resolution: int,
    source: str,
    name: str | None = None,
    cavities: Cavities = "fill",
    edge: float | None = None,
    corner: Float[np.ndarray, "3"] | None = None,
) -> MeshVoxels:
    """Return the voxels of a mesh that is one closed body and knows its unit.

    Parameters
    ----------
    source : str
        What to call it in messages.
    edge : float, optional
        Edge of the voxels in the unit of the mesh, instead of the resolution.
    corner : float array, shape (3,), optional
        Centre of a voxel of a common grid, in which the body's voxels then lie.

    Raises
    ------
    UnitError
        If the mesh carries no unit.
    GrainError
        If the resolution is too coarse for it.
    """
    if not body.units:
        raise UnitError(f"{source} does not contain its unit: give unit, for example unit='mm' (--unit mm).")
    low, high = np.asarray(body.bounds)
    edge = edge or float((high - low).max()) / int(resolution)
    counts = np.maximum(np.ceil((high - low) / edge - 1e-9).astype(int), 1)
    if corner is None:
        inside, first = _nearest_in_volume(body, edge, counts)
    else:
        first = (low + high) / 2 - edge * (counts - 1) / 2
        first = corner + np.floor((first - corner) / edge) * edge
        inside = _voxels_of(body, edge, first, counts + 1)
    if not inside.any():
        raise GrainError(
            f"{source} is too thin for a resolution of {int(counts.max())} voxels: raise the resolution."
        )
    _, sizes = label_pieces(inside)
    if len(sizes) > 1:
        lost = 1 - sizes.max() / sizes.sum()
        warnings.warn(
            f"{source} falls into {len(sizes)} pieces at a resolution of {int(counts.max())} voxels; "
            f"the largest was kept and {lost:.2%} of the volume dropped: raise the resolution.",
            GrainWarning,
            stacklevel=3,
        )
        inside = largest_piece(inside)
    else:
        _tell_other_volume(inside, edge, body, source)
    if cavities == "fill":
        # A cavity here would be a tunnel narrower than a voxel, closed by the sampling.
        inside = without_cavities(inside)
    return MeshVoxels(
        inside,
        VoxelSize(edge, edge, edge, parse_unit(body.units)),
        (float(first[0]), float(first[1]), float(first[2])),
        name or body.metadata.get("name") or "grain",
        round(body.metadata.get("filled_volume", 0.0) / edge**3),
    )


def _nearest_in_volume(
    body: trimesh.Trimesh, edge: float, counts: Int[np.ndarray, "3"]
) -> tuple[Bool[np.ndarray, "Z Y X"], Float[np.ndarray, "3"]]:
    """Return the voxels about a body's middle whose volume is nearest to the body's, and where they begin.

    A flat face along the grid takes in a layer of voxels or leaves it out as a whole. Where the volume
    shows that, each axis is tried with one voxel less.
    """
    low, high = np.asarray(body.bounds)
    lengths = (high - low) / edge
    middle = (low + high) / 2
    may_be_less = (counts > 1) & (counts - lengths > _ROUNDED) & (lengths - (counts - 1) > _ROUNDED)
    found = None
    for less in product(*((0, 1) if more else (0,) for more in may_be_less)):
        tried = counts - np.array(less)
        first = middle - edge * (tried - 1) / 2
        inside = _voxels_of(body, edge, first, tried)
        error = abs(np.count_nonzero(inside) * edge**3 / body.volume - 1)
        if found is None or error < found[0]:
            found = (error, inside, first)
        if found[0] < _TRUE:
            break
    assert found is not None
    return found[1], found[2]


def _voxels_of(
    body: trimesh.Trimesh, edge: float, first: Float[np.ndarray, "3"], counts: Int[np.ndarray, "3"]
) -> Bool[np.ndarray, "Z Y X"]:
    x, y, z = (int(count) for count in counts)
    return voxelise(body.vertices, body.faces, first, edge, (z, y, x))


def _tell_other_volume(
    inside: Bool[np.ndarray, "Z Y X"], edge: float, body: trimesh.Trimesh, source: str
) -> None:
    error = np.count_nonzero(inside) * edge**3 / body.volume - 1
    if abs(error) > _TOLD:
        warnings.warn(
            f"{source} has {abs(error):.1%} {'more' if error > 0 else 'less'} volume as voxels than as a "
            "mesh: raise the resolution.",
            GrainWarning,
            stacklevel=4,
        )
