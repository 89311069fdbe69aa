"""Well-shaped triangles on an avatar's surface.

Marching cubes leaves slivers that engines refuse. Here its mesh is made isotropic: long edges
split, short ones collapsed, edges flipped where that raises the smallest angle, vertices moved
along the surface to the middle of their neighbours and back onto it by Newton steps.

References
----------
Botsch & Kobbelt (2004), A remeshing approach to multiresolution modeling, SGP.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.dem.shapes.remesh_passes import collapse_edges, flip_edges, split_edges
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.surface_distance import farthest_distance
from mbstudio.core.metrics.surfaces import project_to_surface, signed_volumes, surface_area

if TYPE_CHECKING:
    import trimesh

GOOD_ANGLE = np.radians(22.0)
_ROUNDS = 8
_PASSES = 60
_EDGES_ACROSS = 4
"""Along the shortest side at least: a flake is not meshed by triangles that are wider than it is thick."""
_REPAIRS = 16
_ACCEPTED_ANGLE = np.radians(18.0)
_STRAYING = 0.5
"""Of an edge: the farthest that the surface may lie from the mesh."""
_SHORTER, _TRIES = 0.8, 6

Mesh = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]


def well_shaped_mesh(avatar: Avatar, cells: int = 32, volume: float | None = None) -> trimesh.Trimesh:
    """Return a closed mesh of nearly equilateral triangles along the avatar's surface.

    Parameters
    ----------
    avatar : Avatar
    cells : int
        Edges along its longest side, or more where it is thin.
    volume : float, optional
        Volume of the avatar in unit**3. Flat triangles between points of a rounded surface hold too
        little; with it, the vertices are moved outwards by the one distance that makes up for it.

    Returns
    -------
    trimesh.Trimesh
        In the avatar's unit and frame, outward, of the genus of its marching-cubes mesh. Where edges of the
        length asked for cannot follow the surface, or only with slivers, they are shorter.
    """
    import trimesh

    start = avatar.mesh(cells=max(24, round(1.4 * cells)))
    vertices, faces = np.array(start.vertices, dtype=float), np.array(start.faces, dtype=np.int64)
    sides = np.sort(np.ptp(vertices, axis=0))
    edge = min(float(sides[2]) / cells, float(sides[0]) / _EDGES_ACROSS)
    start_mesh = project_to_surface(avatar, vertices, edge), faces
    reach, best_angle, best_distance = _STRAYING * edge, -1.0, np.inf
    for _ in range(_TRIES):
        tried, its_faces = _isotropic(avatar, *start_mesh, edge)
        if volume is not None:
            tried = _with_volume(avatar, tried, its_faces, volume)
        angle = float(angles_of(tried, its_faces).min())
        distance = farthest_distance(start_mesh[0], (tried, its_faces))
        # First the surface, then the triangles: an edge wider than a horn is thick cuts it off.
        rank, before = (_grade(d, a, reach) for d, a in ((distance, angle), (best_distance, best_angle)))
        if rank > before:
            vertices, faces, best_angle, best_distance = tried, its_faces, angle, distance
        if best_angle >= _ACCEPTED_ANGLE and best_distance <= reach:
            break
        edge *= _SHORTER
    return trimesh.Trimesh(vertices, faces, process=False)


def _grade(distance: float, angle: float, reach: float) -> tuple[float, float]:
    return -max(distance / reach, 1.0), min(angle, _ACCEPTED_ANGLE)


def _isotropic(
    avatar: Avatar, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], edge: float
) -> Mesh:
    """Return the mesh with edges of nearly one length."""
    for _ in range(_ROUNDS):
        vertices, faces = split_edges(vertices, faces, 4 / 3 * edge)
        vertices, faces = _collapse_short(vertices, faces, edge)
        faces = flip_edges(vertices, faces)
        vertices = relax(avatar, vertices, faces, edge)
    for _ in range(4):
        faces = flip_edges(vertices, faces)
        vertices = relax(avatar, vertices, faces, edge)
    return _repair(avatar, vertices, faces, edge)


def _collapse_short(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], edge: float) -> Mesh:
    """Collapse short edges until few are left; one pass leaves the neighbours of a collapsed edge alone."""
    for _ in range(_PASSES):
        before = len(faces)
        vertices, faces = collapse_edges(vertices, faces, 4 / 5 * edge, 4 / 3 * edge)
        if before - len(faces) < 0.01 * before:
            break
        faces = flip_edges(vertices, faces)
    return vertices, faces


def _with_volume(
    avatar: Avatar, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], volume: float
) -> Float[np.ndarray, "v 3"]:
    """Move all vertices along their normals by one distance so that the mesh has this volume."""
    outward = -np.asarray(avatar.gradient(vertices))
    outward /= np.maximum(np.linalg.norm(outward, axis=1), 1e-300)[:, None]
    for _ in range(3):
        missing = volume - float(signed_volumes(vertices, faces).sum())
        vertices = vertices + missing / surface_area(vertices, faces) * outward
    return vertices


def _repair(
    avatar: Avatar, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], edge: float
) -> Mesh:
    """Collapse the shortest edges of what thin triangles are left; return the best mesh seen."""
    best, best_angle = (vertices, faces), float(angles_of(vertices, faces).min())
    for _ in range(_REPAIRS):
        if best_angle >= GOOD_ANGLE:
            break
        thin = angles_of(vertices, faces).min(axis=1) < GOOD_ANGLE
        vertices, faces = collapse_edges(vertices, faces, 1.2 * edge, 2.0 * edge, only=thin)
        for _ in range(3):
            faces = flip_edges(vertices, faces)
            vertices = relax(avatar, vertices, faces, edge)
        angle = float(angles_of(vertices, faces).min())
        if angle > best_angle:
            best, best_angle = (vertices, faces), angle
    return best


def relax(
    avatar: Avatar, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], edge: float
) -> Float[np.ndarray, "v 3"]:
    """Move each vertex along the surface towards the area-weighted middle of the triangles around it."""
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    middles = corners.mean(axis=1) * areas[:, None]
    of_vertex = faces.ravel()
    weight = np.bincount(of_vertex, np.repeat(areas, 3), len(vertices))
    target = (
        np.stack(
            [np.bincount(of_vertex, np.repeat(middles[:, axis], 3), len(vertices)) for axis in range(3)],
            axis=1,
        )
        / np.maximum(weight, 1e-300)[:, None]
    )
    normals = np.asarray(avatar.gradient(vertices))
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    step = target - vertices
    step -= np.einsum("ij,ij->i", step, normals)[:, None] * normals
    return project_to_surface(avatar, vertices + 0.8 * step, 0.5 * edge)


def angles_of(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Return the angles of each triangle in radians."""
    corners = vertices[faces]
    angles = []
    for corner in range(3):
        a = corners[:, (corner + 1) % 3] - corners[:, corner]
        b = corners[:, (corner + 2) % 3] - corners[:, corner]
        angles.append(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("fi,fi->f", a, b)))
    return np.stack(angles, axis=1)
