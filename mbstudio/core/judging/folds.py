"""Folds for classifiers that keep each group of relatives together, and scores of bodies held out."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

Scorer = Callable[
    [Float[np.ndarray, "n f"], Bool[np.ndarray, " n"], Float[np.ndarray, "m f"], int], Float[np.ndarray, " m"]
]
"""``score(train, train_kinds, held_out, seed)``: learns two kinds, returns how like the first others are."""

FOLDS = 5


def assign_folds(
    groups: Int[np.ndarray, " n"], kinds: Bool[np.ndarray, " n"], rng: np.random.Generator, count: int = FOLDS
) -> Int[np.ndarray, " n"]:
    """Return the fold of each body: groups stay together, and folds have alike numbers of each kind.

    Parameters
    ----------
    groups : int array, shape (n,)
        Numbers from 0 on without gaps.
    kinds : bool array, shape (n,)
    rng : numpy.random.Generator
    """
    total = int(groups.max()) + 1
    sizes = np.stack([np.bincount(groups[kinds == kind], minlength=total) for kind in (True, False)], axis=1)
    whole = np.maximum(sizes.sum(axis=0), 1)
    order = rng.permutation(total)
    # Large groups first, in a random order among equals; each goes where its kinds are scarcest.
    order = order[np.argsort(-(sizes[order] / whole).sum(axis=1), kind="stable")]
    filled = np.zeros((count, 2))
    fold_of = np.empty(total, dtype=np.int64)
    for group in order:
        load = ((filled + sizes[group]) / whole) ** 2 - (filled / whole) ** 2
        ties = load.sum(axis=1)
        fold = int(rng.choice(np.flatnonzero(ties <= ties.min() + 1e-12)))
        fold_of[group] = fold
        filled[fold] += sizes[group]
    found: np.ndarray = fold_of[groups]
    return found


def held_out_wins(
    values: Float[np.ndarray, "n f"],
    kinds: Bool[np.ndarray, " n"],
    groups: Int[np.ndarray, " n"],
    score: Scorer,
    repeats: int,
    rng: np.random.Generator,
) -> tuple[Float64[np.ndarray, "p q"], Float64[np.ndarray, "p q"]]:
    """Return how often each body of the first kind beats each of the second, and how often they met.

    Two bodies meet where they are held out in one fold, so that one classifier scores both and neither has
    taught it. A tie is half a win.

    Returns
    -------
    wins, meetings : float arrays, shape (bodies of the first kind, of the second)
    """
    first, second = np.flatnonzero(kinds), np.flatnonzero(~kinds)
    wins, meetings = np.zeros((len(first), len(second))), np.zeros((len(first), len(second)))
    for _ in range(repeats):
        folds = assign_folds(groups, kinds, rng)
        for fold in range(FOLDS):
            held = folds == fold
            if kinds[~held].all() or not kinds[~held].any() or not held.any():
                continue
            scores = np.full(len(kinds), np.nan)
            scores[held] = score(values[~held], kinds[~held], values[held], int(rng.integers(2**31)))
            rows, columns = np.flatnonzero(held[first]), np.flatnonzero(held[second])
            ours, theirs = scores[first[rows]][:, None], scores[second[columns]][None]
            place = np.ix_(rows, columns)
            wins[place] += (ours > theirs) + 0.5 * (ours == theirs)
            meetings[place] += 1.0
    return wins, meetings


def area(
    wins: Float[np.ndarray, "p q"],
    meetings: Float[np.ndarray, "p q"],
    first: Float[np.ndarray, " p"] | None = None,
    second: Float[np.ndarray, " q"] | None = None,
) -> float:
    """Return the share of meetings that the first kind wins: the area under the ROC curve, with weights."""
    if first is None or second is None:
        return float(wins.sum() / meetings.sum()) if meetings.any() else float("nan")
    met = float(first @ meetings @ second)
    return float(first @ wins @ second) / met if met else float("nan")


def area_error(
    wins: Float[np.ndarray, "p q"],
    meetings: Float[np.ndarray, "p q"],
    first_groups: Int[np.ndarray, " p"],
    second_groups: Int[np.ndarray, " q"],
    rng: np.random.Generator,
    samples: int = 400,
) -> float:
    """Return the standard error of the area by drawing groups with replacement."""
    total = int(max(first_groups.max(), second_groups.max())) + 1
    areas = []
    for _ in range(samples):
        weights = np.bincount(rng.integers(total, size=total), minlength=total).astype(float)
        areas.append(area(wins, meetings, weights[first_groups], weights[second_groups]))
    return float(np.nanstd(areas, ddof=1))


def number_groups(groups: Sequence[Hashable]) -> Int[np.ndarray, " n"]:
    """Return the number of each body's group, in the order of their first bodies."""
    known: dict[Hashable, int] = {}
    return np.array([known.setdefault(group, len(known)) for group in groups], dtype=np.int64)
