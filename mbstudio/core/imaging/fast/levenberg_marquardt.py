"""Kernels of the fast search: residual rows, their normal matrix, and its solution.

Points are rows x, y, z (structure of arrays) in single precision, in the working frame; the
parameters are ln k of all control points, then their x, y and z. One thread, fixed order of sums.
"""

from __future__ import annotations

import numpy as np

from mbstudio.core.compiled import SAFE_MATH, compiled

_CHUNK = 256
_SUMMED = 1536


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def field_of_rows(points: np.ndarray, control: np.ndarray, out: np.ndarray) -> None:
    """Write f at points (rows, float32) for control points (rows, float32)."""
    total, n = points.shape[1], control.shape[1]
    for start in range(0, total, _CHUNK):
        # Slices that start at 0 let the compiler see contiguous rows: several times faster.
        px, py, pz = points[0, start:], points[1, start:], points[2, start:]
        acc, count = out[start:], min(_CHUNK, total - start)
        for p in range(count):
            acc[p] = 0.0
        for i in range(n):
            cx, cy, cz, k = control[0, i], control[1, i], control[2, i], control[3, i]
            for p in range(count):
                dx, dy, dz = px[p] - cx, py[p] - cy, pz[p] - cz
                acc[p] += k / (dx * dx + dy * dy + dz * dz)


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def steepness_of_rows(points: np.ndarray, control: np.ndarray, out: np.ndarray) -> None:
    """Write |grad f| / f at points."""
    total, n = points.shape[1], control.shape[1]
    f, gx, gy, gz = (
        np.empty(_CHUNK, np.float32), np.empty(_CHUNK, np.float32),
        np.empty(_CHUNK, np.float32), np.empty(_CHUNK, np.float32),
    )  # fmt: skip
    for start in range(0, total, _CHUNK):
        count = min(_CHUNK, total - start)
        px, py, pz = points[0, start:], points[1, start:], points[2, start:]
        for p in range(count):
            f[p] = gx[p] = gy[p] = gz[p] = 0.0
        for i in range(n):
            cx, cy, cz, k = control[0, i], control[1, i], control[2, i], control[3, i]
            for p in range(count):
                dx, dy, dz = px[p] - cx, py[p] - cy, pz[p] - cz
                inverse = np.float32(1.0) / (dx * dx + dy * dy + dz * dz)
                term = k * inverse
                f[p] += term
                term *= inverse
                gx[p] += term * dx
                gy[p] += term * dy
                gz[p] += term * dz
        for p in range(count):
            out[start + p] = np.float32(2.0) * np.sqrt(gx[p] * gx[p] + gy[p] * gy[p] + gz[p] * gz[p]) / f[p]


# Strict arithmetic: with fast-math flags a few calls in a hundred thousand, with the same numbers in
# arrays elsewhere in memory, rounded differently, and a fit was not repeatable to the last bit.
@compiled(error_model="numpy")
def curvature_of_rows(points: np.ndarray, control: np.ndarray, out: np.ndarray) -> None:
    """Write twice the mean curvature of the level of f through each point, positive where convex."""
    n = control.shape[1]
    acc = np.empty((10, _CHUNK), np.float32)
    for start in range(0, points.shape[1], _CHUNK):
        count = min(_CHUNK, points.shape[1] - start)
        px, py, pz = points[0, start:], points[1, start:], points[2, start:]
        gx, gy, gz, fourth = acc[0], acc[1], acc[2], acc[3]
        xx, yy, zz, xy, xz, yz = acc[4], acc[5], acc[6], acc[7], acc[8], acc[9]
        acc[:] = 0.0
        for i in range(n):
            cx, cy, cz, k = control[0, i], control[1, i], control[2, i], control[3, i]
            for p in range(count):
                dx, dy, dz = px[p] - cx, py[p] - cy, pz[p] - cz
                inverse = np.float32(1.0) / (dx * dx + dy * dy + dz * dz)
                term = k * inverse * inverse
                fourth[p] += term
                gx[p] += term * dx
                gy[p] += term * dy
                gz[p] += term * dz
                term *= inverse
                xx[p] += term * dx * dx
                yy[p] += term * dy * dy
                zz[p] += term * dz * dz
                xy[p] += term * dx * dy
                xz[p] += term * dx * dz
                yz[p] += term * dy * dz
        # grad f = -2 g, the Hessian is 8 T - 2 fourth I, its trace 2 fourth; the divergence of the
        # outward normal -grad f / |grad f| follows.
        for p in range(count):
            square = gx[p] * gx[p] + gy[p] * gy[p] + gz[p] * gz[p]
            form = gx[p] * (gx[p] * xx[p] + np.float32(2.0) * (gy[p] * xy[p] + gz[p] * xz[p]))
            form += gy[p] * (gy[p] * yy[p] + np.float32(2.0) * gz[p] * yz[p]) + gz[p] * gz[p] * zz[p]
            bend = np.float32(8.0) * form / square - np.float32(4.0) * fourth[p]
            out[start + p] = bend / (np.float32(2.0) * np.sqrt(square))


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def jacobian_of_rows(points: np.ndarray, control: np.ndarray, factor: np.ndarray, out: np.ndarray) -> None:
    """Write d(row)/d(parameter) as out[parameter, point], for rows with derivative `factor` by f."""
    total, n = points.shape[1], control.shape[1]
    for start in range(0, total, _CHUNK):
        px, py, pz = points[0, start:], points[1, start:], points[2, start:]
        weight, count = factor[start:], min(_CHUNK, total - start)
        for i in range(n):
            cx, cy, cz, k = control[0, i], control[1, i], control[2, i], control[3, i]
            by_k, by_x = out[i, start:], out[n + i, start:]
            by_y, by_z = out[2 * n + i, start:], out[3 * n + i, start:]
            for p in range(count):
                dx, dy, dz = px[p] - cx, py[p] - cy, pz[p] - cz
                inverse = np.float32(1.0) / (dx * dx + dy * dy + dz * dz)
                slope = weight[p] * k * inverse
                by_k[p] = slope
                slope *= np.float32(2.0) * inverse
                by_x[p] = slope * dx
                by_y[p] = slope * dy
                by_z[p] = slope * dz


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def weighted_sums_of_rows(rows: np.ndarray, weights: np.ndarray, out: np.ndarray) -> None:
    """Write the sum of each row times `weights` (its first places), in double precision."""
    for a in range(rows.shape[0]):
        row, total = rows[a], 0.0
        for p in range(len(weights)):
            total += np.float64(row[p]) * weights[p]
        out[a] = total


@compiled(inline="always")
def _tile(
    a0: np.ndarray,
    a1: np.ndarray,
    a2: np.ndarray,
    a3: np.ndarray,
    b0: np.ndarray,
    b1: np.ndarray,
    b2: np.ndarray,
    b3: np.ndarray,
    count: int,
    zero: float | np.float32,
) -> tuple[float | np.float32, ...]:
    """Return the 16 dot products of four rows with four others, over their first `count` places."""
    s00 = s01 = s02 = s03 = s10 = s11 = s12 = s13 = zero
    s20 = s21 = s22 = s23 = s30 = s31 = s32 = s33 = zero
    for p in range(count):
        u0, u1, u2, u3 = a0[p], a1[p], a2[p], a3[p]
        v0, v1, v2, v3 = b0[p], b1[p], b2[p], b3[p]
        s00 += u0 * v0
        s01 += u0 * v1
        s02 += u0 * v2
        s03 += u0 * v3
        s10 += u1 * v0
        s11 += u1 * v1
        s12 += u1 * v2
        s13 += u1 * v3
        s20 += u2 * v0
        s21 += u2 * v1
        s22 += u2 * v2
        s23 += u2 * v3
        s30 += u3 * v0
        s31 += u3 * v1
        s32 += u3 * v2
        s33 += u3 * v3
    return s00, s01, s02, s03, s10, s11, s12, s13, s20, s21, s22, s23, s30, s31, s32, s33


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def add_normal_matrix(
    rows: np.ndarray, residual: np.ndarray, matrix: np.ndarray, gradient: np.ndarray
) -> None:
    """Add J J^T to the lower triangle of `matrix` and J r to `gradient`, J = rows [parameter, point].

    Tiles of 4 x 4 parameters keep 16 sums in registers; each sums at most `_SUMMED` products in single
    precision before it goes to double.
    """
    size, total = rows.shape
    for start in range(0, total, _SUMMED):
        stop = min(start + _SUMMED, total)
        for a in range(size):
            row, dot = rows[a], np.float32(0.0)
            for p in range(start, stop):
                dot += row[p] * residual[p]
            gradient[a] += dot
        # Slices that start at 0 let the compiler see contiguous rows: 6 times faster than an offset.
        for a in range(0, size, 4):
            a0, a1, a2, a3 = (
                rows[a, start:stop],
                rows[a + 1, start:stop],
                rows[a + 2, start:stop],
                rows[a + 3, start:stop],
            )
            for b in range(0, a + 4, 4):
                b0, b1, b2, b3 = (
                    rows[b, start:stop],
                    rows[b + 1, start:stop],
                    rows[b + 2, start:stop],
                    rows[b + 3, start:stop],
                )
                (
                    s00, s01, s02, s03, s10, s11, s12, s13, s20, s21, s22, s23, s30, s31, s32, s33,
                ) = _tile(a0, a1, a2, a3, b0, b1, b2, b3, stop - start, np.float32(0.0))  # fmt: skip
                matrix[a, b] += s00
                matrix[a, b + 1] += s01
                matrix[a, b + 2] += s02
                matrix[a, b + 3] += s03
                matrix[a + 1, b] += s10
                matrix[a + 1, b + 1] += s11
                matrix[a + 1, b + 2] += s12
                matrix[a + 1, b + 3] += s13
                matrix[a + 2, b] += s20
                matrix[a + 2, b + 1] += s21
                matrix[a + 2, b + 2] += s22
                matrix[a + 2, b + 3] += s23
                matrix[a + 3, b] += s30
                matrix[a + 3, b + 1] += s31
                matrix[a + 3, b + 2] += s32
                matrix[a + 3, b + 3] += s33


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def solve_damped(  # noqa: C901 - compiled, in blocks for the cache
    matrix: np.ndarray, damping: np.ndarray, gradient: np.ndarray, factor: np.ndarray, step: np.ndarray
) -> bool:
    """Solve (matrix + diag(damping)) step = -gradient by Cholesky; return whether it is positive definite.

    `matrix` is used in its lower triangle; its size is a multiple of 4. `factor` is working space.
    """
    size = matrix.shape[0]
    for a in range(0, size, 4):
        for b in range(0, a + 4, 4):
            # 4 x 4 tile of matrix minus the dot products of the rows of the factor so far.
            a0, a1, a2, a3 = factor[a], factor[a + 1], factor[a + 2], factor[a + 3]
            b0, b1, b2, b3 = factor[b], factor[b + 1], factor[b + 2], factor[b + 3]
            (
                s00, s01, s02, s03, s10, s11, s12, s13, s20, s21, s22, s23, s30, s31, s32, s33,
            ) = _tile(a0, a1, a2, a3, b0, b1, b2, b3, b, 0.0)  # fmt: skip
            a0[b], a0[b + 1], a0[b + 2], a0[b + 3] = s00, s01, s02, s03
            a1[b], a1[b + 1], a1[b + 2], a1[b + 3] = s10, s11, s12, s13
            a2[b], a2[b + 1], a2[b + 2], a2[b + 3] = s20, s21, s22, s23
            a3[b], a3[b + 1], a3[b + 2], a3[b + 3] = s30, s31, s32, s33
            for i in range(a, a + 4):
                for j in range(b, min(b + 4, i + 1)):
                    value = matrix[i, j] - factor[i, j]
                    if i == j:
                        value += damping[i]
                    for p in range(b, j):
                        value -= factor[i, p] * factor[j, p]
                    if i == j:
                        if not value > 0.0:
                            return False
                        factor[i, i] = np.sqrt(value)
                    else:
                        factor[i, j] = value / factor[j, j]
    for i in range(size):
        value = -gradient[i]
        for p in range(i):
            value -= factor[i, p] * step[p]
        step[i] = value / factor[i, i]
    for i in range(size - 1, -1, -1):
        step[i] /= factor[i, i]
        for p in range(i):
            step[p] -= factor[i, p] * step[i]
    return True
