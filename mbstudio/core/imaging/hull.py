"""Points on a grain's surface: spread evenly, where planes touch it, or the outermost voxels."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from mbstudio.core.compiled import compiled
from mbstudio.core.metrics.sphere_directions import half_sphere

_PLANES = 300  # that touch the surface in its tips


@compiled()
def _points_on_triangles(
    vertices: np.ndarray, faces: np.ndarray, areas: np.ndarray, fractions: np.ndarray, jitter: np.ndarray
) -> np.ndarray:
    """Place one point in each equal share of the total area (faces in their order)."""
    total = areas.sum()
    out = np.empty((len(fractions), 3))
    face, passed = 0, 0.0
    for p in range(len(fractions)):
        wanted = fractions[p] * total
        while passed + areas[face] < wanted and face < len(areas) - 1:
            passed += areas[face]
            face += 1
        a, b = jitter[p, 0], jitter[p, 1]
        if a + b > 1.0:
            a, b = 1.0 - a, 1.0 - b
        for axis in range(3):
            corner = vertices[faces[face, 0], axis]
            out[p, axis] = (
                corner
                + a * (vertices[faces[face, 1], axis] - corner)
                + b * (vertices[faces[face, 2], axis] - corner)
            )
    return out


@compiled()
def _places_on_curve(cells: np.ndarray) -> np.ndarray:
    """Return the place along Morton's curve of cells (x, y, z) of 10 bits an axis."""
    out = np.zeros(len(cells), np.int64)
    for p in range(len(cells)):
        for bit in range(10):
            for axis in range(3):
                out[p] |= ((cells[p, axis] >> bit) & 1) << (3 * bit + axis)
    return out


def along_curve(points: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3"]:
    """Return points in the order in which Morton's space-filling curve passes through them.

    Parameters
    ----------
    points : float array, shape (m, 3)
        At least one point, in any unit.

    References
    ----------
    Morton (1966), A computer oriented geodetic data base, IBM Ltd.
    """
    low = points.min(axis=0)
    longest = max(float((points.max(axis=0) - low).max()), 1e-300)
    cells = ((points - low) * (1023 / longest)).astype(np.int64)
    return points[np.argsort(_places_on_curve(cells), kind="stable")]


def points_on_surface(
    share: np.ndarray,
    spacing: np.ndarray,
    smoothing: float,
    sharpened: bool,
    count: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return points spread evenly over the surface, its corners, and its area; relative to the first voxel.

    Voxels are smoothed by twice a Gaussian less that Gaussian twice over: without a second moment
    it takes the steps off flat faces but, unlike the Gaussian alone, hardly moves curved ones.
    """
    from scipy.ndimage import gaussian_filter
    from skimage.measure import marching_cubes

    # One smoothing length for all axes: voxels of different edges get different sigmas.
    sigma = smoothing * np.cbrt(spacing.prod()) / spacing[::-1]
    smooth = gaussian_filter(share, sigma, truncate=3.0)
    if sharpened:
        smooth *= 2
        smooth -= gaussian_filter(0.5 * smooth, sigma, truncate=3.0)
    if smooth.max() <= 0.5:  # a grain of one or two voxels vanishes under the filter
        smooth = share
    vertices, faces, _, _ = marching_cubes(smooth, 0.5, gradient_direction="descent")
    points = vertices[:, ::-1].astype(np.float64) * spacing
    corners = points[faces]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    count = min(count, max(4000, len(faces)))
    fractions = (np.arange(count) + rng.random(count)) / count
    chosen = _points_on_triangles(points, faces.astype(np.int64), areas, fractions, rng.random((count, 2)))
    # Even samples of few voxels would only be truer to their steps.
    return along_curve(chosen) if sharpened else chosen, points, float(areas.sum())


@compiled(fastmath={"nnan", "ninf", "nsz", "contract", "reassoc"})
def _farthest(points: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return the point (column of x, y, z) farthest along each direction, and farthest against it."""
    found = np.empty((2, len(directions)), np.int64)
    total, heights = points.shape[1], np.empty(256, np.float32)
    for d in range(len(directions)):
        a, b, c = directions[d]
        high, low = np.float32(-1e30), np.float32(1e30)
        for start in range(0, total, 256):
            # Slices that start at 0 let the compiler see contiguous rows: several times faster.
            px, py, pz = points[0, start:], points[1, start:], points[2, start:]
            count, highest, lowest = min(256, total - start), np.float32(-1e30), np.float32(1e30)
            for p in range(count):
                height = a * px[p] + b * py[p] + c * pz[p]
                heights[p] = height
                highest, lowest = max(highest, height), min(lowest, height)
            if highest > high:
                high = highest
                found[0, d] = start + heights[:count].argmax()
            if lowest < low:
                low = lowest
                found[1, d] = start + heights[:count].argmin()
    return found


def tips_of(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points that planes from all sides touch first, and the share of the planes of each."""
    middle = points.mean(axis=0)
    rows = np.ascontiguousarray((points - middle).T, dtype=np.float32)
    found = _farthest(rows, half_sphere(_PLANES // 2).astype(np.float32))
    touched, counts = np.unique(found, return_counts=True)
    return points[touched], counts / counts.sum()


def outermost_voxels(
    mask: np.ndarray, spacing: np.ndarray, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Return the centres (x, y, z), relative to the first voxel, of voxels with a face to the outside."""
    from scipy.ndimage import binary_erosion

    outermost = np.argwhere(mask & ~binary_erosion(mask))
    if len(outermost) > count:
        outermost = outermost[rng.choice(len(outermost), count, replace=False, shuffle=False)]
    points: np.ndarray = outermost[:, ::-1] * spacing
    return points
