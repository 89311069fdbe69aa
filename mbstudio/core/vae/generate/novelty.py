"""How far clones are from their parents and from each other, and whether one can tell them apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int

from mbstudio.core.errors import GenerationError
from mbstudio.core.vae.models.features import character
from mbstudio.core.vae.models.radii import log_radii, novelty_distances
from mbstudio.core.vae.serialize.serialization import Serialization

COPY = 0.3
"""A clone nearer to a parent than this share of the parents' median nearest distance is a copy."""

_SUBSETS = 8
_BLOCK = 512
_TREES = 100
_FOLDS = 5
_MOST = 200
"""Parents and clones that the classifier is shown."""
_DRAWS = 3
_PERMUTATIONS = 20
_DRAWN_AGAIN = 100


@dataclass(frozen=True)
class Novelty:
    """Nearest distances in ln r over 144 directions, over the eight flips the smallest.

    Attributes
    ----------
    parents : float
        Median distance of a parent to its nearest other parent (root mean square of ln r).
    novelty : float
        Median distance of a clone to its nearest parent, over `parents`: 1 is as new as a real grain.
    copies : float
        Share of the clones nearer to a parent than 0.3 `parents`.
    diversity : float
        Median distance of a clone to its nearest among as many clones as there are parents, over `parents`.
    """

    parents: float
    novelty: float
    copies: float
    diversity: float


def novelty(parents: Serialization, clones: Serialization, seed: int = 0) -> Novelty:
    """Return how new clones are, and how different from each other.

    Parameters
    ----------
    parents, clones : Serialization
        In their principal frames; two parents and two clones at least.
    seed : int
        Of the subsets of clones that diversity is found from.

    Raises
    ------
    GenerationError
        If there are fewer.
    """
    if len(parents) < 2 or len(clones) < 2:
        raise GenerationError(
            f"Novelty needs at least two parents and two clones, not {len(parents)} and {len(clones)}."
        )
    theirs, ours = log_radii(parents), log_radii(clones)
    between_parents = float(np.median(nearest_others(theirs)))
    to_parents = nearest_to(ours, theirs)
    rng = np.random.default_rng([seed, 0xD1])
    size = min(len(parents), len(clones))
    rounds = 1 if size == len(clones) else _SUBSETS
    among = [
        np.median(nearest_others(ours[rng.choice(len(ours), size, replace=False)])) for _ in range(rounds)
    ]
    # Parents that are all alike have no distance to measure by.
    unit = between_parents if between_parents > 0 else np.nan
    return Novelty(
        parents=between_parents,
        novelty=float(np.median(to_parents) / unit),
        copies=float(np.mean(to_parents < COPY * between_parents)),
        diversity=float(np.mean(among) / unit),
    )


def nearest_others(radii: Float[np.ndarray, "bodies 144"]) -> Float64[np.ndarray, " bodies"]:
    """Return the distance of each body to its nearest other, from their ln r in 144 directions."""
    distances = novelty_distances(radii, radii)
    np.fill_diagonal(distances, np.inf)
    nearest: np.ndarray = distances.min(axis=1)
    return nearest


def nearest_to(
    radii: Float[np.ndarray, "bodies 144"], others: Float[np.ndarray, "others 144"]
) -> Float64[np.ndarray, " bodies"]:
    """Return the distance of each body to the nearest of others, from their ln r in 144 directions."""
    return np.concatenate([
        novelty_distances(radii[start : start + _BLOCK], others).min(axis=1)
        for start in range(0, len(radii), _BLOCK)
    ])  # fmt: skip


@dataclass(frozen=True)
class Discrimination:
    """How well a classifier tells clones from parents that it has not seen.

    The parents are taken as they were serialized: what serializing them lost is not seen here. `mbstudio
    judge` compares clones with the grains themselves.

    Attributes
    ----------
    accuracy : float
        Share told right; 0.5 is guessing.
    auc : float
        Area under the receiver operating characteristic: the probability that a parent looks more like a
        parent than a clone does. 0.5 is indistinguishable. The mean over several draws and splits.
    error : float
        Standard error of the area: how far it spreads with permuted labels, bodies drawn and split and the
        classifier taught anew each time, or when the bodies held out are drawn again, whichever is more.
    """

    accuracy: float
    auc: float
    error: float


def discrimination(
    parents: Serialization,
    clones: Serialization,
    parent_factors: Float[np.ndarray, "parents factors"],
    clone_factors: Float[np.ndarray, "clones factors"],
    seed: int = 0,
) -> Discrimination:
    """Train a random forest to tell clones from parents, and test it on bodies held out.

    As many clones as parents are taken, at most 200 of each. It sees the factors, and of ln r in 144
    directions what no flip of the axes changes: the parts of each parity, without their signs.

    Parameters
    ----------
    parents, clones : Serialization
    parent_factors, clone_factors : float arrays, shape (bodies, factors)
    seed : int

    Raises
    ------
    GenerationError
        If there are fewer than ten of either.

    References
    ----------
    Lopez-Paz & Oquab (2017), Revisiting classifier two-sample tests, ICLR.
    """
    size = min(len(parents), len(clones), _MOST)
    if size < 2 * _FOLDS:
        raise GenerationError(f"Telling clones from parents needs at least {2 * _FOLDS} of each, not {size}.")
    rng = np.random.default_rng([seed, 0xC1])
    described = [
        np.concatenate([factors, flip_invariants(log_radii(bodies))], axis=1)
        for bodies, factors in ((parents, parent_factors), (clones, clone_factors))
    ]
    kinds = np.repeat([1, 0], size)
    areas, drawn, right = [], [], []
    for _ in range(_DRAWS):
        rows = [np.sort(rng.choice(len(one), size, replace=False)) for one in described]
        told = _held_out(np.concatenate([one[r] for one, r in zip(described, rows, strict=True)]), kinds, rng)
        areas.append(_area(told[kinds == 1], told[kinds == 0]))
        drawn.append(_drawn_error(told[kinds == 1], told[kinds == 0], rng))
        right.append(float(np.mean((told > 0.5) == kinds)))
    values = np.concatenate([one[r] for one, r in zip(described, rows, strict=True)])
    chance = []
    for _ in range(_PERMUTATIONS):
        permuted = rng.permutation(kinds)
        told = _held_out(values, permuted, rng)
        chance.append(_area(told[permuted == 1], told[permuted == 0]) - 0.5)
    auc = float(np.mean(areas))
    # What chance alone does shrinks towards areas of 0 and 1 as the variance of a share.
    by_chance = float(np.sqrt(np.mean(np.square(chance)) * 4.0 * auc * (1.0 - auc)))
    return Discrimination(float(np.mean(right)), auc, max(by_chance, float(np.mean(drawn))))


def _held_out(
    values: Float[np.ndarray, "bodies features"], kinds: Int[np.ndarray, " bodies"], rng: np.random.Generator
) -> Float64[np.ndarray, " bodies"]:
    """Return for each body how like the first kind a forest takes it that others have taught."""
    from sklearn.ensemble import ExtraTreesClassifier
    from sklearn.model_selection import StratifiedKFold, cross_val_predict

    state = int(rng.integers(2**31))
    folds = StratifiedKFold(_FOLDS, shuffle=True, random_state=state)
    forest = ExtraTreesClassifier(_TREES, min_samples_leaf=3, random_state=state, n_jobs=1)
    told: np.ndarray = cross_val_predict(forest, values, kinds, cv=folds, method="predict_proba")[:, 1]
    return told


def _area(first: Float[np.ndarray, " p"], second: Float[np.ndarray, " q"]) -> float:
    return float(np.mean((first[:, None] > second) + 0.5 * (first[:, None] == second)))


def _drawn_error(
    first: Float[np.ndarray, " p"], second: Float[np.ndarray, " q"], rng: np.random.Generator
) -> float:
    """Return how far the area spreads when the bodies held out are drawn again."""
    areas = [
        _area(rng.choice(first, len(first)), rng.choice(second, len(second))) for _ in range(_DRAWN_AGAIN)
    ]
    return float(np.std(areas, ddof=1))


def flip_invariants(radii: Float[np.ndarray, "bodies 144"]) -> Float64[np.ndarray, "bodies 144"]:
    """Return the parts of ln r of each parity; those that a flip of the axes turns, without their signs.

    The directions of octant f are those of the first octant flipped by f, so that the eight radii of one such
    family change places under a flip as the signs of the parities say.
    """
    families = radii.reshape(len(radii), 8, -1)
    parts = np.einsum("fp,bfd->bpd", character(np.arange(8)), families) / 8.0
    parts[:, 1:] = np.abs(parts[:, 1:])
    descriptors: np.ndarray = parts.reshape(len(radii), -1)
    return descriptors
