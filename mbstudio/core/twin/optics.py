"""What share of a grain's tone a voxel near its surface has, and how that changes with the surface.

The scanner's point spread and the voxel together are taken for a Gaussian. A half space that is blurred by
it has the share ``Phi(-d / sigma)``; a curved surface less where it is convex, by
``sigma kappa / 2 phi(d / sigma)`` with kappa the sum of the curvatures of the parallel surface through the
voxel: exact for a ball but for terms of its other side.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float64

from mbstudio.core.compiled import compiled
from mbstudio.core.twin.feet import Feet

REACH = 3.0
"""How many deviations of the blur from the surface voxels are looked at."""
VOXEL_VARIANCE = 1.0 / 12.0
"""Of a voxel's own averaging, in voxels squared: part of the blur here."""
_MOST_BEND = 1.0  # of sigma kappa: at sharper edges the expansion means nothing
_LEAST_STRETCH = 0.2
_ROOT_2 = math.sqrt(2.0)
_ROOT_2_PI = math.sqrt(2.0 * math.pi)


@compiled(error_model="numpy")
def _shade(
    distance: np.ndarray,
    bend: np.ndarray,
    gauss: np.ndarray,
    blur: float,
    share: np.ndarray,
    by_distance: np.ndarray,
    by_blur: np.ndarray,
) -> None:
    for p in range(len(distance)):
        d = distance[p]
        stretch = max(1.0 + bend[p] * d + gauss[p] * d * d, _LEAST_STRETCH)
        curved = blur * (bend[p] + 2.0 * gauss[p] * d) / stretch
        curved = min(max(curved, -_MOST_BEND), _MOST_BEND)
        t = d / blur
        bell = math.exp(-0.5 * t * t) / _ROOT_2_PI
        share[p] = 0.5 * math.erfc(t / _ROOT_2) - 0.5 * curved * bell
        by_distance[p] = -bell / blur * (1.0 - 0.5 * curved * t)
        by_blur[p] = bell / blur * (t - 0.5 * curved * (1.0 + t * t))


def shade(
    feet: Feet, blur: float
) -> tuple[Float64[np.ndarray, "m"], Float64[np.ndarray, "m"], Float64[np.ndarray, "m"]]:
    """Return the share of the tone of the voxels near a surface, and its changes with distance and blur.

    Parameters
    ----------
    feet : Feet
    blur : float
        Standard deviation of point spread and voxel together, in voxels.
    """
    share, by_distance, by_blur = (np.empty(len(feet.distance)) for _ in range(3))
    _shade(feet.distance, feet.bend, feet.gauss, blur, share, by_distance, by_blur)
    return share, by_distance, by_blur


@compiled(error_model="numpy")
def _fill_rows(
    foot: np.ndarray, slope: np.ndarray, factor: np.ndarray, control: np.ndarray, rows: np.ndarray
) -> None:
    n = control.shape[1]
    for i in range(n):
        cx, cy, cz, k = control[0, i], control[1, i], control[2, i], control[3, i]
        for p in range(len(slope)):
            dx, dy, dz = foot[0, p] - cx, foot[1, p] - cy, foot[2, p] - cz
            inverse = 1.0 / max(dx * dx + dy * dy + dz * dz, 1e-12)
            term = -factor[p] * k * inverse / slope[p]
            rows[i, p] = term
            term *= 2.0 * inverse
            rows[n + i, p] = term * dx
            rows[2 * n + i, p] = term * dy
            rows[3 * n + i, p] = term * dz


def fill_rows(
    feet: Feet, factor: Float64[np.ndarray, "m"], control: Float64[np.ndarray, "4 n"], rows: np.ndarray
) -> None:
    """Write `factor` times the change of the distances with ln k, x, y and z of all control points.

    Parameters
    ----------
    feet : Feet
    factor : float array, shape (m,)
    control : float array, shape (4, n)
    rows : float32 array, shape (at least 4 n, m)
        Its first 4 n rows are written.
    """
    _fill_rows(feet.foot, feet.slope, factor, control, rows)
