"""How far the features of clones have drifted from those of true grains."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np
from jaxtyping import Float, Float64, Int

from mbstudio.core.judging.features import FEATURES, Features
from mbstudio.core.judging.folds import number_groups
from mbstudio.core.judging.judgement import Drift

_SAMPLES = 1000
_HALVINGS = 200


def find_drifts(
    true: Sequence[Features],
    true_groups: Sequence[Hashable],
    clones: Sequence[Features],
    clone_groups: Sequence[Hashable],
    seed: int,
) -> tuple[Drift, ...]:
    """Return the drift of each feature, NaN where fewer than two bodies of either kind have it."""
    rng = np.random.default_rng([seed, 0xD0])
    ours, theirs = (np.array([body.values for body in bodies]) for bodies in (clones, true))
    groups = number_groups((*true_groups, *clone_groups))
    true_numbers, clone_numbers = groups[: len(true)], groups[len(true) :]
    drawn = rng.integers(groups.max() + 1, size=(_SAMPLES, int(groups.max()) + 1))
    weights = np.stack([np.bincount(row, minlength=drawn.shape[1]) for row in drawn]).astype(float)
    halves = [_half(number_groups(true_groups), rng) for _ in range(_HALVINGS)]
    return tuple(
        _drift_of(
            kind.name, theirs[:, place], ours[:, place],
            weights[:, true_numbers], weights[:, clone_numbers], halves,
        )
        for place, kind in enumerate(FEATURES)
    )  # fmt: skip


def _drift_of(
    name: str, true: Float[np.ndarray, " n"], clones: Float[np.ndarray, " m"],
    true_weights: Float[np.ndarray, "k n"], clone_weights: Float[np.ndarray, "k m"],
    halves: Sequence[Int[np.ndarray, " n"]],
) -> Drift:  # fmt: skip
    has, have = np.isfinite(true), np.isfinite(clones)
    nothing = float("nan")
    if min(has.sum(), have.sum()) < 2:
        return Drift(name, (nothing,) * 2, (nothing,) * 2, nothing, nothing, nothing, (nothing,) * 2)
    a, b = true[has], clones[have]
    deviations = float(a.std(ddof=1)), float(b.std(ddof=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = _means(b, clone_weights[:, have]) - _means(a, true_weights[:, has])
        drift = float((b.mean() - a.mean()) / np.float64(deviations[0]))
        error = float(np.nanstd(moved, ddof=1) / np.float64(deviations[0]))
    floor = []
    for half in halves:
        one, other = a[half[has] == 0], a[half[has] == 1]
        if len(one) and len(other):
            ratio = (1 / len(a) + 1 / len(b)) / (1 / len(one) + 1 / len(other))
            floor.append(_ks(one, other) * np.sqrt(ratio))
    low, high = (float(np.percentile(floor, rank)) for rank in (50, 95)) if floor else (nothing, nothing)
    return Drift(name, (float(a.mean()), float(b.mean())), deviations, drift, error, _ks(a, b), (low, high))


def _means(values: Float[np.ndarray, " n"], weights: Float[np.ndarray, "k n"]) -> Float64[np.ndarray, " k"]:
    found: np.ndarray = weights @ values / weights.sum(axis=1)
    return found


def _half(groups: Int[np.ndarray, " n"], rng: np.random.Generator) -> Int[np.ndarray, " n"]:
    """Return 0 or 1 for each body: half of the groups each."""
    total = int(groups.max()) + 1
    side = np.zeros(total, dtype=np.int64)
    side[rng.permutation(total)[: total // 2]] = 1
    halves: np.ndarray = side[groups]
    return halves


def _ks(one: Float[np.ndarray, " n"], other: Float[np.ndarray, " m"]) -> float:
    """Return the largest distance of two cumulative distributions."""
    places = np.concatenate([one, other])
    shares = [np.searchsorted(np.sort(values), places, "right") / len(values) for values in (one, other)]
    return float(np.abs(shares[0] - shares[1]).max())
