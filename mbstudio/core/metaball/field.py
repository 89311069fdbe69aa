"""The metaball function at points and on grids.

Every kernel takes the control points as one array of rows ``x, y, z, k`` (structure of arrays),
so that the innermost loop runs over contiguous points or grid nodes and fills whole vector
registers. They hold no lock, start no thread and are cached on disk; the order of every sum is
fixed, so the result does not depend on the number of threads of the process.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64

from mbstudio.core.compiled import SAFE_MATH, compiled
from mbstudio.core.errors import AvatarError

# An upper bound of f in single precision below this is one below 1 with certainty.
_BOUND_IN_SINGLE = 0.999
_BLOCK = 256
# Control points further from a grid than so many of its lengths are drawn in, their share of f kept.
_FAR = 1e6
# In an upper bound no control point counts as nearer than that, and none as lighter than its square: so that
# the cell that holds it is never taken for empty, in single precision either.
_LEAST = 1e-18


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def _field_at(points: np.ndarray, control: np.ndarray, out: np.ndarray) -> None:
    total, n = points.shape[0], control.shape[1]
    px, py, pz = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    acc = np.empty(_BLOCK)
    for start in range(0, total, _BLOCK):
        count = min(_BLOCK, total - start)
        for p in range(count):
            px[p] = points[start + p, 0]
            py[p] = points[start + p, 1]
            pz[p] = points[start + p, 2]
            acc[p] = 0.0
        for i in range(n):
            cx, cy, cz, k = control[0, i], control[1, i], control[2, i], control[3, i]
            for p in range(count):
                dx, dy, dz = px[p] - cx, py[p] - cy, pz[p] - cz
                acc[p] += k / (dx * dx + dy * dy + dz * dz)
        for p in range(count):
            out[start + p] = acc[p]


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def _field_and_gradient_at(
    points: np.ndarray, control: np.ndarray, field: np.ndarray, gradient: np.ndarray
) -> None:
    total, n = points.shape[0], control.shape[1]
    px, py, pz = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    acc, gx, gy, gz = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    for start in range(0, total, _BLOCK):
        count = min(_BLOCK, total - start)
        for p in range(count):
            px[p] = points[start + p, 0]
            py[p] = points[start + p, 1]
            pz[p] = points[start + p, 2]
            acc[p] = gx[p] = gy[p] = gz[p] = 0.0
        for i in range(n):
            cx, cy, cz, k = control[0, i], control[1, i], control[2, i], control[3, i]
            for p in range(count):
                dx, dy, dz = px[p] - cx, py[p] - cy, pz[p] - cz
                inverse = 1.0 / (dx * dx + dy * dy + dz * dz)
                term = k * inverse
                slope = -2.0 * term * inverse
                acc[p] += term
                gx[p] += slope * dx
                gy[p] += slope * dy
                gz[p] += slope * dz
        for p in range(count):
            field[start + p] = acc[p]
            gradient[start + p, 0] = gx[p]
            gradient[start + p, 1] = gy[p]
            gradient[start + p, 2] = gz[p]


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def _field_on_grid(origin: np.ndarray, spacing: np.ndarray, control: np.ndarray, out: np.ndarray) -> None:
    nz, ny, nx = out.shape
    n = control.shape[1]
    xs = np.empty(nx, dtype=np.float32)
    for ix in range(nx):
        xs[ix] = origin[0] + ix * spacing[0]
    for iz in range(nz):
        z = np.float32(origin[2] + iz * spacing[2])
        for iy in range(ny):
            y = np.float32(origin[1] + iy * spacing[1])
            row = out[iz, iy]
            for ix in range(nx):
                row[ix] = 0.0
            # Two control points share one division: half the cost of the loop.
            for i in range(0, n - 1, 2):
                ax, bx, ka, kb = control[0, i], control[0, i + 1], control[3, i], control[3, i + 1]
                ay, by = y - control[1, i], y - control[1, i + 1]
                az, bz = z - control[2, i], z - control[2, i + 1]
                ca, cb = ay * ay + az * az, by * by + bz * bz
                for ix in range(nx):
                    da, db = xs[ix] - ax, xs[ix] - bx
                    da, db = da * da + ca, db * db + cb
                    row[ix] += (ka * db + kb * da) / (da * db)
            if n % 2:
                ax, ka = control[0, n - 1], control[3, n - 1]
                ay, az = y - control[1, n - 1], z - control[2, n - 1]
                ca = ay * ay + az * az
                for ix in range(nx):
                    da = xs[ix] - ax
                    row[ix] += ka / (da * da + ca)


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def _upper_bound_on_grid(
    origin: np.ndarray, spacing: np.ndarray, radius: np.float32, control: np.ndarray, out: np.ndarray
) -> None:
    """Bound f from above over the ball of `radius` about each node, in single precision."""
    nz, ny, nx = out.shape
    one, least = np.float32(1.0), np.float32(_LEAST)
    xs = np.empty(nx, dtype=np.float32)
    for ix in range(nx):
        xs[ix] = origin[0] + ix * spacing[0]
    for iz in range(nz):
        z = np.float32(origin[2] + iz * spacing[2])
        for iy in range(ny):
            y = np.float32(origin[1] + iy * spacing[1])
            row = out[iz, iy]
            for ix in range(nx):
                row[ix] = 0.0
            for i in range(control.shape[1]):
                dy, dz = y - control[1, i], z - control[2, i]
                cx, k, square = control[0, i], control[3, i], dy * dy + dz * dz
                for ix in range(nx):
                    dx = xs[ix] - cx
                    nearest = max(np.sqrt(dx * dx + square) - radius, least)
                    row[ix] += k * (one / (nearest * nearest))


@compiled(error_model="numpy")
def _outer_plane(positions: np.ndarray, weights: np.ndarray) -> float:
    """Return a t beyond which sum k / (t - t_i)**2 < 1: no point of the solid lies further along the axis."""
    top, total = positions.max(), weights.sum()
    low = top
    high: float = top + np.sqrt(total)
    for _ in range(60):
        middle = 0.5 * (low + high)
        bound = 0.0
        for i in range(len(positions)):
            distance = middle - positions[i]
            bound += weights[i] / (distance * distance)
        if bound >= 1.0:
            low = middle
        else:
            high = middle
    return high


def control_rows(
    centers: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "n"]
) -> Float64[np.ndarray, "4 n"]:
    """Return control points and weights as contiguous rows x, y, z, k, as the kernels take them."""
    return np.ascontiguousarray(np.vstack([np.asarray(centers, dtype=np.float64).T, weights]))


def own_length(control: Float64[np.ndarray, "4 n"]) -> float:
    """Return the power of two next below the size of a body: scaling by it changes no digit."""
    size = max(float(np.ptp(control[:3], axis=1).max()), float(np.sqrt(control[3].max())))
    return float(2.0 ** np.floor(np.log2(size)))


def scale_control(control: Float64[np.ndarray, "4 n"], factor: float) -> Float64[np.ndarray, "4 n"]:
    """Return control points with all lengths times `factor`, about the origin."""
    scaled: np.ndarray = control * factor
    scaled[3] *= factor
    return scaled


def _local_in_single(
    control: Float64[np.ndarray, "4 n"], middle: Float64[np.ndarray, "3"], length: float
) -> Float32[np.ndarray, "4 n"]:
    """Return control points about `middle` in units of `length`, whose squares single precision can hold."""
    local = control.copy()
    local[:3] = (control[:3] - middle[:, None]) / length
    local[3] = control[3] / length**2
    away = np.sqrt((local[:3] ** 2).sum(axis=0))
    if (far := away > _FAR).any():
        draw_in = _FAR / away[far]
        local[:3, far] *= draw_in
        local[3, far] *= draw_in**2
    return local.astype(np.float32)


def as_points(points: np.ndarray) -> Float64[np.ndarray, "m 3"]:
    """Return points as a contiguous array of shape (m, 3); AvatarError for any other shape."""
    array = np.ascontiguousarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise AvatarError(f"Points must have the shape (m, 3), not {array.shape}.")
    return array


def field_at(
    points: Float[np.ndarray, "m 3"], control: Float64[np.ndarray, "4 n"]
) -> Float64[np.ndarray, "m"]:
    """Return f at points (x, y, z); infinite on a control point.

    Parameters
    ----------
    points : float array, shape (m, 3)
    control : float array, shape (4, n)
        Rows x, y, z, k: see :func:`control_rows`. Same unit as the points.
    """
    array = as_points(points)
    out = np.empty(len(array))
    _field_at(array, control, out)
    return out


def field_and_gradient_at(
    points: Float[np.ndarray, "m 3"], control: Float64[np.ndarray, "4 n"]
) -> tuple[Float64[np.ndarray, "m"], Float64[np.ndarray, "m 3"]]:
    """Return f and its gradient at points (x, y, z); the gradient on a control point is NaN."""
    array = as_points(points)
    field, gradient = np.empty(len(array)), np.empty(array.shape)
    _field_and_gradient_at(array, control, field, gradient)
    return field, gradient


def field_on_grid(
    origin: Float[np.ndarray, "3"],
    spacing: Float[np.ndarray, "3"],
    shape: tuple[int, int, int],
    control: Float64[np.ndarray, "4 n"],
) -> Float32[np.ndarray, "Z Y X"]:
    """Return f on the nodes ``origin + (ix, iy, iz) * spacing`` in single precision.

    Parameters
    ----------
    origin, spacing : float array, shape (3,)
        First node and distance of neighbours, as (x, y, z).
    shape : tuple of int
        Nodes along z, y, x.
    control : float array, shape (4, n)

    Notes
    -----
    Works about the middle of the grid, so that a far away origin costs no precision.
    """
    spacing = np.asarray(spacing, dtype=np.float64)
    middle = np.asarray(origin, dtype=np.float64) + 0.5 * (np.array(shape[::-1]) - 1) * spacing
    # One unit of length for the whole grid keeps squares far from the limits of float32.
    length = float(np.max(spacing * shape[::-1]))
    out = np.empty(shape, dtype=np.float32)
    _field_on_grid(
        ((np.asarray(origin) - middle) / length).astype(np.float32), (spacing / length).astype(np.float32),
        _local_in_single(control, middle, length), out,
    )  # fmt: skip
    if np.isnan(out).any():  # a node on two coinciding control points
        out[np.isnan(out)] = np.inf
    return out


def solid_bounds(
    control: Float64[np.ndarray, "4 n"], rounds: int = 3, cells: int = 16
) -> Float64[np.ndarray, "2 3"]:
    """Return a box that surely holds the solid f >= 1, and little more.

    Starts from the planes beyond which ``sum k_i / (t - t_i)**2 < 1`` and then, `rounds` times,
    cuts away the outer layers of cells in which an upper bound of f stays below 1.
    """
    low, high = np.empty(3), np.empty(3)
    for axis in range(3):
        high[axis] = _outer_plane(control[axis], control[3])
        low[axis] = -_outer_plane(-control[axis], control[3])
    if not rounds:
        return np.array([low, high])
    low, high, _ = tighten_box(np.array([low, high]), control, rounds, cells)
    return np.array([low, high])


def tighten_box(
    box: Float64[np.ndarray, "2 3"],
    control: Float64[np.ndarray, "4 n"],
    rounds: int,
    cells: int,
    margin: float = 1.0,
) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"], Bool[np.ndarray, "Z Y X"]]:
    """Cut away the outer layers of cells of a box that surely hold nothing of the solid, `rounds` times.

    Returns the lowest and the highest corner of what is left, and which of its cells may hold something,
    indexed [z, y, x]. Those that touch a control point do: f is infinite there.
    """
    low, high = box
    # About the middle and in units of the box, as in field_on_grid.
    middle, length = 0.5 * (low + high), float((high - low).max())
    single = _local_in_single(control, middle, length)
    single[3] = np.maximum(single[3], np.float32(1.01 * _LEAST**2))
    low, high = (low - middle) / length, (high - middle) / length
    bound = np.empty((cells, cells, cells), dtype=np.float32)
    for _ in range(rounds):
        spacing = (high - low) / cells
        radius = np.float32(margin * 0.5 * np.linalg.norm(spacing))
        _upper_bound_on_grid(
            (low + 0.5 * spacing).astype(np.float32), spacing.astype(np.float32), radius, single, bound
        )
        full = bound >= _BOUND_IN_SINGLE
        kept = [slice(None)] * 3
        for axis in range(3):
            other = tuple(dim for dim in range(3) if dim != 2 - axis)
            used = np.flatnonzero(full.any(axis=other))
            low[axis], high[axis] = (
                low[axis] + used[0] * spacing[axis],
                low[axis] + (used[-1] + 1) * spacing[axis],
            )
            kept[2 - axis] = slice(used[0], used[-1] + 1)
        full = full[tuple(kept)]
    return middle + length * low, middle + length * high, full
