"""The bodies of mesh files as the grains of one set, so that a project can hold them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import GrainWarning, UnitError
from mbstudio.core.grains.grain_mesh import MOST_KEPT, GrainMesh
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.grains.mesh_voxels import MeshVoxels, require_resolution, voxelise_body
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
_GAP = 0.06
"""Between bodies that lie side by side, as a share of their length."""
_PAGE = 1.4
"""Width over depth of many bodies that lie side by side."""
_READING = 0.4
"""Share of the work that reading is."""


def grain_set_from_meshes(
    meshes: str | Path | Sequence[str | Path],
    resolution: int = 120,
    unit: str | None = None,
    cavities: Cavities = "fill",
    *,
    on_failure: OnFailure | None = None,
    assumed_unit: str | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> GrainSet:
    """Return the bodies of mesh files as one set of grains, with their exact surfaces.

    The table has the columns ``name`` and ``file`` besides.

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
    assumed_unit : str, optional
        Unit of coordinates where a file does not know its own, and `unit` is not given.
    progress : callable, optional
        ``progress(share, message)`` after each file and each body; what it raises ends the work.

    Raises
    ------
    MeshError, UnitError, GrainError
        As `Grain.from_mesh`.
    """
    report = progress or (lambda _share, _message: None)
    require_resolution(resolution)
    paths = find_meshes(meshes)
    bodies = bodies_of(
        paths, unit, cavities, on_failure, assumed_unit=assumed_unit,
        on_read=lambda done, path: report(_READING * done / len(paths), path.name),
    )  # fmt: skip
    for body in bodies:
        if not body.units:
            raise UnitError(
                f"{body.metadata['file_name']} does not contain its unit: give unit, for example unit='mm' "
                "(--unit mm)."
            )
    if len(bodies) == 1:
        parts = [voxelise_body(bodies[0], resolution, bodies[0].metadata["path"], None, cavities)]
        return _described(_build_one(parts[0]), parts, bodies, np.ones((1, 3), int))
    bodies = [_in_unit(body, str(bodies[0].units)) for body in bodies]
    edge = _common_edge(bodies, resolution)
    corner = np.min([body.bounds[0] for body in bodies], axis=0) if len(paths) == 1 else None
    parts = []
    for done, body in enumerate(bodies):
        name = body.metadata["file_name"]
        report(_READING + (1 - _READING) * done / len(bodies), name)
        parts.append(voxelise_body(body, resolution, name, None, cavities, edge, corner))
    places = None if corner is None else _common_places(parts, edge)
    if places is None:
        places = _shelves(parts)
    return _described(_lay_out(parts, places, corner is not None), parts, bodies, places)


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
    least_edge = float((taken / _MOST_VOXELS) ** (1 / 3))
    if least_edge > 1.05 * edge:
        lowered = math.floor(resolution * edge / least_edge)
        warnings.warn(
            f"{len(bodies)} bodies of {resolution} voxels take more memory than there should be: they have "
            f"{lowered} voxels along a body of middle length instead.",
            GrainWarning,
            stacklevel=3,
        )
        resolution = lowered
    edge = max(edge, least_edge)
    least = min(_COARSE, math.ceil(resolution / 2))
    coarse = int(np.count_nonzero(lengths / edge < least))
    if coarse:
        warnings.warn(
            f"{coarse} of the {len(bodies)} bodies are less than {least} voxels long, because all share "
            "one voxel size: their shapes are coarse. Combine bodies of similar size.",
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
    """Return where bodies begin that lie side by side in rows, the first row at the far end of y.

    Seen from above they are read like a page, and their middles lie in one plane.
    """
    shapes = np.array([part.mask.shape for part in parts])
    gap = max(2, round(_GAP * float(np.median(shapes.max(axis=1)))))
    widths, depths = shapes[:, 2] + gap, shapes[:, 1] + gap
    # So many rows make a page as wide as it is to be for its depth.
    rows = max(1, round(math.sqrt(float(widths.sum()) / (_PAGE * float(depths.mean())))))
    width = max(float(widths.max()), float(widths.sum()) / rows)
    places, x, row = np.zeros_like(shapes), 0, 0
    in_row = np.zeros(len(parts), int)
    for number, wide in enumerate(widths.tolist()):
        if x and x + wide / 2 > width:
            x, row = 0, row + 1
        places[number, 2], in_row[number] = x + gap, row
        x += wide
    deep = np.array([depths[in_row == number].max() for number in range(row + 1)])
    begin = gap + np.concatenate([np.cumsum(deep[::-1])[::-1][1:], [0]])  # the last row comes first along y
    places[:, 1] = begin[in_row] + (deep[in_row] - gap - shapes[:, 1]) // 2
    places[:, 0] = 1 + (shapes[:, 0].max() - shapes[:, 0]) // 2
    return places


def _build_one(part: MeshVoxels) -> GrainSet:
    # A margin of one voxel: the grain is whole, no border cuts it off.
    labels = np.pad(part.mask.astype(np.int32), 1)
    x, y, z = (float(at - edge) for at, edge in zip(part.origin, part.voxel_size.xyz, strict=True))
    return build_grain_set(labels, part.voxel_size, (x, y, z))


def _lay_out(parts: list[MeshVoxels], places: Int[np.ndarray, "n 3"], in_one_frame: bool) -> GrainSet:
    shape = (places + [part.mask.shape for part in parts]).max(axis=0) + 1
    labels = np.zeros(shape, np.int32)
    for label, (part, place) in enumerate(zip(parts, places, strict=True), start=1):
        box = tuple(slice(int(at), int(at + size)) for at, size in zip(place, part.mask.shape, strict=True))
        labels[box][part.mask & (labels[box] == 0)] = label
    size = parts[0].voxel_size
    corner = np.array(parts[0].origin) - places[0][::-1] * size.x if in_one_frame else np.zeros(3)
    return build_grain_set(labels, size, (float(corner[0]), float(corner[1]), float(corner[2])))


def _described(
    grains: GrainSet, parts: list[MeshVoxels], bodies: list[trimesh.Trimesh], places: Int[np.ndarray, "n 3"]
) -> GrainSet:
    """Return grains with the names, files and exact surfaces of the bodies that they were made of.

    `places` are those (z, y, x) in the label volume at which the voxels of each body begin.
    """
    grains.table["name"] = [part.name for part in parts]
    grains.table["file"] = [body.metadata["path"] for body in bodies]
    count = sum(len(body.faces) for body in bodies)
    if count > MOST_KEPT:
        warnings.warn(
            f"The meshes have {count:,} triangles, more than the {MOST_KEPT:,} that are kept: their grains "
            "are shown and measured as voxels; reduce their triangles first to have the meshes themselves.",
            GrainWarning,
            stacklevel=3,
        )
        return grains
    starts = grains.voxel_size.positions(places, grains.origin)
    meshes = {}
    for label, (part, body) in enumerate(zip(parts, bodies, strict=True), start=1):
        moved = starts[label - 1] - np.array(part.origin)
        meshes[label] = GrainMesh(
            np.asarray(body.vertices, dtype=np.float64) + moved, np.asarray(body.faces, dtype=np.int32)
        )
        for array in (meshes[label].vertices, meshes[label].faces):
            array.flags.writeable = False
    grains.table["volume"] = [float(body.volume) for body in bodies]  # exactly, not by counting voxels
    return replace(grains, meshes=MappingProxyType(meshes))
