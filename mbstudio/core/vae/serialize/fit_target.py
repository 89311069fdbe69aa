"""What a body is to the template fit: surface points, depth, volume and area in a working frame."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import MbstudioError, SerializationError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.grains.pieces import largest_piece, without_cavities
from mbstudio.core.grains.voxelisation import voxelise
from mbstudio.core.imaging.hull import along_curve
from mbstudio.core.imaging.preprocess import PreparedGrain, prepare
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.surfaces import check_mesh, surface_area
from mbstudio.core.units import VoxelSize
from mbstudio.core.vae.serialize.frame import PrincipalFrame, principal_frame

if TYPE_CHECKING:
    import trimesh

    from mbstudio.core.vae.serialize.frame import Body

GRAIN_SIDE = 120
"""Voxels on the longest side of a grain's working grid, as for `fit`: its surface comes from them."""
MESH_SIDE = 60
"""Of a mesh's: they tell only how deep control points and places inside lie."""
HULL_POINTS = 16_000
_MESH_CELLS = 80


def prepare_body(
    body: Body, *, unit: str | None = None, seed: int = 0, name: str = "The body"
) -> tuple[PreparedGrain, PrincipalFrame]:
    """Return a grain, mesh or avatar ready to be fitted, and its principal frame.

    A grain's surface is that of its voxels, smoothed as `fit` does it. Meshes and avatars are
    sampled on their own triangles; only the depth of points is told by voxels.

    Raises
    ------
    SerializationError
        If the body has no principal frame, or cannot be prepared for a fit.
    """
    try:
        if isinstance(body, Grain):
            frame = principal_frame(body, name=name)
            return prepare(body, seed, working_side=GRAIN_SIDE, hull_points=HULL_POINTS), frame
        if isinstance(body, Avatar):
            mesh = body.mesh(cells=_MESH_CELLS)
            mesh.units = body.unit
        else:
            mesh = check_mesh(body)
        frame = principal_frame(mesh, unit=unit, name=name)
        return prepare_mesh(mesh, frame, seed), frame
    except MbstudioError as error:
        if isinstance(error, SerializationError) and name in str(error):
            raise
        raise SerializationError(f"{name} cannot be serialized: {error}") from error


def prepare_mesh(
    mesh: trimesh.Trimesh,
    frame: PrincipalFrame,
    seed: int,
    *,
    side: int = MESH_SIDE,
    hull_points: int = HULL_POINTS,
) -> PreparedGrain:
    """Return a closed mesh prepared by way of voxels, its hull points then taken from its own triangles.

    Parameters
    ----------
    mesh : trimesh.Trimesh
    frame : PrincipalFrame
        Of the mesh; in its unit.
    seed : int
    side : int
        Voxels on the longest side, which tell how deep points lie.
    hull_points : int
        Points on its triangles.
    """
    rough = prepare(_voxels_of(mesh, frame.unit, side), seed, working_side=side, hull="voxels")
    points = surface_points(mesh, hull_points, np.random.default_rng([seed, 1]))
    volume = np.pi / 6 * frame.diameter**3
    area = surface_area(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces))
    return replace(
        rough,
        hull=along_curve((points - rough.center) / rough.scale),
        volume=volume / rough.scale**3,
        area=area / rough.scale**2,
        thickness=2 * volume / area / rough.scale,
        fineness=0.5 * rough.voxel,
    )


def _voxels_of(mesh: trimesh.Trimesh, unit: str, side: int) -> Grain:
    """Return a checked mesh as voxels: `Grain.from_mesh` would check and clean it anew, at twice the cost."""
    low, high = np.asarray(mesh.bounds)
    edge = float((high - low).max()) / side
    counts = np.maximum(np.ceil((high - low) / edge - 1e-9).astype(int), 1)
    first = (low + high) / 2 - edge * (counts - 1) / 2
    shape = (int(counts[2]), int(counts[1]), int(counts[0]))
    inside = voxelise(np.asarray(mesh.vertices), np.asarray(mesh.faces), first, edge, shape)
    if not inside.any():
        raise SerializationError(f"It is thinner than 1/{side} of its length.")
    origin = (float(first[0]), float(first[1]), float(first[2]))
    return Grain(without_cavities(largest_piece(inside)), VoxelSize(edge, edge, edge, unit), origin)


def surface_points(
    mesh: trimesh.Trimesh, count: int, rng: np.random.Generator
) -> Float[np.ndarray, "count 3"]:
    """Return points spread over a mesh, one in each equal share of its area."""
    corners = np.asarray(mesh.vertices, dtype=np.float64)[np.asarray(mesh.faces)]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    passed = np.cumsum(areas)
    wanted = (np.arange(count) + rng.random(count)) / count * passed[-1]
    face = np.minimum(np.searchsorted(passed, wanted), len(areas) - 1)
    a, b = rng.random((2, count))
    over = a + b > 1
    a[over], b[over] = 1 - a[over], 1 - b[over]
    first, second, third = corners[face].transpose(1, 0, 2)
    points: np.ndarray = first + a[:, None] * (second - first) + b[:, None] * (third - first)
    return points
