"""Drawing latent vectors of new grains: in bands, near no parent and of each parent's strength."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int
from scipy.special import ndtri

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.serialize.serialization import Serialization

FIRST_BAND = 8
NEIGHBOURS = 20


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


def default_noise(parents: int) -> tuple[float, float]:
    """Return the shares of noise, in form and size and in everything finer, for so many parents.

    Clones are then about as far from the nearest parent as parents are from each other.
    """
    return (0.6, 0.7) if parents >= 50 else (0.8, 0.9)


def split_bands(widths: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
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
    mixing: float = 0.6,
    turning: float = 0.7,
    neighbours: int = NEIGHBOURS,
) -> tuple[Float64[np.ndarray, "count d"], Int[np.ndarray, " count"]]:
    """Return new latent vectors, and the parent that lent its strength to each.

    A clone has in the first band (form and size) its parent's values with noise, and in every further
    band its parent's strength in a direction turned by noise: how rough a grain is stays, where it is
    rough does not. The noise is that of parents about as rough as this one, so that rounded and angular
    grains in one population have clones of their own kind and none in between.

    Parameters
    ----------
    latents : float array, shape (parents, d)
        Of the parents, the most telling latent first.
    signs : float array, shape (8, d)
        What each flip of the principal axes does to the latents; every parent is used in random flips.
    bands : tuple of (int, int)
        First latent of each band, and the one after its last.
    count : int
    rng : numpy Generator
    mixing : float
        Share h of noise in the first band, 0 to 1; mean and covariance stay for any share.
    turning : float
        Share of noise in the direction of every further band, 0 to 1.
    neighbours : int
        Parents whose noise a clone gets.

    Raises
    ------
    StyleError
        If count is negative, mixing or turning is not between 0 and 1, or neighbours not positive.
    """
    if count < 0:
        raise StyleError(f"The number of clones must be 0 or more, not {count}.")
    if not (0 <= mixing <= 1 and 0 <= turning <= 1):
        raise StyleError(f"The shares of noise must be between 0 and 1, not {mixing:g} and {turning:g}.")
    if neighbours < 1:
        raise StyleError(f"The number of neighbours must be 1 or more, not {neighbours}.")
    near = similar_parents(latents, signs, bands, neighbours)
    means = latents[near].mean(1) * (signs.mean(0) == 1.0)
    rows = stratified_rows(len(latents), count, rng)
    flips, others = rng.integers(0, 8, count), rng.integers(0, 8, (count, near.shape[1]))
    drawn = np.empty((count, latents.shape[1]))
    for number, (low, high) in enumerate(bands):
        band = slice(low, high)
        mean = means[rows, band]
        part = latents[rows, band] * signs[flips, band] - mean
        away = latents[near[rows], band] * signs[others, band] - mean[:, None]
        shares = (even_normals if number == 0 else _normals)(count, near.shape[1], rng)
        noise = np.einsum("ck,ckd->cd", shares, away) / np.sqrt(near.shape[1])
        amount = mixing if number == 0 else turning
        changed = np.sqrt(1.0 - amount**2) * part + amount * noise
        if number:
            length = np.linalg.norm(changed, axis=1, keepdims=True)
            strength = np.linalg.norm(part, axis=1, keepdims=True)
            changed = changed * (strength / np.where(length > 0, length, 1.0))
        drawn[:, band] = mean + changed
    return drawn, rows


def similar_parents(
    latents: Float[np.ndarray, "parents d"],
    signs: Float[np.ndarray, "8 d"],
    bands: tuple[tuple[int, int], ...],
    neighbours: int,
) -> Int[np.ndarray, "parents neighbours"]:
    """Return for each parent those with the most similar strength in all bands, itself the first.

    Notes
    -----
    Strength is the logarithm of the distance from the mean over all flips, in units of its deviation over
    the parents; it is the same in every flip.
    """
    away = latents - flip_moments(latents, signs)[0]
    strengths = np.stack(
        [np.log(np.linalg.norm(away[:, low:high], axis=1) + 1e-9) for low, high in bands], axis=1
    )
    deviation = strengths.std(0)
    strengths = (strengths - strengths.mean(0)) / np.where(deviation > 1e-9, deviation, 1.0)
    squares = np.square(strengths[:, None] - strengths[None]).sum(2)
    np.fill_diagonal(squares, -1.0)
    return np.argsort(squares, axis=1, kind="stable")[:, : min(neighbours, len(latents))]


def even_normals(count: int, d: int, rng: np.random.Generator) -> Float64[np.ndarray, "count d"]:
    """Return standard normal numbers, each column spread evenly: its mean and spread hardly miss 0 and 1.

    Notes
    -----
    A Latin hypercube (McKay, Beckman and Conover 1979): one number of each column in each of `count`
    intervals of equal probability.
    """
    places = rng.permuted(np.tile(np.arange(count)[:, None], (1, d)), axis=0)
    normal: np.ndarray = ndtri((places + rng.uniform(0.0, 1.0, (count, d))).clip(1e-12) / max(count, 1))
    return normal


def _normals(count: int, d: int, rng: np.random.Generator) -> Float64[np.ndarray, "count d"]:
    return rng.standard_normal((count, d))


def normal_latents(count: int, d: int, rng: np.random.Generator) -> Float64[np.ndarray, "count d"]:
    """Return latent vectors from N(0, 1), as the paper draws them."""
    if count < 0:
        raise StyleError(f"The number of clones must be 0 or more, not {count}.")
    return rng.standard_normal((count, d))


def flip_moments(
    latents: Float[np.ndarray, "parents d"], signs: Float[np.ndarray, "8 d"]
) -> tuple[Float64[np.ndarray, " d"], Float64[np.ndarray, "d d"]]:
    """Return mean and covariance of latents over the parents in all their flips."""
    mean = latents.mean(0) * (signs.mean(0) == 1.0)
    away = latents - mean
    return mean, away.T @ away / len(latents) * (signs.T @ signs / 8.0)
