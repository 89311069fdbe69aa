"""The farthest that two surfaces of triangles lie from each other."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

VerticesFaces = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]

_NEAR_TRIANGLES = 16
_CHUNK = 4_000


def hausdorff_distance(first: VerticesFaces, second: VerticesFaces) -> float:
    """Return the farthest that a vertex of either surface lies from the other surface.

    Parameters
    ----------
    first, second : tuple of vertices, shape (v, 3), and faces, shape (f, 3)
        In one unit, of triangles small against the bodies: between its vertices a surface is not asked.
    """
    return max(farthest_distance(first[0], second), farthest_distance(second[0], first))


def farthest_distance(points: Float[np.ndarray, "m 3"], surface: VerticesFaces) -> float:
    """Return the largest distance of points to a surface.

    Parameters
    ----------
    points : float array, shape (m, 3)
    surface : tuple of vertices, shape (v, 3), and faces, shape (f, 3)

    Notes
    -----
    The distance to the nearest vertex is never less than that to the surface: points are taken in falling
    order of it, until none that is left can lie farther than the farthest found.
    """
    from scipy.spatial import cKDTree

    vertices, faces = surface
    at_most, _ = cKDTree(vertices).query(points)
    triangles = vertices[faces]
    middles = cKDTree(triangles.mean(axis=1))
    near = min(_NEAR_TRIANGLES, len(faces))
    order, found = np.argsort(-at_most), 0.0
    for start in range(0, len(order), _CHUNK):
        chosen = order[start : start + _CHUNK]
        if at_most[chosen[0]] <= found:
            break
        _, nearest = middles.query(points[chosen], k=near)
        nearest = nearest.reshape(len(chosen), near)
        asked = np.repeat(points[chosen], near, axis=0)
        reached = closest_on_triangles(triangles[nearest.ravel()], asked)
        distances = np.linalg.norm(asked - reached, axis=1).reshape(len(chosen), near).min(axis=1)
        found = max(found, float(np.minimum(distances, at_most[chosen]).max()))
    return found


def closest_on_triangles(
    triangles: Float[np.ndarray, "m 3 3"], points: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, "m 3"]:
    """Return the point of each triangle that is nearest to the point of the same row.

    Parameters
    ----------
    triangles : float array, shape (m, 3, 3)
        The corners of each, in any unit.
    points : float array, shape (m, 3)
    """
    from trimesh.triangles import closest_point

    if not len(points):
        return np.empty((0, 3))
    # trimesh takes what is smaller than 1e-8 for nothing: the triangles of a grain in metres would be that.
    middle = triangles[0, 0]
    size = float(np.abs(triangles - triangles[:, :1]).max()) or 1.0
    reached = closest_point((triangles - middle) / size, (points - middle) / size)
    nearest: np.ndarray = np.asarray(reached) * size + middle
    return nearest
