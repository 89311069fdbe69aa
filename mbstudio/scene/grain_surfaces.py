"""Surfaces of the grains of a set: the exact ones of mesh files where they are there, else of the voxels."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from mbstudio.scene.label_net import vertex_normals
from mbstudio.scene.surfaces import Surface, grain_surface, label_surface, merge

if TYPE_CHECKING:
    from mbstudio.core.grains import GrainSet
    from mbstudio.core.grains.grain_mesh import GrainMesh

FACETED = 1_000
"""Of so few triangles each is shown flat: between those of a cube there is nothing round."""
MOST_OF_ONE = 600_000
"""Triangles of one grain that is looked at."""


def surface_of_grain(grains: GrainSet, label: int, most: int = MOST_OF_ONE) -> Surface:
    """Return the surface of one grain to be looked at closely.

    Parameters
    ----------
    most : int
        Triangles of a mesh that are drawn: one with more is drawn coarser.
    """
    mesh = grains.meshes.get(label)
    return grain_surface(grains.grain(label)) if mesh is None else mesh_surface(mesh, most)


def overview_of_grains(
    grains: GrainSet, longest: int, most: int, only: Collection[int] | None = None
) -> Surface:
    """Return many grains as one surface; each triangle knows its grain's label.

    Parameters
    ----------
    longest : int
        As for :func:`~mbstudio.scene.surfaces.label_surface`, where there are voxels only.
    most : int
        Triangles of all meshes together.
    only : collection of int, optional
        Labels to show; all by default.
    """
    if not grains.meshes:
        return label_surface(grains, longest, only)
    total = sum(len(mesh.faces) for mesh in grains.meshes.values())
    wanted = sorted(grains.meshes) if only is None else sorted(set(only) & set(grains.meshes))
    share = min(1.0, most / total)
    meshes = [(grains.meshes[label], label) for label in wanted]
    return merge(
        [(mesh_surface(mesh, max(64, int(share * len(mesh.faces)))), label) for mesh, label in meshes]
    )


def mesh_surface(mesh: GrainMesh, most: int = MOST_OF_ONE) -> Surface:
    """Return the surface of a mesh, drawn by about `most` triangles at most."""
    points, faces = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)
    if len(faces) > most:
        points, faces = _coarser(points, faces, most)
    if len(faces) < FACETED:
        points, faces = points[faces.ravel()], np.arange(3 * len(faces), dtype=np.int64).reshape(-1, 3)
    return Surface(points.astype(np.float32), faces, vertex_normals(points, faces))


def _coarser(
    points: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], most: int
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]:
    """Join the vertices in each cell of a grid, as coarse as it takes."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2
    low = points.min(axis=0)
    # A cell holds two triangles about as large as its face.
    edge = math.sqrt(2 * area / most)
    while True:
        _, cell = np.unique(np.floor((points - low) / edge).astype(np.int64), axis=0, return_inverse=True)
        cell = cell.ravel()
        count = np.bincount(cell)
        joined = np.column_stack([np.bincount(cell, points[:, axis]) / count for axis in range(3)])
        kept = cell[faces]
        kept = kept[(kept[:, 0] != kept[:, 1]) & (kept[:, 1] != kept[:, 2]) & (kept[:, 2] != kept[:, 0])]
        if len(kept) <= 1.2 * most:
            return joined, kept
        edge *= 1.3
