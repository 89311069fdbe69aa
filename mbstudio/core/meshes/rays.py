"""How often a ray along z meets triangles: tells inside from outside whatever the winding."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from mbstudio.core.compiled import compiled

# Shares of the size by which rays are shifted, so that none runs along edges of round coordinates.
_JITTER = (3.1415926e-7, 2.7182818e-7)


def inside(
    places: Float[np.ndarray, "m 3"], points: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Bool[np.ndarray, " m"]:
    """Return which places a closed surface encloses."""
    size = np.ptp(points[faces.ravel()], axis=0).max()
    shifted = np.asarray(places, float) + np.array([*_JITTER, 0.0]) * size
    crossed: np.ndarray = _crossings(shifted, points, np.ascontiguousarray(faces), -1) % 2 == 1
    return crossed


def looks_outward(face: int, points: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> bool:
    """Return whether a face turns its front to the outside of a closed surface."""
    a, b, c = points[faces[face]]
    axis = int(np.abs(np.cross(b - a, c - a)).argmax())
    points = np.roll(points, 2 - axis, axis=1)  # seen along the axis that the face looks at most
    a, b, c = points[faces[face]]
    upward = np.cross(b - a, c - a)[2] > 0
    above = _crossings(place_in(points, faces[face][None]), points, np.ascontiguousarray(faces), face)[0]
    return bool(upward == (above % 2 == 0))


def place_in(points: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Return a place within each face that lies on no diagonal of squares."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    places: np.ndarray = 0.5130 * a + 0.2907 * b + 0.1963 * c
    return places


@compiled()
def _crossings(places: np.ndarray, points: np.ndarray, faces: np.ndarray, ignored: int) -> np.ndarray:
    found = np.zeros(places.shape[0], np.int64)
    for face in range(faces.shape[0]):
        if face == ignored:
            continue
        i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
        bx, by, bz = points[j, 0], points[j, 1], points[j, 2]
        cx, cy, cz = points[k, 0], points[k, 1], points[k, 2]
        low_x, high_x = min(ax, bx, cx), max(ax, bx, cx)
        low_y, high_y = min(ay, by, cy), max(ay, by, cy)
        high_z = max(az, bz, cz)
        for place in range(places.shape[0]):
            px, py, pz = places[place, 0], places[place, 1], places[place, 2]
            if px < low_x or px > high_x or py < low_y or py > high_y or pz > high_z:
                continue
            # An edge belongs to the triangle on one side of it only, whichever way it is run through.
            over_a = _side(bx, by, cx, cy, px, py)
            over_b = _side(cx, cy, ax, ay, px, py)
            over_c = _side(ax, ay, bx, by, px, py)
            if not ((over_a > 0 and over_b > 0 and over_c > 0) or (over_a < 0 and over_b < 0 and over_c < 0)):
                continue
            height = (over_a * az + over_b * bz + over_c * cz) / (over_a + over_b + over_c)
            if height > pz:
                found[place] += 1
    return found


@compiled()
def _side(ax: float, ay: float, bx: float, by: float, px: float, py: float) -> float:
    """On which side of the edge a-b the point p lies; exactly opposite for b-a."""
    if ax < bx or (ax == bx and ay < by):
        return (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    return -((ax - bx) * (py - by) - (ay - by) * (px - bx))
