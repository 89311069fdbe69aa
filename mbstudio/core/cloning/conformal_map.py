"""Special conformal maps: bodies grow on one side and shrink on the other, and every angle stays as it is."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64


def bend(points: Float[np.ndarray, "p 3"], b: Float[np.ndarray, " 3"]) -> Float64[np.ndarray, "p 3"]:
    """Return points after an inversion, a shift by -b, and the inversion again.

    x -> (x - |x|**2 b) / (1 - 2 b.x + |b|**2 |x|**2), which turns and scales the neighbourhood of each point
    and does nothing else to it: edges keep their angles. Nothing within the radius 1/|b| folds.
    """
    squares = np.square(points).sum(axis=1)[:, None]
    bent: np.ndarray = (points - squares * b) / _denominator(points, b)[:, None]
    return bent


def bend_scale(points: Float[np.ndarray, "p 3"], b: Float[np.ndarray, " 3"]) -> Float64[np.ndarray, " p"]:
    """Return by how much the neighbourhood of each point is scaled."""
    return 1.0 / _denominator(points, b)


def bend_gradient(points: Float[np.ndarray, "p 3"], b: Float[np.ndarray, " 3"]) -> Float64[np.ndarray, "p 3 3"]:
    """Return the derivatives of the bent places: row i is that of coordinate i."""
    squares = np.square(points).sum(axis=1)
    below = _denominator(points, b)
    above = points - squares[:, None] * b
    slope_above = np.eye(3) - 2.0 * b[None, :, None] * points[:, None, :]
    slope_below = -2.0 * b + 2.0 * (b @ b) * points
    slope: np.ndarray = (
        slope_above / below[:, None, None]
        - above[:, :, None] * slope_below[:, None, :] / np.square(below)[:, None, None]
    )
    return slope


def _denominator(points: np.ndarray, b: np.ndarray) -> np.ndarray:
    below: np.ndarray = 1.0 - 2.0 * points @ b + (b @ b) * np.square(points).sum(axis=1)
    return below
