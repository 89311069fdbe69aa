"""How far an avatar's surface lies from its grain's, point by point, with sign."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.metrics.surface_distance import closest_on_triangles

_NEAR_TRIANGLES = 8
_CHUNK = 4_000


@dataclass(frozen=True, eq=False)
class Deviation:
    """Signed distances of an avatar's surface to its grain's, positive where it lies outside the grain.

    Attributes
    ----------
    distances : float array, shape (m,)
        One for each vertex of the avatar's surface, in `unit`.
    rms : float
        Root mean square over the avatar's area.
    mean : float
        Mean over the avatar's area.
    unit : str
    """

    distances: Float[np.ndarray, " m"]
    rms: float
    mean: float
    unit: str

    @property
    def largest(self) -> float:
        """The distance of the largest size, with its sign."""
        return float(self.distances[np.argmax(np.abs(self.distances))])


def deviation(
    surface: tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]],
    reference: tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]],
    unit: str,
) -> Deviation:
    """Return the signed distance from each vertex of a surface to another surface.

    Parameters
    ----------
    surface : tuple of vertices, shape (v, 3), and faces, shape (f, 3)
        Whose vertices are asked: the avatar's.
    reference : tuple of vertices, shape (w, 3), and faces, shape (g, 3)
        Closed, faces outward, of triangles small against the body: the grain's.
    unit : str
        Canonical unit of both.

    Raises
    ------
    ValueError
        If either has no triangles.
    """
    vertices, faces = surface
    if not len(faces) or not len(reference[1]):
        raise ValueError("A deviation needs two surfaces with at least one triangle each.")
    distances = signed_distances(np.asarray(vertices, dtype=float), reference)
    corners = np.asarray(vertices, dtype=float)[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    weight = np.bincount(faces.ravel(), np.repeat(areas / 3, 3), minlength=len(vertices))
    share = weight / (weight.sum() or 1.0)
    rms = float(np.sqrt((share * distances**2).sum()))
    return Deviation(distances, rms, float((share * distances).sum()), unit)


def signed_distances(
    points: Float[np.ndarray, "m 3"], surface: tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]
) -> Float[np.ndarray, " m"]:
    """Return the distance of points to a closed surface, positive outside.

    Notes
    -----
    The nearest of the eight triangles whose middles are nearest. The sign is that against the normal
    there, which is interpolated from the vertices': at edges and corners it tells inside from outside
    where the normal of one face cannot (Bærentzen and Aanæs 2005).
    """
    from scipy.spatial import cKDTree

    vertices, faces = np.asarray(surface[0], dtype=float), np.asarray(surface[1])
    corners = vertices[faces]
    normals = _vertex_normals(vertices, faces, corners)
    middles = cKDTree(corners.mean(axis=1))
    near = min(_NEAR_TRIANGLES, len(faces))
    result = np.empty(len(points))
    for start in range(0, len(points), _CHUNK):
        asked = points[start : start + _CHUNK]
        _, nearest = middles.query(asked, k=near)
        nearest = nearest.reshape(len(asked), near)
        reached = closest_on_triangles(corners[nearest.ravel()], np.repeat(asked, near, axis=0))
        reached = reached.reshape(len(asked), near, 3)
        away = asked[:, None] - reached
        best = np.argmin((away**2).sum(axis=2), axis=1)
        rows = np.arange(len(asked))
        away, place, face = away[rows, best], reached[rows, best], nearest[rows, best]
        outward = _interpolated(place, corners[face], normals[faces[face]])
        side = np.where((away * outward).sum(axis=1) < 0, -1.0, 1.0)
        result[start : start + _CHUNK] = side * np.linalg.norm(away, axis=1)
    return result


def _vertex_normals(
    vertices: Float[np.ndarray, "w 3"], faces: Int[np.ndarray, "g 3"], corners: Float[np.ndarray, "g 3 3"]
) -> Float[np.ndarray, "w 3"]:
    """Return unit normals at the vertices, each face weighted by its angle there."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    result = np.zeros_like(vertices)
    for corner in range(3):
        first = corners[:, (corner + 1) % 3] - corners[:, corner]
        second = corners[:, (corner + 2) % 3] - corners[:, corner]
        sine = np.linalg.norm(across, axis=1)
        angle = np.arctan2(sine, (first * second).sum(axis=1))
        for axis in range(3):
            result[:, axis] += np.bincount(faces[:, corner], angle * flat[:, axis], minlength=len(vertices))
    return np.asarray(result / np.maximum(np.linalg.norm(result, axis=1, keepdims=True), 1e-300))


def _interpolated(
    points: Float[np.ndarray, "m 3"], corners: Float[np.ndarray, "m 3 3"], values: Float[np.ndarray, "m 3 3"]
) -> Float[np.ndarray, "m 3"]:
    """Return values at the corners of triangles, interpolated at points of them."""
    shares = np.empty((len(points), 3))
    for corner in range(3):
        first, second = corners[:, (corner + 1) % 3], corners[:, (corner + 2) % 3]
        shares[:, corner] = np.linalg.norm(np.cross(first - points, second - points), axis=1)
    shares /= np.maximum(shares.sum(axis=1, keepdims=True), 1e-300)
    return np.asarray((shares[:, :, None] * values).sum(axis=1))
