"""What a voxel is told by: grey value, slope and curvature at several scales, and its surroundings.

Values do not depend on the block in which they are computed, to the last bit: each is the same sum in the
same order wherever the block begins.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float32

from mbstudio.core.compiled import compiled
from mbstudio.core.grains.classifying.grey_levels import CELL, GreyLevels
from mbstudio.core.grains.editing.label_volume import Box

VERSION = 1
"""Of the features: a classifier that was learned on others cannot be used."""

SCALES = (0.7, 1.4, 2.8, 5.6)
"""Standard deviations of the Gaussian filters, in the smallest edge of a voxel."""
_TRUNCATED = 3.0  # standard deviations
_AT_SCALE = ("grey", "slope", "bend_1", "bend_2", "bend_3")
_AROUND = ("above_mean", "above_darkest", "below_brightest", "share_of_range", "range")

NAMES = tuple(f"{name} {scale:g}" for scale in SCALES for name in _AT_SCALE) + _AROUND
"""Of the features, in their order; `bend` are the eigenvalues of the Hessian matrix, the largest first."""


def margin_of(edges: tuple[float, float, float]) -> tuple[int, int, int]:
    """Return how many voxels about a block are looked at, along z, y, x."""
    z, y, x = (len(_taps(SCALES[-1] / edge)) // 2 + 1 for edge in edges)
    return z, y, x


def features_in(levels: GreyLevels, box: Box) -> Float32[np.ndarray, "n f"]:
    """Return the features of all voxels of a box, in the order of the voxels.

    Parameters
    ----------
    levels : GreyLevels
    box : tuple of slice
        Within the scan, both ends given.
    """
    margin = margin_of(levels.edges)
    grey = levels.read(box, margin)
    shape = tuple(part.stop - part.start for part in box)
    found = np.empty((*shape, len(NAMES)), np.float32)
    for place, scale in enumerate(SCALES):
        taps = [_taps(scale / edge) for edge in levels.edges]
        # One voxel more on every side than the box has, for differences.
        z, y, x = (
            slice(more - 1 - len(row) // 2, more + count + 1 + len(row) // 2)
            for more, row, count in zip(margin, taps, shape, strict=True)
        )
        part = np.ascontiguousarray(grey[z, y, x])
        smooth = _smoothed(part, taps)
        steps = np.array([scale / edge for edge in levels.edges], np.float64)
        _derive(smooth, steps, found, place * len(_AT_SCALE))
    corner = np.array([part.start for part in box], np.int64)
    # Against the grey value at the second scale, whose noise is little.
    _compare(levels.surroundings, corner, CELL, found, len(_AT_SCALE), len(SCALES) * len(_AT_SCALE))
    return found.reshape(-1, len(NAMES))


def _taps(sigma: float) -> Float32[np.ndarray, " k"]:
    """Return the weights of a Gaussian filter."""
    reach = max(1, math.ceil(_TRUNCATED * sigma))
    places = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * np.square(places / sigma))
    taps: np.ndarray = (weights / weights.sum()).astype(np.float32)
    return taps


def _smoothed(grey: Float32[np.ndarray, "z y x"], taps: list[np.ndarray]) -> Float32[np.ndarray, "a b c"]:
    """Return the part of a block whose surroundings are known, smoothed: first along z, then y, then x."""
    (nz, ny, nx), (kz, ky, kx) = grey.shape, (len(row) - 1 for row in taps)
    first = np.zeros((nz - kz, ny, nx), np.float32)
    _along_z(grey, taps[0], first)
    second = np.zeros((nz - kz, ny - ky, nx), np.float32)
    _along_y(first, taps[1], second)
    third = np.zeros((nz - kz, ny - ky, nx - kx), np.float32)
    _along_x(second, taps[2], third)
    return third


@compiled()
def _along_z(grey: np.ndarray, taps: np.ndarray, out: np.ndarray) -> None:
    for z in range(out.shape[0]):
        for k in range(taps.size):
            weight = taps[k]
            for y in range(out.shape[1]):
                for x in range(out.shape[2]):
                    out[z, y, x] += weight * grey[z + k, y, x]


@compiled()
def _along_y(grey: np.ndarray, taps: np.ndarray, out: np.ndarray) -> None:
    for z in range(out.shape[0]):
        for y in range(out.shape[1]):
            for k in range(taps.size):
                weight = taps[k]
                for x in range(out.shape[2]):
                    out[z, y, x] += weight * grey[z, y + k, x]


@compiled()
def _along_x(grey: np.ndarray, taps: np.ndarray, out: np.ndarray) -> None:
    for z in range(out.shape[0]):
        for y in range(out.shape[1]):
            for k in range(taps.size):
                weight = taps[k]
                for x in range(out.shape[2]):
                    out[z, y, x] += weight * grey[z, y, x + k]


@compiled()
def _derive(smooth: np.ndarray, steps: np.ndarray, found: np.ndarray, column: int) -> None:
    """Write grey value, slope and bends into the columns from `column` on.

    `smooth` has one voxel more on every side than `found`; `steps` are the scale in voxels along z, y, x, so
    that values of all scales compare.
    """
    sz, sy, sx = steps[0], steps[1], steps[2]
    third = 2.0943951023931953  # a third of a turn
    for z in range(found.shape[0]):
        for y in range(found.shape[1]):
            for x in range(found.shape[2]):
                a, b, c = z + 1, y + 1, x + 1
                here = np.float64(smooth[a, b, c])
                gz = 0.5 * sz * (np.float64(smooth[a + 1, b, c]) - smooth[a - 1, b, c])
                gy = 0.5 * sy * (np.float64(smooth[a, b + 1, c]) - smooth[a, b - 1, c])
                gx = 0.5 * sx * (np.float64(smooth[a, b, c + 1]) - smooth[a, b, c - 1])
                zz = sz * sz * (np.float64(smooth[a + 1, b, c]) + smooth[a - 1, b, c] - 2.0 * here)
                yy = sy * sy * (np.float64(smooth[a, b + 1, c]) + smooth[a, b - 1, c] - 2.0 * here)
                xx = sx * sx * (np.float64(smooth[a, b, c + 1]) + smooth[a, b, c - 1] - 2.0 * here)
                zy = 0.25 * sz * sy * (
                    np.float64(smooth[a + 1, b + 1, c]) + smooth[a - 1, b - 1, c]
                    - smooth[a + 1, b - 1, c] - smooth[a - 1, b + 1, c]
                )  # fmt: skip
                zx = 0.25 * sz * sx * (
                    np.float64(smooth[a + 1, b, c + 1]) + smooth[a - 1, b, c - 1]
                    - smooth[a + 1, b, c - 1] - smooth[a - 1, b, c + 1]
                )  # fmt: skip
                yx = 0.25 * sy * sx * (
                    np.float64(smooth[a, b + 1, c + 1]) + smooth[a, b - 1, c - 1]
                    - smooth[a, b + 1, c - 1] - smooth[a, b - 1, c + 1]
                )  # fmt: skip
                # Eigenvalues of a symmetric matrix by its characteristic polynomial (Smith 1961).
                mean = (zz + yy + xx) / 3.0
                dz, dy, dx = zz - mean, yy - mean, xx - mean
                spread = math.sqrt((dz * dz + dy * dy + dx * dx + 2.0 * (zy * zy + zx * zx + yx * yx)) / 6.0)
                first = second = last = mean
                if spread > 1e-12:
                    half = (
                        dz * (dy * dx - yx * yx) - zy * (zy * dx - yx * zx) + zx * (zy * yx - dy * zx)
                    ) / (2.0 * spread * spread * spread)
                    turn = math.acos(min(1.0, max(-1.0, half))) / 3.0
                    first = mean + 2.0 * spread * math.cos(turn)
                    last = mean + 2.0 * spread * math.cos(turn + third)
                    second = 3.0 * mean - first - last
                found[z, y, x, column] = here
                found[z, y, x, column + 1] = math.sqrt(gz * gz + gy * gy + gx * gx)
                found[z, y, x, column + 2] = first
                found[z, y, x, column + 3] = second
                found[z, y, x, column + 4] = last


@compiled()
def _compare(
    around: np.ndarray, corner: np.ndarray, cell: int, found: np.ndarray, grey: int, column: int
) -> None:
    """Write how a voxel's value, in column `grey`, compares with its surroundings, linear between cells."""
    _, na, nb, nc = around.shape
    for z in range(found.shape[0]):
        fa = min(max((corner[0] + z - 0.5 * (cell - 1)) / cell, 0.0), na - 1.0)
        a = min(int(fa), max(na - 2, 0))
        wa = fa - a
        a1 = min(a + 1, na - 1)
        for y in range(found.shape[1]):
            fb = min(max((corner[1] + y - 0.5 * (cell - 1)) / cell, 0.0), nb - 1.0)
            b = min(int(fb), max(nb - 2, 0))
            wb = fb - b
            b1 = min(b + 1, nb - 1)
            for x in range(found.shape[2]):
                fc = min(max((corner[2] + x - 0.5 * (cell - 1)) / cell, 0.0), nc - 1.0)
                c = min(int(fc), max(nc - 2, 0))
                wc = fc - c
                c1 = min(c + 1, nc - 1)
                mean = dark = bright = 0.0
                for k in range(3):
                    value = (1 - wa) * (
                        (1 - wb) * ((1 - wc) * around[k, a, b, c] + wc * around[k, a, b, c1])
                        + wb * ((1 - wc) * around[k, a, b1, c] + wc * around[k, a, b1, c1])
                    ) + wa * (
                        (1 - wb) * ((1 - wc) * around[k, a1, b, c] + wc * around[k, a1, b, c1])
                        + wb * ((1 - wc) * around[k, a1, b1, c] + wc * around[k, a1, b1, c1])
                    )
                    if k == 0:
                        mean = value
                    elif k == 1:
                        dark = value
                    else:
                        bright = value
                here = np.float64(found[z, y, x, grey])
                found[z, y, x, column] = here - mean
                found[z, y, x, column + 1] = here - dark
                found[z, y, x, column + 2] = bright - here
                found[z, y, x, column + 3] = (here - dark) / max(bright - dark, 0.02)
                found[z, y, x, column + 4] = bright - dark
