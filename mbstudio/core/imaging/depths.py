"""How deep points lie in a prepared grain, and pushing control points inward."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from mbstudio.core.compiled import compiled
from mbstudio.core.imaging.preprocess import PreparedGrain


@compiled(error_model="numpy")
def depth_at(
    points: np.ndarray,
    distance: np.ndarray,
    origin: np.ndarray,
    spacing: np.ndarray,
    depth: np.ndarray,
    slope: np.ndarray,
) -> None:
    """Interpolate the signed distance and its gradient at points (rows x, y, z)."""
    nz, ny, nx = distance.shape
    for p in range(points.shape[1]):
        fx = min(max((points[0, p] - origin[0]) / spacing[0], 0.0), nx - 1.001)
        fy = min(max((points[1, p] - origin[1]) / spacing[1], 0.0), ny - 1.001)
        fz = min(max((points[2, p] - origin[2]) / spacing[2], 0.0), nz - 1.001)
        ix, iy, iz = int(fx), int(fy), int(fz)
        fx, fy, fz = fx - ix, fy - iy, fz - iz
        value = by_x = by_y = by_z = 0.0
        for cz in range(2):
            wz, sz = (fz, 1.0) if cz else (1.0 - fz, -1.0)
            for cy in range(2):
                wy, sy = (fy, 1.0) if cy else (1.0 - fy, -1.0)
                for cx in range(2):
                    wx, sx = (fx, 1.0) if cx else (1.0 - fx, -1.0)
                    corner = distance[iz + cz, iy + cy, ix + cx]
                    value += wz * wy * wx * corner
                    by_x += wz * wy * sx * corner
                    by_y += wz * sy * wx * corner
                    by_z += sz * wy * wx * corner
        depth[p] = value
        slope[0, p], slope[1, p], slope[2, p] = by_x / spacing[0], by_y / spacing[1], by_z / spacing[2]


def least_depths(prepared: PreparedGrain, n: int) -> tuple[float, float]:
    """Return the depth that control points are pulled to, and that below which none may go."""
    voxel, deepest = prepared.fineness, prepared.deepest
    soft = max(2 * voxel, float(np.clip(0.04 * np.sqrt(120 / n), 0.03, 0.08)))
    hard = max(1.2 * voxel, soft / 2)
    # Thin plates and grains of a few voxels have no such depth anywhere.
    return min(soft, 0.6 * deepest), min(hard, 0.4 * deepest)


def depths_of(
    prepared: PreparedGrain, points: Float64[np.ndarray, "3 p"]
) -> tuple[Float64[np.ndarray, "p"], Float64[np.ndarray, "3 p"]]:
    """Return signed distance (positive inside) and its gradient at points (rows x, y, z)."""
    depth, slope = np.empty(points.shape[1]), np.empty((3, points.shape[1]))
    depth_at(points, prepared.distance, prepared.origin, prepared.spacing, depth, slope)
    return depth, slope


def push_in(
    prepared: PreparedGrain,
    control: Float64[np.ndarray, "r n"],
    least: Float64[np.ndarray, "n"],
    fallback: Float64[np.ndarray, "r n"],
) -> None:
    """Move points (rows x, y, z, ...) shallower than `least` inward, in place; else to `fallback`."""
    for _ in range(3):
        depth, slope = depths_of(prepared, control[:3])
        low = depth < least
        if not low.any():
            return
        norm = np.maximum((slope[:, low] ** 2).sum(axis=0), 1e-3)
        control[:3, low] += slope[:, low] * ((least[low] - depth[low]) / norm)
    stuck = depths_of(prepared, control[:3])[0] < np.minimum(least, prepared.voxel) - 1e-9
    control[:3, stuck] = fallback[:3, stuck]


def settle_in(prepared: PreparedGrain, control: Float64[np.ndarray, "4 n"], least: float) -> None:
    """Bring the control points of a start, in place, as deep as the search allows and the shape lets."""
    start = control.copy()
    push_in(prepared, control, np.full(control.shape[1], least), start)
    depth = depths_of(prepared, control[:3])[0]
    outside = np.flatnonzero(depth < 0.25 * min(prepared.voxel, prepared.deepest))
    if len(outside):
        deep = np.argwhere(prepared.distance >= min(0.45 * prepared.voxel, prepared.deepest))
        places = deep[:, ::-1] * prepared.spacing + prepared.origin
        for i in outside:
            control[:3, i] = places[((places - control[:3, i]) ** 2).sum(axis=1).argmin()]


def count_outside(control: Float64[np.ndarray, "4 n"], prepared: PreparedGrain) -> int:
    """Return how many control points lie in no voxel of the prepared grain."""
    depth, _ = depths_of(prepared, control[:3])
    return int(np.count_nonzero(depth < -0.5 * prepared.voxel))
