"""Masses of a clump's spheres whose sum and centre of mass are those of the body.

An engine that pulls at every sphere with its own mass, as LAMMPS does, turns a falling clump unless
the spheres' masses have their centre of mass where the body's is.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

_ROUNDS = 60


def balanced_masses(
    centers: Float[np.ndarray, "n 3"], shares: Float[np.ndarray, " n"], total: float
) -> tuple[Float[np.ndarray, " n"], bool]:
    """Return positive masses with a given sum whose centre of mass is the origin.

    They are ``total p_i exp(l . x_i) / Z`` with the one vector l that puts the centre of mass at the
    origin: of all such masses those nearest to the shares p in relative entropy, found by Newton's
    method on the convex function ln Z(l).

    Parameters
    ----------
    centers : float array, shape (n, 3)
    shares : float array, shape (n,)
        Positive: what the masses would be in proportion to.
    total : float
        Sum of the masses.

    Returns
    -------
    masses : float array, shape (n,)
    balanced : bool
        False if no such masses exist, because the origin lies outside the convex hull of the centres
        (as for two spheres beside it); the masses are then in proportion to the shares.
    """
    reach = float(np.linalg.norm(centers, axis=1).max())
    shares = shares / shares.sum()
    if reach == 0:
        return shares * total, True
    places = centers / reach
    tilt = np.zeros(3)
    for _ in range(_ROUNDS):
        weights, mean, value = _tilted(places, shares, tilt)
        if np.abs(mean).max() < 1e-15:
            break
        spread = (places * weights[:, None]).T @ places - np.outer(mean, mean)
        step = -np.linalg.lstsq(spread + 1e-14 * np.eye(3), mean, rcond=None)[0]
        length = 1.0
        while length > 1e-6 and _tilted(places, shares, tilt + length * step)[2] > value + 1e-15:
            length *= 0.5
        tilt = tilt + length * step
    weights, mean, _ = _tilted(places, shares, tilt)
    if np.abs(mean).max() > 1e-12 or weights.min() <= 0:
        return shares * total, False
    return weights * total, True


def _tilted(
    places: np.ndarray, shares: np.ndarray, tilt: np.ndarray
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " 3"], float]:
    """Return weights, their centre of mass, and ln Z, whose gradient that centre is."""
    exponent = places @ tilt
    highest = float(exponent.max())
    weights = shares * np.exp(exponent - highest)
    total = float(weights.sum())
    weights = weights / total
    return weights, weights @ places, float(np.log(total) + highest)
