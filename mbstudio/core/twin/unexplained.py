"""What of a scan near a surface neither model nor noise explains, as a displacement of that surface."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from mbstudio.core.twin.body import Body, Share, Surroundings

_NEAR = 1.5  # deviations of the blur: beyond, a displacement of the surface does not show


def unexplained_displacement(
    body: Body, found: Share, around: Surroundings, blur: float, at: Float64[np.ndarray, "3"] | None = None,
    within: float = np.inf,
) -> float:  # fmt: skip
    """Return the displacement of a surface that would explain its residuals beyond the noise.

    Where edges, minerals or rings are not in the model, residuals exceed the noise; the surface may then be
    off by about so much, root mean square.

    Parameters
    ----------
    body : Body
    found : Share
        What it adds to the grey values.
    around : Surroundings
        What they leave for it.
    blur : float
        In voxels.
    at : float array, shape (3,), optional
        With `within`: the residuals so near to a point alone are looked at.
    within : float

    Returns
    -------
    float
        In voxels; 0 where the noise explains all.
    """
    feet = found.feet
    near = (np.abs(feet.distance) < _NEAR * blur) & (around.sharpness[feet.places] > 0)
    if at is not None:
        near &= ((feet.foot - at[:, None]) ** 2).sum(axis=0) < within**2
    if not near.any():
        return 0.0
    places = feet.places[near]
    noise = 1.0 / around.sharpness[places].astype(np.float64) ** 2
    squares = (around.rest[places].astype(np.float64) - found.added[places]) ** 2
    slopes = (found.near_tone[near] * found.by_distance[near]) ** 2
    # As many of the residuals' squares as there are parameters go into the fit.
    left = max(0.0, 1.0 - 4.0 * body.control.shape[1] / max(len(feet.places), 1))
    excess = float(squares.mean() - left * noise.mean())
    return float(np.sqrt(max(excess, 0.0) / max(float(slopes.mean()), 1e-12)))
