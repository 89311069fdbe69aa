"""Working in the latent space by hand: noise, interpolation, blending, projection, a map.

All functions take and return latent vectors of a
:class:`~mbstudio.core.vae.models.style_learner.StyleLearner`.
A grain and its mirror images in the planes of its principal axes have different latent vectors; where two
grains meet, the second is flipped to lie as near to the first as it can.

References
----------
Zhao et al. (2023), Computers and Geotechnics 161, 105564, section on latent space arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.radii import log_radii
from mbstudio.core.vae.models.sampling import flip_moments
from mbstudio.core.vae.models.style_learner import StyleLearner

if TYPE_CHECKING:
    from mbstudio.core.vae.serialize.frame import Body

_FINE = 4
FARTHEST = 4.0
"""Standard deviations of a latent variable among the parents beyond which a vector counts as far outside."""


def check_latent(learner: StyleLearner, latent: Float[np.ndarray, " d"]) -> Float64[np.ndarray, " d"]:
    """Return a copy of a latent vector; StyleError unless it is one of this style-learner's."""
    vector = np.array(latent, dtype=np.float64)
    if vector.shape != (learner.dimension,) or not np.isfinite(vector).all():
        raise StyleError(
            f"A latent vector of shape {vector.shape} does not fit this style-learner, or is not "
            f"finite: give {learner.dimension} finite numbers."
        )
    return vector


def add_noise(
    learner: StyleLearner, latent: Float[np.ndarray, " d"], sigma: float, seed: int = 0, count: int = 1
) -> Float64[np.ndarray, "count d"]:
    """Return variations of a grain: z + sigma L e, with L L' the parents' covariance and e from N(0, 1).

    Parameters
    ----------
    latent : float array, shape (d,)
    sigma : float
        0 changes nothing; 1 strays as far as another parent. The direction depends on the seed alone, so
        that a larger sigma goes farther the same way.
    seed : int
    count : int

    Raises
    ------
    StyleError
        If sigma is negative or no number, count below 1, or the latent vector none of this learner.
    """
    if not (np.isfinite(sigma) and sigma >= 0) or count < 1:
        raise StyleError(
            f"Noise of sigma = {sigma} for {count} grains is not possible: give sigma >= 0 and count >= 1."
        )
    here = check_latent(learner, latent)
    values, vectors = np.linalg.eigh(_covariance(learner))
    # Of no length in directions in which the parents do not differ.
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    latents: np.ndarray = (
        here + sigma * np.random.default_rng(seed).standard_normal((count, len(here))) @ root.T
    )
    return latents


def align_to(
    learner: StyleLearner, latent: Float[np.ndarray, " d"], other: Float[np.ndarray, " d"]
) -> Float64[np.ndarray, " d"]:
    """Return the other grain's latent vector in that of its eight flips whose surface is nearest."""
    here, other = check_latent(learner, latent), check_latent(learner, other)
    if learner.signs is None:
        return other
    flipped = other * learner.signs
    logs = log_radii(learner.decode(np.concatenate([here[None], flipped])))
    return np.asarray(flipped[np.square(logs[1:] - logs[0]).sum(axis=1).argmin()])


def interpolate(
    learner: StyleLearner,
    first: Float[np.ndarray, " d"],
    second: Float[np.ndarray, " d"],
    shares: Sequence[float] | Float[np.ndarray, " steps"],
) -> Float64[np.ndarray, "steps d"]:
    """Return z1 + alpha (z2 - z1), the second grain flipped so that the way is short.

    Parameters
    ----------
    first, second : float array, shape (d,)
    shares : sequence of float
        Each alpha: 0 is the first grain, 1 the second; beyond these the way goes on straight.

    Raises
    ------
    StyleError
        If a share is not finite, or a latent vector none of this learner.
    """
    alpha = np.atleast_1d(np.asarray(shares, dtype=np.float64))
    if alpha.ndim != 1 or not np.isfinite(alpha).all():
        raise StyleError(
            "Shares of an interpolation must be finite numbers, 0 for the first grain, 1 for the last."
        )
    start = check_latent(learner, first)
    way = align_to(learner, start, second) - start
    latents: np.ndarray = start + alpha[:, None] * way
    return latents


def morph(
    learner: StyleLearner, first: Float[np.ndarray, " d"], second: Float[np.ndarray, " d"], steps: int = 11
) -> Float64[np.ndarray, "steps d"]:
    """Return an interpolation in steps of which each changes the surface by as much as any other.

    Parameters
    ----------
    first, second : float array, shape (d,)
    steps : int
        Grains, both ends included; 2 or more.

    Raises
    ------
    StyleError
        If there are fewer than two steps, or a latent vector is none of this learner.
    """
    if steps < 2:
        raise StyleError(f"The interpolation needs at least two steps, its ends, not {steps}.")
    shares = np.linspace(0.0, 1.0, _FINE * (steps - 1) + 1)
    for _ in range(2):
        logs = log_radii(learner.decode(interpolate(learner, first, second, shares)))
        changes = np.sqrt(np.square(np.diff(logs, axis=0)).mean(axis=1))
        travelled = np.concatenate([[0.0], np.cumsum(changes)])
        if travelled[-1] <= 1e-12:
            break
        even = np.interp(np.linspace(0.0, travelled[-1], len(shares)), travelled, shares)
        shares = even
    return interpolate(learner, first, second, shares[::_FINE])


def blend(
    learner: StyleLearner, latents: Float[np.ndarray, "grains d"], weights: Sequence[float]
) -> Float64[np.ndarray, " d"]:
    """Return the weighted sum of grains about the parents' mean, all flipped to lie like the first.

    Parameters
    ----------
    latents : float array, shape (grains, d)
    weights : sequence of float
        One a grain. With weights that sum to 1 it is their mean; less draws it to the parents' mean.

    Raises
    ------
    StyleError
        If there are no grains, numbers differ, or a weight is not finite.
    """
    vectors = [check_latent(learner, latent) for latent in latents]
    share = np.asarray(weights, dtype=np.float64)
    if not vectors or share.shape != (len(vectors),) or not np.isfinite(share).all():
        raise StyleError(
            f"{len(vectors)} grains need the same number of finite weights, not {list(weights)}."
        )
    alike = np.stack([vectors[0], *(align_to(learner, vectors[0], other) for other in vectors[1:])])
    mean = mean_latent(learner)
    summed: np.ndarray = mean + share @ (alike - mean)
    return summed


def project_bodies(learner: StyleLearner, bodies: Sequence[Body]) -> Float64[np.ndarray, "bodies d"]:
    """Return the latent vectors of grains, meshes or avatars of any n, fitted from the learner's template.

    Raises
    ------
    SerializationError
        If a body cannot be fitted; the message names it.
    """
    from mbstudio.core.vae.serialize.serializer import serialize

    return learner.encode(serialize(bodies, template=learner.template))


def mean_latent(learner: StyleLearner) -> Float64[np.ndarray, " d"]:
    """Return the mean of the parents in all their flips: a symmetric grain."""
    return flip_moments(learner.latents, _signs(learner))[0]


def farthest(learner: StyleLearner, deviations_away: float = FARTHEST) -> Float64[np.ndarray, " d"]:
    """Return how far each latent variable may lie from the mean: so many deviations, or as a parent's."""
    most = np.abs(learner.latents - mean_latent(learner)).max(axis=0)
    return np.asarray(np.maximum(deviations_away * deviations(learner), 1.05 * most))


def is_far_outside(learner: StyleLearner, latent: Float[np.ndarray, " d"]) -> bool:
    """Return whether a latent variable lies farther from the parents' mean than any reasonable grain's."""
    away = np.abs(check_latent(learner, latent) - mean_latent(learner))
    return bool((away > farthest(learner) + 1e-9).any())


def clamp(learner: StyleLearner, latent: Float[np.ndarray, " d"]) -> Float64[np.ndarray, " d"]:
    """Return the latent vector with every variable no farther from the parents' mean than is reasonable."""
    mean, most = mean_latent(learner), farthest(learner)
    clipped: np.ndarray = np.clip(check_latent(learner, latent), mean - most, mean + most)
    return clipped


def deviations(learner: StyleLearner) -> Float64[np.ndarray, " d"]:
    """Return the standard deviation of every latent variable among the parents in all their flips."""
    return np.asarray(np.sqrt(np.maximum(np.diagonal(_covariance(learner)), 0.0)))


def effects(learner: StyleLearner) -> Float64[np.ndarray, " d"]:
    """Return how much the surface changes with one deviation of each latent variable: the rms of ln r."""
    mean = mean_latent(learner)
    shifts = np.diag(deviations(learner))
    logs = log_radii(learner.decode(np.concatenate([mean + shifts, mean - shifts])))
    up, down = np.split(logs, 2)
    return np.asarray(np.sqrt(np.square(0.5 * (up - down)).mean(axis=1)))


@dataclass(frozen=True, eq=False)
class LatentMap:
    """A plane through the latent space, along its two widest directions that no flip of the axes changes.

    Attributes
    ----------
    mean : float array, shape (d,)
    axes : float array, shape (2, d)
        A step of 1 along an axis is one standard deviation of the parents.
    read : float array, shape (d, 2)
        Turns a latent vector less the mean into its place.
    share : tuple of float
        Of the parents' variance of the surface that each axis holds, flips apart.
    """

    mean: Float[np.ndarray, " d"]
    axes: Float[np.ndarray, "2 d"]
    read: Float[np.ndarray, "d 2"]
    share: tuple[float, float]

    def places(self, latents: Float[np.ndarray, "grains d"]) -> Float64[np.ndarray, "grains 2"]:
        """Return where latent vectors lie on the map."""
        places: np.ndarray = (np.asarray(latents) - self.mean) @ self.read
        return places

    def latent_at(
        self, place: Float[np.ndarray, "2"], base: Float[np.ndarray, " d"] | None = None
    ) -> Float64[np.ndarray, " d"]:
        """Return the latent vector at a place; what the map does not show is the base's, or the mean's."""
        start = self.mean if base is None else np.asarray(base, dtype=np.float64)
        latent: np.ndarray = start + (np.asarray(place) - self.places(start[None])[0]) @ self.axes
        return latent


def latent_map(learner: StyleLearner) -> LatentMap:
    """Return the map of a style-learner: principal components by their effect on the surface.

    Raises
    ------
    StyleError
        If the parents differ in fewer than two directions.
    """
    mean, signs = flip_moments(learner.latents, _signs(learner))[0], _signs(learner)
    even = (signs == 1.0).all(axis=0)
    weight = np.zeros(learner.dimension)
    spread = deviations(learner)
    weight[even] = (effects(learner) / np.maximum(spread, 1e-300))[even] * (spread[even] > 1e-12)
    away = (learner.latents - mean) * weight
    _, singular, rows = np.linalg.svd(away, full_matrices=False)
    if len(singular) < 2 or singular[1] <= 1e-9 * max(singular[0], 1e-300):
        raise StyleError("The parents differ in fewer than two directions, so they cannot be mapped.")
    size = singular[:2] / np.sqrt(len(away))
    inverse = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0)
    share = np.square(singular[:2]) / np.square(singular).sum()
    return LatentMap(
        mean, rows[:2] * inverse * size[:, None], (rows[:2] * weight / size[:, None]).T,
        (float(share[0]), float(share[1])),
    )  # fmt: skip


def _signs(learner: StyleLearner) -> Float64[np.ndarray, "8 d"]:
    signs = learner.signs
    return np.ones((8, learner.dimension)) if signs is None else np.asarray(signs, dtype=np.float64)


def _covariance(learner: StyleLearner) -> Float64[np.ndarray, "d d"]:
    return flip_moments(learner.latents, _signs(learner))[1]
