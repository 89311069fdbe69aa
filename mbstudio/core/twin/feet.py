"""The foot points of voxels near a surface: distance, normal and curvature there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from mbstudio.core.compiled import compiled
from mbstudio.core.metaball.field import field_on_grid
from mbstudio.core.metaball.signed_distance import u_gradient_hessian

_MOST_STEPS = 8
_ON_SURFACE = 1e-5  # voxels
_SETTLED = 2e-3  # voxels along the surface: the distance is then right to a millionth
_LEAST_STRETCH = 0.2  # of 1 + d kappa: nearer to the centre of curvature no foot point is sought
_MARGIN = 1.0  # voxels: by how much a distance of first order may be wrong


class Feet(NamedTuple):
    """Voxels near the surface of a body, and what their foot points are like; lengths in voxels.

    Attributes
    ----------
    places : int array, shape (m,)
        Flat indices into the box.
    distance : float array, shape (m,)
        Negative inside.
    foot : float array, shape (3, m)
        Rows x, y, z.
    normal : float array, shape (3, m)
        Outward, rows x, y, z.
    bend, gauss : float array, shape (m,)
        Sum and product of the principal curvatures; positive sum where convex.
    slope : float array, shape (m,)
        |grad f| at the foot point.
    core : int array, shape (c,)
        Flat indices of the voxels deeper inside.
    """

    places: Int64[np.ndarray, "m"]
    distance: Float64[np.ndarray, "m"]
    foot: Float64[np.ndarray, "3 m"]
    normal: Float64[np.ndarray, "3 m"]
    bend: Float64[np.ndarray, "m"]
    gauss: Float64[np.ndarray, "m"]
    slope: Float64[np.ndarray, "m"]
    core: Int64[np.ndarray, "c"]


@compiled(error_model="numpy")
def drop_foot(point: np.ndarray, control: np.ndarray, state: np.ndarray, foot: np.ndarray) -> float:
    """Find the foot of a point at which `state` holds u, its gradient and Hessian; return the distance.

    `foot` becomes x, y, z, the normal, sum and product of the curvatures, and |grad f|; NaN is returned
    where no foot is found.
    """
    size = np.sqrt(state[1] ** 2 + state[2] ** 2 + state[3] ** 2)
    if not size > 1e-12:
        return np.nan
    nx, ny, nz = state[1] / size, state[2] / size, state[3] / size
    along = (
        nx * nx * state[4] + ny * ny * state[5] + nz * nz * state[6]
        + 2.0 * (nx * ny * state[7] + nx * nz * state[8] + ny * nz * state[9])
    )  # fmt: skip
    walk = (state[0] - 1.0) / size
    stretch = size - 0.5 * walk * along
    if stretch > 0.3 * size:
        walk = (state[0] - 1.0) / stretch
    fx, fy, fz = point[0] - walk * nx, point[1] - walk * ny, point[2] - walk * nz
    for _ in range(_MOST_STEPS):
        u_gradient_hessian(fx, fy, fz, control, state)
        size = np.sqrt(state[1] ** 2 + state[2] ** 2 + state[3] ** 2)
        if not size > 1e-12:
            return np.nan
        nx, ny, nz = state[1] / size, state[2] / size, state[3] / size
        rest = (state[0] - 1.0) / size
        dx, dy, dz = point[0] - fx, point[1] - fy, point[2] - fz
        height = dx * nx + dy * ny + dz * nz
        tx, ty, tz = dx - height * nx, dy - height * ny, dz - height * nz
        # Two directions across the normal (Duff et al. 2017).
        sign = 1.0 if nz >= 0.0 else -1.0
        p = -1.0 / (sign + nz)
        q = nx * ny * p
        ax, ay, az = 1.0 + sign * nx * nx * p, sign * q, -sign * nx
        bx, by, bz = q, sign + ny * ny * p, -ny
        hax = state[4] * ax + state[7] * ay + state[8] * az
        hay = state[7] * ax + state[5] * ay + state[9] * az
        haz = state[8] * ax + state[9] * ay + state[6] * az
        saa = (ax * hax + ay * hay + az * haz) / size
        sab = (bx * hax + by * hay + bz * haz) / size
        sbb = (
            bx * (state[4] * bx + state[7] * by + state[8] * bz)
            + by * (state[7] * bx + state[5] * by + state[9] * bz)
            + bz * (state[8] * bx + state[9] * by + state[6] * bz)
        ) / size  # fmt: skip
        distance: float = height + rest
        ta, tb = tx * ax + ty * ay + tz * az, tx * bx + ty * by + tz * bz
        maa, mab, mbb = 1.0 + distance * saa, distance * sab, 1.0 + distance * sbb
        det = maa * mbb - mab * mab
        if maa > _LEAST_STRETCH and det > _LEAST_STRETCH**2:
            da, db = (mbb * ta - mab * tb) / det, (maa * tb - mab * ta) / det
        else:
            da, db = 0.5 * ta, 0.5 * tb
        moved = np.sqrt(da * da + db * db)
        if moved < _SETTLED and abs(rest) < _ON_SURFACE:
            foot[0], foot[1], foot[2] = fx - rest * nx, fy - rest * ny, fz - rest * nz
            foot[3], foot[4], foot[5] = nx, ny, nz
            foot[6], foot[7] = saa + sbb, saa * sbb - sab * sab
            foot[8] = 2.0 * size
            return distance
        # The surface bends away from its tangent plane by half the curvature.
        drop = rest + 0.5 * (saa * da * da + 2.0 * sab * da * db + sbb * db * db)
        fx += da * ax + db * bx - drop * nx
        fy += da * ay + db * by - drop * ny
        fz += da * az + db * bz - drop * nz
    return np.nan


@compiled(error_model="numpy")
def _sort_voxels(
    field: np.ndarray,
    low: np.ndarray,
    spacing: np.ndarray,
    control: np.ndarray,
    reach: float,
    places: np.ndarray,
    distance: np.ndarray,
    feet: np.ndarray,
    core: np.ndarray,
) -> tuple[int, int]:
    """Fill the voxels within `reach` of the surface, and those deeper inside; return how many of each."""
    nz, ny, nx = field.shape
    state, point, foot = np.empty(10), np.empty(3), np.empty(9)
    near = deep = 0
    for iz in range(nz):
        for iy in range(ny):
            for ix in range(nx):
                f = field[iz, iy, ix]
                if f < 0.02:  # seven times farther out than the surface of a ball
                    continue
                flat = (iz * ny + iy) * nx + ix
                point[0] = low[0] + ix * spacing[0]
                point[1] = low[1] + iy * spacing[1]
                point[2] = low[2] + iz * spacing[2]
                u_gradient_hessian(point[0], point[1], point[2], control, state)
                inside = state[0] < 1.0
                size = np.sqrt(state[1] ** 2 + state[2] ** 2 + state[3] ** 2)
                if abs(state[0] - 1.0) < (1.3 * reach + _MARGIN) * size:
                    found = drop_foot(point, control, state, foot)
                    if abs(found) <= reach:
                        places[near] = flat
                        distance[near] = found
                        for k in range(9):
                            feet[k, near] = foot[k]
                        near += 1
                        continue
                if inside:
                    core[deep] = flat
                    deep += 1
    return near, deep


def find_feet(
    control: Float64[np.ndarray, "4 n"],
    low: Float64[np.ndarray, "3"],
    spacing: Float64[np.ndarray, "3"],
    shape: tuple[int, int, int],
    reach: float,
) -> Feet:
    """Return the voxels of a box near the surface of a body, with their foot points, and those of its core.

    Parameters
    ----------
    control : float array, shape (4, n)
        Rows x, y, z, k, in voxels.
    low : float array, shape (3,)
        Centre of the box's first voxel (x, y, z).
    spacing : float array, shape (3,)
        Edges of a voxel (x, y, z).
    shape : tuple of int
        (Z, Y, X) of the box.
    reach : float
        How far from the surface voxels are taken.
    """
    field = field_on_grid(low, spacing, shape, control)
    count = field.size
    places, core = np.empty(count, np.int64), np.empty(count, np.int64)
    distance, feet = np.empty(count), np.empty((9, count))
    near, deep = _sort_voxels(field, low, spacing, control, reach, places, distance, feet, core)
    kept = feet[:, :near].copy()
    return Feet(
        places[:near].copy(), distance[:near].copy(), kept[:3], kept[3:6], kept[6], kept[7], kept[8],
        core[:deep].copy(),
    )  # fmt: skip


@compiled(error_model="numpy")
def _feet_of_points(points: np.ndarray, control: np.ndarray, distance: np.ndarray, feet: np.ndarray) -> None:
    state, foot = np.empty(10), np.empty(9)
    for p in range(len(points)):
        u_gradient_hessian(points[p, 0], points[p, 1], points[p, 2], control, state)
        distance[p] = drop_foot(points[p], control, state, foot)
        for k in range(9):
            feet[k, p] = foot[k]


def feet_of_points(points: Float64[np.ndarray, "m 3"], control: Float64[np.ndarray, "4 n"]) -> Feet:
    """Return the foot points of any points near the surface; their distance is NaN where there is none."""
    distance, feet = np.empty(len(points)), np.full((9, len(points)), np.nan)
    _feet_of_points(np.ascontiguousarray(points, dtype=np.float64), control, distance, feet)
    places = np.arange(len(points))
    return Feet(places, distance, feet[:3], feet[3:6], feet[6], feet[7], feet[8], np.empty(0, np.int64))
