"""Feret (caliper) diameters of a body: how far apart two parallel planes are that touch it.

All three depend on the convex hull alone. The largest is the diameter of the hull, found
exactly; the smallest is its minimal width; the middle one is the largest width across the
direction of the largest, found exactly from the hull's projection along it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import cdist, pdist

from mbstudio.core.metrics.sphere_directions import frame_along, half_sphere, turns

_DIRECTIONS = 1500
_FACES = 500
_STARTS = 24
_STAGES = 24
_SHRINK = 0.65


@dataclass(frozen=True, eq=False)
class FeretDiameters:
    """Caliper diameters of a body.

    Attributes
    ----------
    lengths : float array, shape (3,)
        Smallest, middle and largest, in unit.
    directions : float array, shape (3, 3)
        Unit vectors, as rows, across which they are measured; the first need not be perpendicular
        to the others.
    """

    lengths: Float[np.ndarray, " 3"]
    directions: Float[np.ndarray, "3 3"]


def feret_diameters(hull: ConvexHull) -> FeretDiameters:
    """Return the smallest, middle and largest caliper diameter of a hull.

    Parameters
    ----------
    hull : scipy.spatial.ConvexHull

    Notes
    -----
    The smallest is within 1e-4 of the minimum over all directions: all hull faces (the 500 largest)
    and 1500 evenly spread directions are tried, then ever smaller turns about the best 24.
    """
    points = hull.points[hull.vertices]
    first, second = _farthest_pair(points)
    along = second - first
    largest = float(np.linalg.norm(along))
    along = along / largest
    frame = frame_along(along)
    flat = points @ frame[:2].T
    try:
        flat = flat[ConvexHull(flat).vertices]
    except QhullError:  # a needle, seen along itself
        flat = flat[:1]
    middle, across = _widest(flat)
    smallest, thin = _least_width(points, hull)
    return FeretDiameters(
        np.array([smallest, max(middle, smallest), largest]), np.stack([thin, across @ frame[:2], along])
    )


def _widest(flat: Float[np.ndarray, "m 2"]) -> tuple[float, Float[np.ndarray, " 2"]]:
    """Return the diameter of a planar point set and its direction."""
    if len(flat) < 2:
        return 0.0, np.array([1.0, 0.0])
    i, j = np.triu_indices(len(flat), 1)
    pair = int(pdist(flat).argmax())
    step = flat[j[pair]] - flat[i[pair]]
    length = float(np.linalg.norm(step))
    return length, step / length


def _farthest_pair(points: Float[np.ndarray, "m 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Return the two points farthest apart, exactly.

    With a lower bound on their distance, points too close to the centre to take part are left out.
    """
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    radii = np.linalg.norm(points - centre, axis=1)
    first = points[radii.argmax()]
    bound = 0.0
    for _ in range(3):
        distances = np.linalg.norm(points - first, axis=1)
        bound = max(bound, float(distances.max()))
        first = points[distances.argmax()]
    taking_part = points[radii >= bound - radii.max() - 1e-9 * bound]
    best, pair = -1.0, (points[0], points[0])
    for part in np.array_split(taking_part, -(-len(taking_part) // 500)):
        distances = cdist(part, taking_part, "sqeuclidean")
        place = int(distances.argmax())
        if distances.flat[place] > best:
            best = float(distances.flat[place])
            i, j = divmod(place, len(taking_part))
            pair = (part[i], taking_part[j])
    return pair


def _least_width(points: Float[np.ndarray, "m 3"], hull: ConvexHull) -> tuple[float, np.ndarray]:
    """Return the minimal width and its direction.

    A minimal width lies between a face and a corner or between two edges; the latter lie in kinks, so that
    the search uses no derivatives.
    """
    triangles = hull.points[hull.simplices]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    sizes = np.linalg.norm(normals, axis=1)
    chosen = np.argsort(-sizes, kind="stable")[:_FACES]
    chosen = chosen[sizes[chosen] > 0]
    directions = np.concatenate([normals[chosen] / sizes[chosen, None], half_sphere(_DIRECTIONS)])
    widths = _widths(points, directions)
    best = np.argsort(widths, kind="stable")[:_STARTS]
    directions, widths = directions[best], widths[best]
    offsets = turns(24)
    angle = np.radians(5.0)
    radius = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
    for _ in range(_STAGES):
        # Only corners that can touch once a direction has turned as far as the search may still turn it.
        slack = 2.0 * radius * angle / (1.0 - _SHRINK)
        heights = directions @ points.T
        near = (heights >= heights.max(axis=1, keepdims=True) - slack) | (
            heights <= heights.min(axis=1, keepdims=True) + slack
        )
        points = points[near.any(axis=0)]
        trials = directions[:, None] + angle * offsets
        trials /= np.linalg.norm(trials, axis=2, keepdims=True)
        found = _widths(points, trials.reshape(-1, 3)).reshape(len(directions), -1)
        winner = found.argmin(axis=1)
        rows = np.arange(len(directions))
        better = found[rows, winner] < widths
        directions = np.where(better[:, None], trials[rows, winner], directions)
        widths = np.where(better, found[rows, winner], widths)
        angle *= _SHRINK
    least = int(widths.argmin())
    return float(widths[least]), directions[least]


def _widths(
    points: Float[np.ndarray, "m 3"], directions: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, " k"]:
    """Return the width across each direction."""
    parts = np.array_split(directions, -(-len(directions) * len(points) // 2_000_000))
    return np.concatenate([np.ptp(part @ points.T, axis=1) for part in parts])
