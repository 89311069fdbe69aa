"""The bodies of mesh files as the grains of one set, so that a project can hold them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import GrainWarning, UnitError
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.grains.mesh_voxels import MeshVoxels, voxelise_body
from mbstudio.core.meshes.bodies import Cavities, OnFailure, bodies_of
from mbstudio.core.meshes.listing import find_meshes
from mbstudio.core.units import conversion_factor

if TYPE_CHECKING:
    import trimesh

_MOST_VOXELS = 400_000_000
"""Of a label volume: 1.6 GB."""
_LEAST_SHARE = 3
"""The smallest of several bodies is at least one in so many of the voxels long that were asked for."""
_COARSE = 30
_GAP = 2


def grain_set_from_meshes(
    meshes: str | Path | Sequence[str | Path],
    resolution: int = 120,
    unit: str | None = None,
    cavities: Cavities = "fill",
    *,
    on_failure: OnFailure | None = None,
) -> GrainSet:
    """Return the bodies of mesh files as one set of grains, with their names in the table's column ``name``.

    A body alone keeps its place in its own frame. Several bodies have voxels of one size, with about
    `resolution` along a body of middle length; those of one file keep their places, those of several files
    lie side by side.

    Parameters
    ----------
    meshes : str, Path, or sequence of them
        Files, folders of meshes, and patterns.
    resolution, unit, cavities
        As for `Grain.from_mesh`.
    on_failure : callable, optional
        ``on_failure(path, error)`` takes the errors of single files, which are left out; without it, or if
        all files fail, the error is raised.

    Raises
    ------
    MeshError, UnitError, GrainError
        As `Grain.from_mesh`.
    """
    paths = find_meshes(meshes)
    bodies = bodies_of(paths, unit, cavities, on_failure)
    for body in bodies:
        if not body.units:
            raise UnitError(
                f"{body.metadata['file_name']} does not contain its unit: give unit, for example unit='mm' "
                "(--unit mm)."
            )
    if len(bodies) == 1:
        parts = [voxelise_body(bodies[0], resolution, str(paths[0]), None, cavities)]
        return _named(_alone(parts[0]), parts)
    bodies = [_in_unit(body, str(bodies[0].units)) for body in bodies]
    edge = _common_edge(bodies, resolution)
    corner = np.min([body.bounds[0] for body in bodies], axis=0) if len(paths) == 1 else None
    parts = [
        voxelise_body(body, resolution, body.metadata["file_name"], None, cavities, edge, corner)
        for body in bodies
    ]
    places = None if corner is None else _common_places(parts, edge)
    if places is None:
        places = _shelves(parts)
    return _named(_laid(parts, places, corner is not None), parts)


def _in_unit(body: trimesh.Trimesh, unit: str) -> trimesh.Trimesh:
    factor = conversion_factor(str(body.units), unit)
    if factor == 1:
        return body
    moved = body.copy()
    moved.vertices = np.asarray(body.vertices) * factor
    moved.units = unit
    return moved


def _common_edge(bodies: list[trimesh.Trimesh], resolution: int) -> float:
    extents = np.array([np.ptp(np.asarray(body.bounds), axis=0) for body in bodies])
    lengths = extents.max(axis=1)
    edge = min(float(np.median(lengths)) / resolution, _LEAST_SHARE * float(lengths.min()) / resolution)
    side = max(1, math.isqrt(len(bodies)))
    # An upper bound of what the shelves take: every body with the depth and the height of the largest.
    taken = extents[:, 0].sum() * extents[:, 1].max() * extents[:, 2].max() * (1 + 1 / side)
    edge = max(edge, float((taken / _MOST_VOXELS) ** (1 / 3)))
    least = min(_COARSE, math.ceil(resolution / 2))
    coarse = int(np.count_nonzero(lengths / edge < least))
    if coarse:
        warnings.warn(
            f"{coarse} of the {len(bodies)} bodies are less than {least} voxels long, because all share "
            "voxels of one size: their shapes are coarse; take bodies of similar size together.",
            GrainWarning,
            stacklevel=3,
        )
    return edge


def _common_places(parts: list[MeshVoxels], edge: float) -> Int[np.ndarray, "n 3"] | None:
    """Return where bodies of one frame begin in a common grid; None if it would take too much memory."""
    first = np.array([part.origin for part in parts])[:, ::-1]
    places = np.rint((first - first.min(axis=0)) / edge).astype(np.int64) + 1
    shape = (places + [part.mask.shape for part in parts]).max(axis=0) + 1
    return places if math.prod(shape.tolist()) <= _MOST_VOXELS else None


def _shelves(parts: list[MeshVoxels]) -> Int[np.ndarray, "n 3"]:
    """Return where bodies begin that stand side by side in rows."""
    shapes = np.array([part.mask.shape for part in parts])
    width = math.ceil(shapes[:, 2].sum() / max(1, math.isqrt(len(parts))))
    places, x, y, depth = [], _GAP, _GAP, 0
    for shape in shapes:
        if x > _GAP and x + shape[2] > width:
            x, y, depth = _GAP, y + depth + _GAP, 0
        places.append((1, y, x))
        x, depth = x + int(shape[2]) + _GAP, max(depth, int(shape[1]))
    return np.array(places)


def _alone(part: MeshVoxels) -> GrainSet:
    # A margin of one voxel: the grain is whole, no border cuts it off.
    labels = np.pad(part.mask.astype(np.int32), 1)
    x, y, z = (float(at - edge) for at, edge in zip(part.origin, part.voxel_size.xyz, strict=True))
    return build_grain_set(labels, part.voxel_size, (x, y, z))


def _laid(parts: list[MeshVoxels], places: Int[np.ndarray, "n 3"], in_one_frame: bool) -> GrainSet:
    shape = (places + [part.mask.shape for part in parts]).max(axis=0) + 1
    labels = np.zeros(shape, np.int32)
    for label, (part, place) in enumerate(zip(parts, places, strict=True), start=1):
        box = tuple(slice(int(at), int(at + size)) for at, size in zip(place, part.mask.shape, strict=True))
        labels[box][part.mask & (labels[box] == 0)] = label
    size = parts[0].voxel_size
    corner = np.array(parts[0].origin) - places[0][::-1] * size.x if in_one_frame else np.zeros(3)
    return build_grain_set(labels, size, (float(corner[0]), float(corner[1]), float(corner[2])))


def _named(grains: GrainSet, parts: list[MeshVoxels]) -> GrainSet:
    grains.table["name"] = [part.name for part in parts]
    return grains
