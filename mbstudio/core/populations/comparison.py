"""Two populations compared, factor by factor."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import MeasureError
from mbstudio.core.populations.distributions import cumulative, moments
from mbstudio.core.populations.population import Population, Weighting

PAPER_FACTORS = ("sphericity", "circularity", "dns", "csf", "volume", "area")
"""The six factors by which the paper compares populations (its figures 8, 11 and 12)."""


@dataclass(frozen=True)
class FactorComparison:
    """One factor of two populations.

    Attributes
    ----------
    factor : str
    numbers : tuple of int
        Bodies that have the factor: of the reference, of the other.
    means, deviations : tuple of float
        Mean and sample standard deviation, in the factor's unit.
    mean_error, deviation_error : float
        100 |other - reference| / |reference| of mean and standard deviation, in percent: the errors that the
        paper reports. NaN where the reference is zero or has no deviation.
    ks : float
        Kolmogorov-Smirnov statistic: largest distance of the two cumulative distributions.
    p : float
        Probability of a statistic at least as large if both were independent samples of one distribution; NaN
        with weights. Avatars are no independent sample of their own grains: there p errs to the large side.
    wasserstein : float
        Area between the two cumulative distributions, in the factor's unit.
    """

    factor: str
    numbers: tuple[int, int]
    means: tuple[float, float]
    deviations: tuple[float, float]
    mean_error: float
    deviation_error: float
    ks: float
    p: float
    wasserstein: float


def compare(
    reference: Population,
    other: Population,
    factors: Sequence[str] | None = None,
    *,
    by: Weighting = "number",
) -> dict[str, FactorComparison]:
    """Compare two populations, by number of bodies or by their volume.

    Parameters
    ----------
    reference, other : Population
        Of the same unit and the same axes.
    factors : sequence of str, optional
        All that both hold by default. A factor that no body of one population has is left out.
    by : {'number', 'volume'}

    Returns
    -------
    dict of str to FactorComparison

    Raises
    ------
    MeasureError
        If unit or axes differ, or a factor is not there.

    References
    ----------
    Zhao et al. (2023), Computers and Geotechnics 161, 105564, section 4.3 and figures 8, 11, 12.
    """
    _require_alike(reference, other)
    names = factors or [name for name in reference.factors if name in other.factors]
    return {
        name: _compare_factor(name, reference, other, by)
        for name in names
        if len(reference.values(name)) and len(other.values(name))
    }


def relative_errors(reference: Population, other: Population, factor: str) -> dict[int, float]:
    """Return other / reference - 1 of one factor, by label, for the bodies that both have.

    What an avatar misses of its own grain; NaN where the reference is zero.

    Raises
    ------
    MeasureError
        If unit or axes differ, a factor is not there, or a label stands twice in one population.
    """
    _require_alike(reference, other)
    mine, theirs = (_map_by_label(population, factor) for population in (reference, other))
    with np.errstate(divide="ignore", invalid="ignore"):
        return {
            label: float(np.divide(theirs[label], value) - 1.0) if value else float("nan")
            for label, value in mine.items()
            if label in theirs
        }


def _map_by_label(population: Population, factor: str) -> dict[int, float]:
    column = population.column(factor)
    if len(set(population.labels.tolist())) < len(population):
        raise MeasureError(
            f"Population '{population.name}' has a duplicate label, so its bodies cannot be paired."
        )
    return {
        int(label): float(value)
        for label, value in zip(population.labels, column, strict=True)
        if np.isfinite(value)
    }


def _require_alike(reference: Population, other: Population) -> None:
    for what in ("unit", "axes"):
        mine, theirs = getattr(reference, what), getattr(other, what)
        if mine != theirs:
            raise MeasureError(
                f"'{reference.name}' has {what} '{mine}' and '{other.name}' '{theirs}': "
                "measure both alike to compare them."
            )


def _compare_factor(name: str, reference: Population, other: Population, by: Weighting) -> FactorComparison:
    from scipy.stats import wasserstein_distance

    values = reference.values(name), other.values(name)
    weights = reference.weights(name, by), other.weights(name, by)
    (mean, deviation), (mean_2, deviation_2) = (moments(v, w) for v, w in zip(values, weights, strict=True))
    ks, p = _kolmogorov_smirnov(*values) if by == "number" else (_largest_gap(values, weights), float("nan"))
    return FactorComparison(
        factor=name,
        numbers=(len(values[0]), len(values[1])),
        means=(mean, mean_2),
        deviations=(deviation, deviation_2),
        mean_error=_percent(mean, mean_2),
        deviation_error=_percent(deviation, deviation_2),
        ks=ks,
        p=p,
        wasserstein=float(wasserstein_distance(*values, *weights)),
    )


def _percent(reference: float, other: float) -> float:
    return 100.0 * abs(other - reference) / abs(reference) if reference else float("nan")


def _kolmogorov_smirnov(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " m"]) -> tuple[float, float]:
    from scipy.stats import ks_2samp

    with warnings.catch_warnings():
        # Where the exact sum fails scipy takes the asymptotic one, which is as good for that many bodies.
        warnings.filterwarnings("ignore", message="ks_2samp: Exact", category=RuntimeWarning)
        found = ks_2samp(a, b)
    return float(found.statistic), float(found.pvalue)


def _largest_gap(values: tuple[np.ndarray, np.ndarray], weights: tuple[np.ndarray, np.ndarray]) -> float:
    first, second = (cumulative(v, w) for v, w in zip(values, weights, strict=True))
    steps = np.union1d(first.values, second.values)
    return float(np.abs(first(steps) - second(steps)).max())
