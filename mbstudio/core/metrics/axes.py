"""Axis lengths of a body: the edges of its minimum-volume oriented bounding box."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from mbstudio.core.compiled import compiled
from mbstudio.core.errors import MeasureError
from mbstudio.core.metrics.sphere_directions import turns

_STARTS = 1500
_KEPT = 200
_TRIALS = 24
_STAGES = 24
_SHRINK = 0.7
_TIERS = {4: 96, 8: 32, 13: 8}
"""From these stages on: how many frames are still followed."""
_ABREAST = 64


@dataclass(frozen=True, eq=False)
class BoundingBox:
    """An oriented bounding box.

    Attributes
    ----------
    lengths : float array, shape (3,)
        L_s <= L_i <= L_l, the edge lengths in ascending order.
    directions : float array, shape (3, 3)
        Unit vectors of these edges as rows, right-handed.
    """

    lengths: Float[np.ndarray, " 3"]
    directions: Float[np.ndarray, "3 3"]


def convex_hull(points: Float[np.ndarray, "m 3"]) -> ConvexHull:
    """Return the hull of a point set; MeasureError if it has no volume."""
    try:
        return ConvexHull(points)
    except QhullError as error:
        raise MeasureError(
            "The body is flat or empty: it has no volume, so its shape factors are undefined."
        ) from error


def minimum_bounding_box(hull: ConvexHull) -> BoundingBox:
    """Return the oriented bounding box of least volume, to about 1e-4 of its volume.

    The volume as a function of the rotation has kinks wherever the touching vertices change,
    so it is searched without derivatives: evenly spread rotations (and the body's principal
    frame and hull faces) first, then ever smaller turns about the best few of them.

    Parameters
    ----------
    hull : scipy.spatial.ConvexHull
        Convex hull of the body (:func:`convex_hull`).
    """
    corners = hull.points[hull.vertices]
    centre = corners.mean(axis=0)
    scale = float(np.abs(corners - centre).max())
    corners = (corners - centre) / scale
    frames = np.concatenate([spread_frames(), _suggest_frames(corners, hull)])
    # A few hundred extreme corners tell the good frames from the bad; all corners decide at the end.
    few = corners[np.unique(_heights(spread_frames()[::2, 0], corners).argmax(axis=1))]
    volumes = _extents(few, frames).prod(axis=1)
    best = np.argsort(volumes, kind="stable")[:_KEPT]
    frames, volumes = frames[best], volumes[best]
    offsets = turns(_TRIALS)
    angle = np.radians(12.0)
    touching = few
    for stage in range(_STAGES):
        if stage in _TIERS:
            frames = frames[np.argsort(volumes, kind="stable")[: _TIERS[stage]]]
            reach = angle / (1.0 - _SHRINK)
            touching = _keep_reachable(corners, frames, reach)
            volumes = _extents(touching, frames).prod(axis=1)
        touching = _keep_reachable(touching, frames, angle / (1.0 - _SHRINK))
        step = Rotation.from_rotvec(offsets * angle).as_matrix()
        trials = np.einsum("tij,kjl->ktil", step, frames)
        trial_volumes = _extents(touching, trials.reshape(-1, 3, 3)).prod(axis=1).reshape(len(frames), -1)
        winner = trial_volumes.argmin(axis=1)
        rows = np.arange(len(frames))
        better = trial_volumes[rows, winner] < volumes
        frames = np.where(better[:, None, None], trials[rows, winner], frames)
        volumes = np.where(better, trial_volumes[rows, winner], volumes)
        angle *= _SHRINK
    frame = frames[volumes.argmin()]
    return sort_edges(np.ptp(frame @ corners.T, axis=1) * scale, frame)


def box_along(points: Float[np.ndarray, "m 3"], directions: Float[np.ndarray, "3 3"]) -> BoundingBox:
    """Return the box of points whose edges lie along these orthogonal unit vectors (rows).

    Raises
    ------
    MeasureError
        If they are not orthogonal unit vectors.
    """
    frame = np.asarray(directions, dtype=float)
    if frame.shape != (3, 3) or not np.allclose(frame @ frame.T, np.eye(3), atol=1e-6):
        raise MeasureError(
            "The directions of a box must be three orthogonal unit vectors as rows, shape (3, 3); "
            f"these, of shape {frame.shape}, are not."
        )
    return sort_edges(np.ptp(frame @ points.T, axis=1), frame)


def sort_edges(lengths: Float[np.ndarray, " 3"], directions: Float[np.ndarray, "3 3"]) -> BoundingBox:
    """Return a box with its edges in ascending order and right-handed."""
    order = np.argsort(lengths, kind="stable")
    rows = directions[order]
    rows[2] *= np.sign(np.linalg.det(rows))
    return BoundingBox(lengths[order], rows)


def _extents(
    corners: Float[np.ndarray, "m 3"], frames: Float[np.ndarray, "k 3 3"]
) -> Float[np.ndarray, "k 3"]:
    """Edge lengths of the boxes whose edges are the rows of each frame."""
    rows = np.ascontiguousarray(frames.reshape(-1, 3), dtype=np.float64)
    return _widths(rows, np.ascontiguousarray(corners.T, dtype=np.float64)).reshape(-1, 3)


@compiled(fastmath={"nnan", "ninf", "nsz", "contract", "reassoc"})
def _widths(rows: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Extent of corners (3, m) along each row; a compiled loop, as the product would be m times as large."""
    out = np.empty(len(rows))
    px, py, pz = corners[0], corners[1], corners[2]
    # Rows side by side: over the corners instead, highest and lowest would wait for one another.
    a, b, c, high, low = (np.empty(_ABREAST), np.empty(_ABREAST), np.empty(_ABREAST),
                          np.empty(_ABREAST), np.empty(_ABREAST))  # fmt: skip
    for start in range(0, len(rows), _ABREAST):
        count = min(_ABREAST, len(rows) - start)
        for k in range(_ABREAST):
            row = rows[start + min(k, count - 1)]
            a[k], b[k], c[k] = row[0], row[1], row[2]
            high[k], low[k] = -1e300, 1e300
        for j in range(corners.shape[1]):
            x, y, z = px[j], py[j], pz[j]
            for k in range(_ABREAST):
                height = a[k] * x + b[k] * y + c[k] * z
                high[k] = max(high[k], height)
                low[k] = min(low[k], height)
        out[start : start + count] = high[:count] - low[:count]
    return out


def _heights(rows: Float[np.ndarray, "r 3"], corners: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "r m"]:
    """Heights of corners along each row; no matrix product, whose threads would wait for those of others."""
    x, y, z = np.ascontiguousarray(corners.T)
    heights: np.ndarray = rows[:, :1] * x + rows[:, 1:2] * y + rows[:, 2:] * z
    return heights


def _keep_reachable(
    corners: Float[np.ndarray, "m 3"], frames: Float[np.ndarray, "k 3 3"], angle: float
) -> Float[np.ndarray, "c 3"]:
    """Keep the corners that can touch a box once its frame has turned by at most this angle.

    The corners lie within sqrt(3) of the origin, so no height changes by more than sqrt(3) times the angle.
    """
    heights = _heights(frames.reshape(-1, 3), corners)
    slack = 2.0 * np.sqrt(3.0) * angle
    near = (heights >= heights.max(axis=1, keepdims=True) - slack) | (
        heights <= heights.min(axis=1, keepdims=True) + slack
    )
    kept: np.ndarray = corners[near.any(axis=0)]
    return kept


def _suggest_frames(corners: Float[np.ndarray, "m 3"], hull: ConvexHull) -> Float[np.ndarray, "k 3 3"]:
    """Frames that the body itself suggests: principal axes, and its largest hull faces with their edges."""
    principal = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[2]
    triangles = hull.points[hull.simplices]
    edges = triangles[:, 1] - triangles[:, 0]
    normals = np.cross(edges, triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    largest = np.argsort(-areas, kind="stable")[:40]
    largest = largest[areas[largest] > 0]
    n = normals[largest] / areas[largest, None]
    e = edges[largest] / np.linalg.norm(edges[largest], axis=1)[:, None]
    return np.concatenate([principal[None], np.stack([n, e, np.cross(n, e)], axis=1)])


@cache
def spread_frames() -> Float[np.ndarray, "k 3 3"]:
    """Evenly spread rotations (super-Fibonacci spiral: Alexa, CVPR 2022)."""
    phi, psi = np.sqrt(2.0), 1.533751168755204288118041
    s = np.arange(_STARTS) + 0.5
    r, big_r = np.sqrt(s / _STARTS), np.sqrt(1.0 - s / _STARTS)
    alpha, beta = 2 * np.pi * s / phi, 2 * np.pi * s / psi
    quaternions = np.stack(
        [r * np.sin(alpha), r * np.cos(alpha), big_r * np.sin(beta), big_r * np.cos(beta)], axis=1
    )
    frames: np.ndarray = Rotation.from_quat(quaternions).as_matrix()
    return frames


def inertia_lengths(second: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " 3"]:
    """Return the axes of the homogeneous ellipsoid with these second moments, ascending.

    Parameters
    ----------
    second : float array, shape (3, 3)
        Second moments about the centre, over the volume: a**2 / 5 along a semi-axis a.

    Raises
    ------
    MeasureError
        If a moment is not positive.
    """
    moments = np.linalg.eigvalsh(second)
    if not moments[0] > 0:
        raise MeasureError("The body is flat, so no ellipsoid has the same inertia.")
    return 2.0 * np.sqrt(5.0 * moments)
