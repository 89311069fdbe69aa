"""What no body can be: flat and of a high sphericity at once."""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float

from mbstudio.core import formulas
from mbstudio.core.errors import StyleError

_DEGREES = (2, 4, 6, 8)
_NODES = 48
FLATTEST = 0.2
"""Below it a body is hardly a star of few harmonics any more."""


@cache
def highest_sphericity(csf: float) -> float:
    """Return the highest sphericity that a body of a Corey shape factor can have.

    Parameters
    ----------
    csf : float
        Short axis over the root of the product of the two others, of the ellipsoid of equal inertia;
        0.2 to 1.

    Raises
    ------
    StyleError
        If the Corey shape factor is not in that range.

    Notes
    -----
    The body of revolution about its short axis with the least area for its volume, found among
    ln r = a_2 P_2 + a_4 P_4 + a_6 P_6 + a_8 P_8. At 0.6 it is 0.9529, where the spheroid has 0.9521.
    That the best body is one of revolution, and that finer harmonics do not help, was found by
    searching among all bodies with three planes of symmetry: to 0.0001 from 0.5 on.
    """
    from scipy.optimize import minimize

    if not FLATTEST <= csf <= 1.0:
        raise StyleError(
            f"The highest sphericity is known for Corey shape factors from {FLATTEST:g} to 1, not for "
            f"{csf:g}."
        )
    terms, slopes = _legendre()
    heights, shares = np.polynomial.legendre.leggauss(_NODES)
    spheroid = -0.5 * np.log(1.0 - heights**2 + heights**2 / csf**2)
    root = np.sqrt(shares)
    columns = np.concatenate([np.ones((1, _NODES)), terms])
    start = np.linalg.lstsq((columns * root).T, spheroid * root, rcond=None)[0][1:]

    def sphericity_and_csf(weights: Float[np.ndarray, " degrees"]) -> tuple[float, float]:
        radii = np.exp(weights @ terms)
        inclined = np.sqrt(1.0 + (1.0 - heights**2) * (weights @ slopes) ** 2)
        volume = 2.0 * np.pi / 3.0 * float(shares @ radii**3)
        area = 2.0 * np.pi * float(shares @ (radii**2 * inclined))
        along = float(shares @ (radii**5 * heights**2))
        across = 0.5 * float(shares @ (radii**5 * (1.0 - heights**2)))
        return formulas.sphericity(volume, area), float(np.sqrt(along / across))

    found = minimize(
        lambda weights: -sphericity_and_csf(weights)[0], start, method="SLSQP",
        constraints=[{"type": "eq", "fun": lambda weights: sphericity_and_csf(weights)[1] - csf}],
        options={"ftol": 1e-12, "maxiter": 200},
    )  # fmt: skip
    return sphericity_and_csf(found.x)[0]


@cache
def _legendre() -> tuple[Float[np.ndarray, "degrees nodes"], Float[np.ndarray, "degrees nodes"]]:
    """Return the Legendre polynomials of even degree at Gauss-Legendre nodes, and their derivatives."""
    heights = np.polynomial.legendre.leggauss(_NODES)[0]
    every = [np.polynomial.legendre.Legendre.basis(degree) for degree in _DEGREES]
    return np.stack([term(heights) for term in every]), np.stack([term.deriv()(heights) for term in every])
