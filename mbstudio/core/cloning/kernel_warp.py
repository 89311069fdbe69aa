"""Smooth warps of space: displacements spread from the points of a lattice by a Gaussian kernel."""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float, Float64, Int

SPACING = 1.0
"""Between points of the lattice, in the isotropic frame, in which bodies have about the radius 1."""
RANGE = 1.4
"""Standard deviation of the kernel: less would crimp faces, more would leave warps little to say."""
FLIPS: Float64[np.ndarray, "8 3"] = np.array(
    [[x, y, z] for x in (1.0, -1.0) for y in (1.0, -1.0) for z in (1.0, -1.0)]
)
"""Reflections in the coordinate planes and what they combine to; the first changes nothing."""
FLIPS.flags.writeable = False

Coefficients = Float64[np.ndarray, "27 3"]


@cache
def lattice() -> Float64[np.ndarray, "27 3"]:
    """Return the points from which displacements spread."""
    steps = (-SPACING, 0.0, SPACING)
    points = np.array([[x, y, z] for x in steps for y in steps for z in steps])
    points.flags.writeable = False
    return points


@cache
def flipped_places() -> Int[np.ndarray, "8 27"]:
    """Return, for each flip, which lattice point's displacement takes each point's place."""
    points = lattice()
    table = np.array(
        [[int(np.square(points * flip - point).sum(axis=1).argmin()) for point in points] for flip in FLIPS]
    )
    table.flags.writeable = False
    return table


@cache
def stiffness() -> Float64[np.ndarray, "27 27"]:
    """Return the kernel between lattice points: c^T K c is the squared roughness of a displacement."""
    apart = np.square(lattice()[:, None] - lattice()).sum(axis=2)
    matrix: np.ndarray = np.exp(-apart / (2 * RANGE**2))
    matrix.flags.writeable = False
    return matrix


def weights_at(points: Float[np.ndarray, "p 3"]) -> Float64[np.ndarray, "p 27"]:
    """Return the kernel between points and the lattice: times the coefficients, it is the displacement."""
    # |x - c|^2 by parts: a difference for each pair would take three times as long.
    grid = lattice()
    apart = np.square(points).sum(axis=1)[:, None] + np.square(grid).sum(axis=1) - 2.0 * points @ grid.T
    weights: np.ndarray = np.exp(apart / (-2 * RANGE**2))
    return weights


def displacement(points: Float[np.ndarray, "p 3"], coefficients: Coefficients) -> Float64[np.ndarray, "p 3"]:
    """Return by how much a warp moves points."""
    moved: np.ndarray = weights_at(points) @ coefficients
    return moved


def gradient(points: Float[np.ndarray, "p 3"], coefficients: Coefficients) -> Float64[np.ndarray, "p 3 3"]:
    """Return the derivatives of the warped places: row i is that of coordinate i.

    With x + sum_m w_m(x) c_m and w_m a Gaussian about g_m: I + sum_m c_m (g_m - x)^T w_m / s**2.
    """
    weights = weights_at(points)
    towards = np.einsum("pm,mi,mj->pij", weights, coefficients, lattice())
    moved = weights @ coefficients
    slope: np.ndarray = np.eye(3) + (towards - moved[:, :, None] * points[:, None, :]) / RANGE**2
    return slope
