"""Places at which the field of a decoded avatar is compared with its parent's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.vae.models.radii import directions, outermost_radii
from mbstudio.core.vae.serialize.serialization import Serialization

SHELLS = (0.7, 1.35)
"""Radii of the shells inside and outside, as shares of the surface's."""

LARGEST_LOG_FIELD = 2.5
"""Above it, near control points, ln f says nothing about the shape."""


@dataclass(frozen=True, eq=False)
class Probes:
    """Points on the surface of each parent, and on shells inside and outside of it.

    Attributes
    ----------
    surface : float array, shape (parents, p, 3)
        In D_n.
    steepness : float array, shape (parents, p)
        Length of the gradient of ln f there, in 1 / D_n.
    shell : float array, shape (parents, 2 p, 3)
    shell_log_field : float array, shape (parents, 2 p)
        ln f there, at most 2.5.
    """

    surface: Float[np.ndarray, "parents p 3"]
    steepness: Float[np.ndarray, "parents p"]
    shell: Float[np.ndarray, "parents q 3"]
    shell_log_field: Float[np.ndarray, "parents q"]

    @classmethod
    def from_parents(cls, parents: Serialization, in_octant: int = 32) -> Probes:
        """Return the probes of parents, in `in_octant` directions of every octant."""
        along = directions(in_octant)
        radii = outermost_radii(parents.centers, parents.log_weights, along)
        surface = radii[:, :, None] * along
        shell = np.concatenate([share * surface for share in SHELLS], axis=1)
        steepness = np.empty(radii.shape)
        shell_log_field = np.empty(shell.shape[:2])
        for i in range(len(parents)):
            field, gradient = _field_and_gradient(surface[i], parents.centers[i], parents.log_weights[i])
            steepness[i] = np.linalg.norm(gradient, axis=1) / field
            shell_log_field[i] = np.log(
                _field_and_gradient(shell[i], parents.centers[i], parents.log_weights[i])[0]
            )
        return cls(surface, steepness, shell, np.minimum(shell_log_field, LARGEST_LOG_FIELD))


def _field_and_gradient(
    points: Float[np.ndarray, "p 3"], centers: Float[np.ndarray, "n 3"], log_weights: Float[np.ndarray, " n"]
) -> tuple[Float64[np.ndarray, " p"], Float64[np.ndarray, "p 3"]]:
    away = points[:, None] - centers
    inverse = 1.0 / np.maximum(np.einsum("pnx,pnx->pn", away, away), 1e-12)
    terms = inverse * np.exp(log_weights)
    return terms.sum(1), -2.0 * np.einsum("pn,pnx->px", terms * inverse, away)
