"""Two samples of bodies told apart by each set of features, with the error of that."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from mbstudio.core.judging.features import FEATURE_SETS, FEATURES, Features
from mbstudio.core.judging.folds import FOLDS, Scorer, area, area_error, held_out_wins, number_groups
from mbstudio.core.judging.forest import score_by_forest
from mbstudio.core.judging.judgement import ONE_SIDED, Area, Comparison, SetResult
from mbstudio.core.judging.logistic import score_by_logistic

FEWEST = 10
"""Bodies of each kind below which nothing is told."""
MOST = 300
"""Bodies of each kind that classifiers are shown; of more, so many are drawn."""
_LEAST = 1e-3
_CLASSIFIERS: tuple[tuple[str, Scorer, int, int], ...] = (
    ("logistic", score_by_logistic, 10, 60),
    ("forest", score_by_forest, 5, 30),
)
"""Name, scorer, repeated splits, and permutations."""
_SPLITS_OF_PERMUTATION = 2


@dataclass(frozen=True)
class Null:
    """What permuted labels show.

    Attributes
    ----------
    width : float
        How much wider areas spread about 0.5 than drawing groups again says.
    spread : float
        How wide they spread.
    groups : tuple of int
        Groups of either kind.
    """

    width: float
    spread: float
    groups: tuple[int, int]

    def spread_of(self, groups: tuple[int, int]) -> float:
        """Return the spread to be expected of other numbers of groups."""
        ratio = (1 / groups[0] + 1 / groups[1]) / (1 / self.groups[0] + 1 / self.groups[1])
        return self.spread * float(np.sqrt(ratio))


Nulls = dict[tuple[str, str], Null]
"""By set of features and classifier."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Bodies of one kind with what they are related by.

    Attributes
    ----------
    values : float array, shape (n, features)
        As compared: of some features the logarithm.
    groups : tuple
        The group of relatives of each; equal groups of two samples are relatives.
    """

    values: Float64[np.ndarray, "n features"]
    groups: tuple[Hashable, ...]

    def __len__(self) -> int:
        return len(self.values)

    def take(self, rows: Int[np.ndarray, " m"] | Bool[np.ndarray, " n"]) -> Sample:
        """Return some of the bodies."""
        kept = np.arange(len(self))[rows]
        return Sample(self.values[kept], tuple(self.groups[row] for row in kept))


def sample_of(bodies: Sequence[Features], groups: Sequence[Hashable]) -> Sample:
    """Return bodies as a sample."""
    values = np.array([body.values for body in bodies])
    for place, kind in enumerate(FEATURES):
        if kind.by_logarithm:
            values[:, place] = np.log(np.maximum(values[:, place], _LEAST))
    return Sample(values, tuple(groups))


def compare_samples(
    name: str,
    title: str,
    first: Sample,
    second: Sample,
    seed: int,
    nulls: Nulls | None = None,
    on_step: Callable[[], None] | None = None,
) -> tuple[Comparison, Nulls, list[str]]:
    """Return how well two samples are told apart, what permuted labels showed, and notes.

    Parameters
    ----------
    name, title : str
        Of the comparison.
    first, second : Sample
    seed : int
    nulls : dict, optional
        Of a comparison alike: saves the permutations, but gives no chance level.
    on_step : callable, optional
        Called after each set of features; what it raises ends the work.
    """
    notes: list[str] = []
    first, second = (
        _at_most(sample, np.random.default_rng([seed, 0xA0 + which]))
        for which, sample in enumerate((first, second))
    )
    results: list[SetResult] = []
    found: Nulls = {}
    for number, (features, columns) in enumerate(FEATURE_SETS.items()):
        kept = [sample.take(np.isfinite(sample.values[:, columns]).all(axis=1)) for sample in (first, second)]
        short = min(len(sample) for sample in kept) < FEWEST or min(_kinds_of(kept)) < FOLDS
        if short:
            notes.append(f"{title}: too few bodies have all features of '{features}', which are left out.")
        else:
            areas = {}
            for place, (word, scorer, repeats, permutations) in enumerate(_CLASSIFIERS):
                stream = np.random.default_rng([seed, number, place])
                null = None if nulls is None else nulls.get((features, word))
                areas[word], found[features, word] = _area_of(
                    kept[0], kept[1], np.array(columns), scorer, repeats, permutations, stream, null
                )
            results.append(SetResult(features, (len(kept[0]), len(kept[1])), **areas))
        if on_step is not None:
            on_step()
    groups = _kinds_of([first, second])
    return Comparison(name, title, (len(first), len(second)), groups, tuple(results)), found, notes


def _kinds_of(samples: Sequence[Sample]) -> tuple[int, int]:
    return len(set(samples[0].groups)), len(set(samples[1].groups))


def _at_most(sample: Sample, rng: np.random.Generator) -> Sample:
    if len(sample) <= MOST:
        return sample
    return sample.take(np.sort(rng.choice(len(sample), MOST, replace=False)))


def _area_of(
    first: Sample, second: Sample, columns: Int[np.ndarray, " f"], scorer: Scorer, repeats: int,
    permutations: int, rng: np.random.Generator, null: Null | None,
) -> tuple[Area, Null]:  # fmt: skip
    values = np.concatenate([first.values, second.values])[:, columns]
    kinds = np.repeat([True, False], [len(first), len(second)])
    groups = number_groups((*first.groups, *second.groups))
    wins, meetings = held_out_wins(values, kinds, groups, scorer, repeats, rng)
    drawn = area_error(wins, meetings, groups[kinds], groups[~kinds], rng)
    value, chance = area(wins, meetings), float("nan")
    if null is None:
        null = _permuted(values, kinds, groups, scorer, permutations, rng)
        chance = 0.5 + ONE_SIDED * null.spread
    # What chance alone does shrinks towards areas of 0 and 1 as the variance of a share.
    by_chance = null.spread_of(_kinds_of((first, second))) * float(np.sqrt(4.0 * value * (1.0 - value)))
    return Area(value, max(null.width * drawn, by_chance), chance), null


def _permuted(
    values: Float[np.ndarray, "n f"], kinds: Bool[np.ndarray, " n"], groups: Int[np.ndarray, " n"],
    scorer: Scorer, permutations: int, rng: np.random.Generator,
) -> Null:  # fmt: skip
    """Return how areas of permuted labels spread about 0.5, and how drawing groups again says they would.

    Drawing groups again does not see that another sample would also have taught the classifier otherwise;
    labels permuted do.
    """
    squares, errors = [], []
    for _ in range(permutations):
        rows, permuted = permute_kinds(kinds, groups, rng)
        own = number_groups(tuple(groups[rows].tolist()))
        wins, meetings = held_out_wins(values[rows], permuted, own, scorer, _SPLITS_OF_PERMUTATION, rng)
        squares.append((area(wins, meetings) - 0.5) ** 2)
        errors.append(area_error(wins, meetings, own[permuted], own[~permuted], rng, 100) ** 2)
    counts = int(permuted.sum()), int((~permuted).sum())
    spread, drawn = float(np.sqrt(np.mean(squares))), float(np.sqrt(np.mean(errors)))
    # Kinds that are equal in all features tie everywhere, and nothing spreads.
    return Null(max(1.0, spread / drawn if drawn > 0 else 1.0), spread, counts)


def permute_kinds(
    kinds: Bool[np.ndarray, " n"], groups: Int[np.ndarray, " n"], rng: np.random.Generator
) -> tuple[Int[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
    """Return one body of each kind of each group, and their kinds permuted as chance could have had it.

    Where a group has both kinds they change places or not; groups of one kind change it among each other.
    """
    order = rng.permutation(len(kinds))
    keys = groups[order] * 2 + kinds[order]
    rows = np.sort(order[np.unique(keys, return_index=True)[1]])
    permuted = kinds[rows].copy()
    own = groups[rows]
    is_mixed = np.bincount(own, minlength=int(groups.max()) + 1)[own] == 2
    turned = rng.random(int(groups.max()) + 1) < 0.5
    permuted[is_mixed] ^= turned[own[is_mixed]]
    permuted[~is_mixed] = rng.permutation(permuted[~is_mixed])
    return rows, permuted
