"""The rose of directions: how many of them point which way, smoothed over the sphere."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from scipy.special import erfi

from mbstudio.core.errors import TwinError

SHARPNESS = 12.0
"""Of the kernel: it falls to half at 14 degrees."""
_AT_ONCE = 2_000_000  # pairs of directions


def rose_density(
    directions: Float64[np.ndarray, "m 3"],
    at: Float64[np.ndarray, "k 3"],
    sharpness: float = SHARPNESS,
) -> Float64[np.ndarray, "k"]:
    """Return how dense axes lie about unit vectors, over that of axes that lie evenly.

    Parameters
    ----------
    directions : float array, shape (m, 3)
        Of any length; n and -n count alike.
    at : float array, shape (k, 3)
        Unit vectors.
    sharpness : float
        kappa of the kernel ``exp(kappa ((u . n)^2 - 1))`` (Watson's distribution).

    Raises
    ------
    TwinError
        If there is no direction.
    """
    if not len(directions):
        raise TwinError("There is no contact: a rose needs one or more.")
    unit = directions / np.linalg.norm(directions, axis=1)[:, None]
    # The kernel's mean over the sphere is the integral of exp(kappa (t^2 - 1)) over t from 0 to 1.
    root = float(np.sqrt(sharpness))
    mean = float(np.exp(-sharpness) * np.sqrt(np.pi) * erfi(root) / (2.0 * root))
    found = np.empty(len(at))
    step = max(1, _AT_ONCE // len(unit))
    for first in range(0, len(at), step):
        some = slice(first, first + step)
        squares = np.einsum("ka,ma->km", at[some], unit) ** 2
        found[some] = np.exp(sharpness * (squares - 1.0)).mean(axis=1)
    return found / mean


def lambert(directions: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 2"]:
    """Return axes in Lambert's projection of equal areas, seen along z: within a circle of radius 1.

    Axes that point down are turned round: the upper half of the sphere shows all of them.
    """
    unit = directions / np.linalg.norm(directions, axis=1)[:, None]
    unit = np.where(unit[:, 2:] < 0, -unit, unit)
    found: np.ndarray = unit[:, :2] / np.sqrt(1.0 + unit[:, 2:])
    return found


def from_lambert(places: Float64[np.ndarray, "m 2"]) -> Float64[np.ndarray, "m 3"]:
    """Return the unit vectors of places within the circle of :func:`lambert`."""
    squares = (places**2).sum(axis=1)
    scale = np.sqrt(np.maximum(2.0 - squares, 0.0))
    return np.column_stack((places * scale[:, None], 1.0 - squares))
