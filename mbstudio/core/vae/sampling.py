"""Drawing latent vectors of new grains: in bands, near no parent and of each parent's strength."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int
from scipy.special import ndtri

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.serialization import Serialization

FIRST_BAND = 8


@dataclass(frozen=True, eq=False)
class Sample:
    """New grains as a style-learner draws them: not yet checked for validity.

    Attributes
    ----------
    serialization : Serialization
        The clones.
    latents : float array, shape (clones, d)
        What they were decoded from. Read-only.
    parents : int array, shape (clones,)
        Row of the parent that lent its strength to each clone; -1 where none did. Read-only.
    """

    serialization: Serialization
    latents: Float[np.ndarray, "clones d"]
    parents: Int[np.ndarray, " clones"]

    def __post_init__(self) -> None:
        for name in ("latents", "parents"):
            array = np.array(getattr(self, name))
            array.flags.writeable = False
            object.__setattr__(self, name, array)


def bands_of(widths: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    """Return bands 0-8, 8-16, 16-32, 32-64, ... of each group of so many latents, one after another."""
    bands, start = [], 0
    for width in widths:
        low = 0
        while low < width:
            high = min(width, max(FIRST_BAND, 2 * low))
            bands.append((start + low, start + high))
            low = high
        start += width
    return tuple(bands)


def stratified_rows(parents: int, count: int, rng: np.random.Generator) -> Int[np.ndarray, " count"]:
    """Return `count` rows of parents, each as often as any other or once more, in random order."""
    rounds = [rng.permutation(parents) for _ in range(-(-count // parents))]
    rows = np.concatenate([*rounds, np.empty(0, np.int64)])[:count]
    return rng.permutation(rows).astype(np.int64)


def band_latents(
    latents: Float[np.ndarray, "parents d"],
    signs: Float[np.ndarray, "8 d"],
    bands: tuple[tuple[int, int], ...],
    count: int,
    rng: np.random.Generator,
    *,
    mixing: float = 0.5,
    turning: float = 1.0,
) -> tuple[Float64[np.ndarray, "count d"], Int[np.ndarray, " count"]]:
    """Return new latent vectors, and the parent that lent its strength to each.

    A clone has near its parent's values in the first band (form and size), and in every further band
    its parent's strength in a random direction: how rough a grain is stays, where it is rough does not.

    Parameters
    ----------
    latents : float array, shape (parents, d)
        Of the parents, the most telling latent first.
    signs : float array, shape (8, d)
        What each flip of the principal axes does to the latents; every parent is used in a random flip.
    bands : tuple of (int, int)
        First latent of each band, and the one after its last.
    count : int
    rng : numpy Generator
    mixing : float
        Share h of noise in the first band, 0 to 1; mean and covariance stay for any share.

    Raises
    ------
    StyleError
        If count is negative or mixing is not between 0 and 1.
    """
    if count < 0:
        raise StyleError(f"{count} clones cannot be drawn: give a whole number, 0 or more.")
    if not 0 <= mixing <= 1:
        raise StyleError(f"A share of {mixing:g} of noise is not between 0 and 1.")
    mean, covariance = flip_moments(latents, signs)
    rows = stratified_rows(len(latents), count, rng)
    lent = latents[rows] * signs[rng.integers(0, 8, count)] - mean
    drawn = np.empty_like(lent)
    for number, (low, high) in enumerate(bands):
        root = _root(covariance[low:high, low:high])
        part = lent[:, low:high]
        noise = (even_normals if number == 0 else _normals)(count, high - low, rng) @ root.T
        if number == 0:
            drawn[:, low:high] = np.sqrt(1.0 - mixing**2) * part + mixing * noise
        else:
            turned = np.sqrt(1.0 - turning**2) * part + turning * noise
            length = np.linalg.norm(turned, axis=1, keepdims=True)
            strength = np.linalg.norm(part, axis=1, keepdims=True)
            drawn[:, low:high] = turned * (strength / np.where(length > 0, length, 1.0))
    return mean + drawn, rows


def even_normals(count: int, d: int, rng: np.random.Generator) -> Float64[np.ndarray, "count d"]:
    """Return standard normal numbers, each column spread evenly: its mean and spread hardly miss 0 and 1.

    Notes
    -----
    A Latin hypercube (McKay, Beckman and Conover 1979): one number of each column in each of `count`
    intervals of equal probability.
    """
    places = rng.permuted(np.tile(np.arange(count)[:, None], (1, d)), axis=0)
    return ndtri((places + rng.uniform(0.0, 1.0, (count, d))).clip(1e-12) / max(count, 1))


def _normals(count: int, d: int, rng: np.random.Generator) -> Float64[np.ndarray, "count d"]:
    return rng.standard_normal((count, d))


def normal_latents(count: int, d: int, rng: np.random.Generator) -> Float64[np.ndarray, "count d"]:
    """Return latent vectors from N(0, 1), as the paper draws them."""
    if count < 0:
        raise StyleError(f"{count} clones cannot be drawn: give a whole number, 0 or more.")
    return rng.standard_normal((count, d))


def flip_moments(
    latents: Float[np.ndarray, "parents d"], signs: Float[np.ndarray, "8 d"]
) -> tuple[Float64[np.ndarray, " d"], Float64[np.ndarray, "d d"]]:
    """Return mean and covariance of latents over the parents in all their flips."""
    mean = latents.mean(0) * (signs.mean(0) == 1.0)
    away = latents - mean
    return mean, away.T @ away / len(latents) * (signs.T @ signs / 8.0)


def _root(covariance: Float[np.ndarray, "w w"]) -> Float64[np.ndarray, "w w"]:
    """Return a matrix R with R R' the covariance, whatever its rank."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))
