"""What a judge of clones has found: tables, and the rule by which clones count as told apart."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from mbstudio.core.judging.features import FEATURES

if TYPE_CHECKING:
    import pandas as pd

ONE_SIDED = 1.645
"""Standard errors above 0.5 from which on clones count as told apart: one time in twenty by chance."""


ONE_SIDED_OF_ALL = 2.69
"""The same for the whole of two classifiers on seven sets of features."""


@dataclass(frozen=True)
class Area:
    """Area under the ROC curve of one classifier on bodies that it has not seen, nor any of their relatives.

    Attributes
    ----------
    value : float
        0.5: cannot be told apart; 1: always. Below 0.5 it is left as it is.
    error : float
        Standard error, by drawing groups of relatives again, widened to what permutations show.
    chance : float
        What permuted labels stay below in 19 of 20 cases; NaN where this was not found.
    """

    value: float
    error: float
    chance: float

    @property
    def is_told_apart(self) -> bool:
        """Whether the area lies above 0.5 by more than chance would have it in 19 of 20 cases."""
        return self.value > 0.5 + ONE_SIDED * self.error and not self.value <= self.chance


@dataclass(frozen=True)
class SetResult:
    """One set of features in one comparison.

    Attributes
    ----------
    features : str
        Name of the set.
    numbers : tuple of int
        Bodies that have all of its features.
    logistic, forest : Area
    """

    features: str
    numbers: tuple[int, int]
    logistic: Area
    forest: Area

    @property
    def is_told_apart(self) -> bool:
        """Whether either classifier tells them apart."""
        return self.logistic.is_told_apart or self.forest.is_told_apart

    @property
    def verdict(self) -> str:
        """In words."""
        return "told apart" if self.is_told_apart else "not told apart, within the error"


@dataclass(frozen=True)
class Comparison:
    """Two samples of bodies compared by all sets of features.

    Attributes
    ----------
    name : str
        Short.
    title : str
        In words.
    numbers, groups : tuple of int
        Bodies, and groups of relatives, of each sample.
    results : tuple of SetResult
        Sets for which too few bodies have the features are missing; the notes say so.
    """

    name: str
    title: str
    numbers: tuple[int, int]
    groups: tuple[int, int]
    results: tuple[SetResult, ...]

    def __getitem__(self, features: str) -> SetResult:
        for result in self.results:
            if result.features == features:
                return result
        raise KeyError(features)


@dataclass(frozen=True)
class Drift:
    """One feature of true grains and clones.

    Attributes
    ----------
    feature : str
    means, deviations : tuple of float
        Of true grains and clones.
    drift, error : float
        Mean of the clones less that of true grains, in standard deviations of true grains, and its error.
    ks : float
        Kolmogorov-Smirnov statistic.
    ks_floor : tuple of float
        The same of random halves of the true grains, median and 95 %, times the root of the ratio of sizes.
    """

    feature: str
    means: tuple[float, float]
    deviations: tuple[float, float]
    drift: float
    error: float
    ks: float
    ks_floor: tuple[float, float]


@dataclass(frozen=True)
class Likeness:
    """How near clones are to grains that they may have been made of, and true grains to each other.

    All are medians. Distances are root mean squares of the difference of ln r, correlations those of radii,
    both in 144 directions and over the eight flips of the principal axes the nearest.

    Attributes
    ----------
    distance, correlation : tuple of float
        Of a true grain to its nearest other, of a clone to its nearest true grain or parent.
    source_distance, source_correlation : float
        Of a clone to the parent it was made of; NaN where parents are not known.
    copies : float
        Share of clones nearer than 0.3 of the median distance among true grains.
    """

    distance: tuple[float, float]
    correlation: tuple[float, float]
    source_distance: float
    source_correlation: float
    copies: float


@dataclass(frozen=True)
class Judgement:
    """Whether clones can be told from true grains.

    Attributes
    ----------
    numbers : tuple of int
        True grains and clones.
    comparisons : tuple of Comparison
        True grains against clones first.
    drifts : tuple of Drift
        One a feature.
    likeness : Likeness
    notes : tuple of str
        Sentences that one should know with the numbers.
    seed : int
    """

    numbers: tuple[int, int]
    comparisons: tuple[Comparison, ...]
    drifts: tuple[Drift, ...]
    likeness: Likeness
    notes: tuple[str, ...]
    seed: int

    def __getitem__(self, comparison: str) -> Comparison:
        for found in self.comparisons:
            if found.name == comparison:
                return found
        raise KeyError(comparison)

    @property
    def is_told_apart(self) -> bool:
        """Whether clones are told from true grains by a margin that allows for fourteen looks."""
        return any(
            area.is_told_apart and area.value > 0.5 + ONE_SIDED_OF_ALL * area.error
            for result in self.comparisons[0].results for area in (result.logistic, result.forest)
        )  # fmt: skip

    def table(self) -> pd.DataFrame:
        """Return one row a comparison and set of features."""
        import pandas as pd

        return pd.DataFrame([
            {
                "comparison": comparison.name, "features": result.features,
                "first": result.numbers[0], "second": result.numbers[1],
                "logistic_auc": result.logistic.value, "logistic_error": result.logistic.error,
                "logistic_chance": result.logistic.chance,
                "forest_auc": result.forest.value, "forest_error": result.forest.error,
                "forest_chance": result.forest.chance, "verdict": result.verdict,
            }
            for comparison in self.comparisons for result in comparison.results
        ])  # fmt: skip

    def drift_table(self) -> pd.DataFrame:
        """Return one row a feature."""
        import pandas as pd

        titles = {kind.name: kind.title for kind in FEATURES}
        return pd.DataFrame([
            {
                "feature": row.feature, "title": titles[row.feature],
                "true_mean": row.means[0], "clones_mean": row.means[1],
                "true_deviation": row.deviations[0], "clones_deviation": row.deviations[1],
                "drift_in_deviations": row.drift, "drift_error": row.error,
                "ks": row.ks, "ks_of_halves": row.ks_floor[0], "ks_of_halves_95": row.ks_floor[1],
            }
            for row in self.drifts
        ])  # fmt: skip

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values, for JSON."""
        found = asdict(self)
        for comparison, plain in zip(self.comparisons, found["comparisons"], strict=True):
            for result, row in zip(comparison.results, plain["results"], strict=True):
                row["verdict"] = result.verdict
        return {**found, "is_told_apart": self.is_told_apart}
