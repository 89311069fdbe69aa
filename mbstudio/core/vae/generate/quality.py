"""The quality of a generation: how like their parents clones are, and how new."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.errors import GenerationError
from mbstudio.core.populations.comparison import PAPER_FACTORS, compare
from mbstudio.core.populations.population import Population
from mbstudio.core.vae.generate.generation import Counts
from mbstudio.core.vae.generate.novelty import Discrimination, Novelty, discrimination, novelty
from mbstudio.core.vae.serialize.serialization import Serialization

if TYPE_CHECKING:
    import pandas as pd


PAPER_ERRORS = {
    "Ottawa sand": {
        "sphericity": (2.54, 3.12), "circularity": (0.03, 2.56), "dns": (2.57, 2.69), "csf": (3.87, 11.58),
        "volume": (2.77, 20.61), "area": (4.22, 24.21),
    },
    "cobblestone": {
        "sphericity": (0.92, 4.45), "circularity": (0.25, 3.46), "dns": (0.98, 5.87), "csf": (3.25, 4.88),
        "volume": (0.66, 5.64), "area": (1.41, 10.65),
    },
}  # fmt: skip
"""Errors of mean and standard deviation, in percent, of the paper's clones (its section 4.3)."""

_REPEATS = 200
_HIGH = 95


@dataclass(frozen=True)
class Floor:
    """What as many true new grains would score: median and 95th percentile over repeated samples.

    Attributes
    ----------
    mean_error, deviation_error, ks, wasserstein : tuple of float
        As in `FactorQuality`.
    """

    mean_error: tuple[float, float]
    deviation_error: tuple[float, float]
    ks: tuple[float, float]
    wasserstein: tuple[float, float]


@dataclass(frozen=True)
class FactorQuality:
    """One factor of clones and parents.

    Attributes
    ----------
    factor : str
    means, deviations : tuple of float
        Of parents and clones, in the factor's unit.
    mean_error, deviation_error : float
        100 |clones - parents| / |parents| in percent, as the paper states them.
    ks : float
        Kolmogorov-Smirnov statistic.
    wasserstein : float
        Area between the cumulative distributions, in standard deviations of the parents.
    floor : Floor
    """

    factor: str
    means: tuple[float, float]
    deviations: tuple[float, float]
    mean_error: float
    deviation_error: float
    ks: float
    wasserstein: float
    floor: Floor

    @property
    def at_floor(self) -> bool:
        """Whether no figure is worse than 95 % of samples of true new grains."""
        return (
            self.mean_error <= self.floor.mean_error[1]
            and self.deviation_error <= self.floor.deviation_error[1]
            and self.ks <= self.floor.ks[1]
            and self.wasserstein <= self.floor.wasserstein[1]
        )


@dataclass(frozen=True)
class Quality:
    """The quality of a generation.

    Attributes
    ----------
    parents, clones : int
        How many were measured.
    factors : tuple of FactorQuality
        The paper's six.
    correlations : tuple of (str, str, float, float)
        Every two factors, their correlation in the parents and in the clones.
    correlation_error : float
        Root mean square difference of these correlations.
    correlation_floor : tuple of float
        The same of true new grains: median and 95th percentile.
    novelty : Novelty
    discrimination : Discrimination or None
        None with fewer than ten parents or clones.
    valid_before : float or None
        Share of the candidates that were valid as drawn; None where it is not known.
    valid_after : float
        Share of the clones that are valid.
    floor : str
        Where the floor comes from.
    """

    parents: int
    clones: int
    factors: tuple[FactorQuality, ...]
    correlations: tuple[tuple[str, str, float, float], ...]
    correlation_error: float
    correlation_floor: tuple[float, float]
    novelty: Novelty
    discrimination: Discrimination | None
    valid_before: float | None
    valid_after: float
    floor: str

    @property
    def mean_error(self) -> float:
        """Mean over the six factors of the errors of the means, in percent."""
        return float(np.mean([row.mean_error for row in self.factors]))

    @property
    def deviation_error(self) -> float:
        """Mean over the six factors of the errors of the standard deviations, in percent."""
        return float(np.mean([row.deviation_error for row in self.factors]))

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values, for JSON."""
        return {
            **asdict(self),
            "factors": {row.factor: {**asdict(row), "at_floor": row.at_floor} for row in self.factors},
            "mean_error": self.mean_error,
            "deviation_error": self.deviation_error,
        }

    def table(self) -> pd.DataFrame:
        """Return one row a factor: moments, errors and distances, each with the median floor."""
        import pandas as pd

        return pd.DataFrame([
            {
                "factor": row.factor,
                "parents_mean": row.means[0], "clones_mean": row.means[1],
                "parents_deviation": row.deviations[0], "clones_deviation": row.deviations[1],
                "mean_error_percent": row.mean_error, "mean_error_floor": row.floor.mean_error[0],
                "deviation_error_percent": row.deviation_error,
                "deviation_error_floor": row.floor.deviation_error[0],
                "ks": row.ks, "ks_floor": row.floor.ks[0],
                "wasserstein": row.wasserstein, "wasserstein_floor": row.floor.wasserstein[0],
                "at_floor": row.at_floor,
            }
            for row in self.factors
        ])  # fmt: skip


def assess(
    parents: Serialization,
    parent_factors: Population,
    clones: Serialization,
    clone_factors: Population,
    *,
    counts: Counts | None = None,
    true_factors: Population | None = None,
    seed: int = 0,
) -> Quality:
    """Return the quality of clones against their parents.

    Parameters
    ----------
    parents, clones : Serialization
    parent_factors, clone_factors : Population
        Of the same bodies in the same order, measured alike.
    counts : Counts, optional
        Of the generation, for the validity before the guard.
    true_factors : Population, optional
        True new grains of the parents' kind, from which the floor is found; else from the parents themselves.
    seed : int
        Of the samples and of the classifier.

    Raises
    ------
    GenerationError
        If rows do not match, or fewer than two of either could be measured.
    MeasureError
        If the populations were not measured alike.
    """
    for words, bodies, population in (
        ("parents", parents, parent_factors), ("clones", clones, clone_factors),
    ):  # fmt: skip
        if len(bodies) != len(population):
            raise GenerationError(
                f"{len(bodies)} {words} have factors of {len(population)}: measure all of them."
            )
    theirs, ours = _matrix(parent_factors), _matrix(clone_factors)
    keep, kept = np.isfinite(theirs).all(axis=1), np.isfinite(ours).all(axis=1)
    if min(keep.sum(), kept.sum()) < 2:
        raise GenerationError(
            f"Only {int(keep.sum())} parents and {int(kept.sum())} clones could be measured: "
            "a comparison needs at least two of each."
        )
    theirs, ours = theirs[keep], ours[kept]
    truth = None if true_factors is None else _matrix(true_factors)
    floors, correlation_floor = _floors(theirs, len(ours), truth, np.random.default_rng([seed, 0xF1]))
    found = compare(parent_factors, clone_factors, PAPER_FACTORS)
    correlations, error = _correlations(theirs, ours)
    told = None
    if min(len(theirs), len(ours)) >= 10:
        told = discrimination(
            parents.take(np.flatnonzero(keep)), clones.take(np.flatnonzero(kept)), theirs, ours, seed
        )
    return Quality(
        parents=len(theirs),
        clones=len(ours),
        factors=tuple(
            FactorQuality(
                name, found[name].means, found[name].deviations, found[name].mean_error,
                found[name].deviation_error, found[name].ks,
                found[name].wasserstein / found[name].deviations[0], floors[name],
            )
            for name in PAPER_FACTORS
        ),
        correlations=correlations,
        correlation_error=error,
        correlation_floor=correlation_floor,
        novelty=novelty(parents, clones, seed),
        discrimination=told,
        valid_before=None if counts is None else counts.valid_share,
        valid_after=float(clones.valid.mean()),
        floor="parents drawn again" if truth is None else f"{len(truth)} true new grains",
    )  # fmt: skip


def _matrix(population: Population) -> Float64[np.ndarray, "bodies 6"]:
    return np.stack([population.column(name) for name in PAPER_FACTORS], axis=1)


def _correlations(
    theirs: Float[np.ndarray, "parents 6"], ours: Float[np.ndarray, "clones 6"]
) -> tuple[tuple[tuple[str, str, float, float], ...], float]:
    first, second = np.triu_indices(len(PAPER_FACTORS), 1)
    a, b = (_correlation_matrix(values)[first, second] for values in (theirs, ours))
    rows = tuple(
        (PAPER_FACTORS[i], PAPER_FACTORS[j], float(x), float(y))
        for i, j, x, y in zip(first, second, a, b, strict=True)
    )
    return rows, float(np.sqrt(np.mean(np.square(a - b))))


def _correlation_matrix(values: Float[np.ndarray, "bodies 6"]) -> Float64[np.ndarray, "6 6"]:
    """Return correlations, 0 with a factor in which no two bodies differ."""
    away = values - values.mean(axis=0)
    length = np.linalg.norm(away, axis=0)
    scaled = away / np.where(length > 0, length, np.inf)
    correlations: np.ndarray = scaled.T @ scaled
    return correlations


def _floors(
    theirs: Float[np.ndarray, "parents 6"],
    count: int,
    truth: Float[np.ndarray, "true 6"] | None,
    rng: np.random.Generator,
) -> tuple[dict[str, Floor], tuple[float, float]]:
    """Return what samples of `count` true grains score.

    Without true grains both sides are drawn from the parents with replacement: as many parents as there are,
    and `count` new ones.
    """
    scores = np.empty((_REPEATS, 4, len(PAPER_FACTORS)))
    correlations = np.empty(_REPEATS)
    for repeat in range(_REPEATS):
        if truth is None:
            reference = theirs[rng.integers(len(theirs), size=len(theirs))]
            new = theirs[rng.integers(len(theirs), size=count)]
        else:
            reference, new = theirs, truth[rng.integers(len(truth), size=count)]
        scores[repeat] = _scores(reference, new)
        correlations[repeat] = _correlations(reference, new)[1]
    low, high = np.percentile(scores, [50, _HIGH], axis=0)
    floors = {
        name: Floor(*((float(low[k, i]), float(high[k, i])) for k in range(4)))
        for i, name in enumerate(PAPER_FACTORS)
    }
    return floors, (float(np.median(correlations)), float(np.percentile(correlations, _HIGH)))


def _scores(reference: np.ndarray, new: np.ndarray) -> Float64[np.ndarray, "4 6"]:
    """Return errors of mean and deviation in percent, K-S statistic and scaled Wasserstein distance."""
    mean, spread = reference.mean(axis=0), reference.std(axis=0, ddof=1)
    safe = np.where(spread > 0, spread, np.inf)
    errors = [
        100.0 * np.abs(new.mean(axis=0) - mean) / np.abs(mean),
        100.0 * np.abs(new.std(axis=0, ddof=1) - spread) / safe,
    ]
    distances = np.array([_distances(reference[:, i], new[:, i]) for i in range(reference.shape[1])]).T
    return np.array([*errors, distances[0], distances[1] / safe])


def _distances(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Return the largest distance of two cumulative distributions, and the area between them."""
    steps = np.sort(np.concatenate([a, b]))
    gap = np.abs(
        np.searchsorted(np.sort(a), steps, side="right") / len(a)
        - np.searchsorted(np.sort(b), steps, side="right") / len(b)
    )
    return float(gap.max()), float(gap[:-1] @ np.diff(steps))
