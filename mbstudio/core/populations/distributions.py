"""Distributions of one factor: cumulative and density, by number or by weight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import MeasureError

_MOST_BINS = 200
_DENSITY_POINTS = 256


@dataclass(frozen=True, eq=False)
class Cdf:
    """Empirical cumulative distribution: a staircase that rises at every value.

    Attributes
    ----------
    values : float array, shape (steps,)
        Rising, each once.
    shares : float array, shape (steps,)
        Share of the weight at or below each value; the last is 1.
    """

    values: Float[np.ndarray, " steps"]
    shares: Float[np.ndarray, " steps"]

    def __call__(self, x: Float[np.ndarray, " points"] | float) -> Float[np.ndarray, " points"]:
        """Return the share at or below x."""
        places = np.searchsorted(self.values, np.asarray(x, dtype=float), side="right")
        return np.concatenate([[0.0], self.shares])[places]

    def quantile(self, share: float) -> float:
        """Return the smallest value with at least this share (0 to 1) at or below it."""
        if not 0 <= share <= 1:
            raise MeasureError(f"The share must be between 0 and 1, not {share:g}.")
        # Sums of weights miss the exact share by rounding.
        place = int(np.searchsorted(self.shares, share - 1e-12))
        return float(self.values[min(place, len(self.values) - 1)])


@dataclass(frozen=True, eq=False)
class Density:
    """A probability density, of area 1 over the values.

    Attributes
    ----------
    x : float array
        Where: shape (points,) of a kernel density; the edges, shape (bins + 1,), of a histogram.
    density : float array
        Per unit of the factor: shape (points,) or (bins,).
    """

    x: Float[np.ndarray, " points"]
    density: Float[np.ndarray, " values"]


def cumulative(values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"] | None = None) -> Cdf:
    """Return the empirical cumulative distribution.

    Parameters
    ----------
    values : float array, shape (n,)
    weights : float array, shape (n,), optional
        Not negative; equal by default. Volumes give the share by mass at one density.

    Raises
    ------
    MeasureError
        If there are no values, one is not finite, or the weights are not weights.
    """
    values, weights = _check_values(values, weights)
    steps, place = np.unique(values, return_inverse=True)
    shares = np.cumsum(np.bincount(place, weights=weights))
    shares[-1] = 1.0
    return Cdf(steps, shares)


def moments(
    values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"] | None = None
) -> tuple[float, float]:
    """Return mean and sample standard deviation.

    With n equal weights the variance is the sum of squares over n - 1; with others n is the effective number
    1 / sum(w**2). NaN for the standard deviation of one value.
    """
    values, weights = _check_values(values, weights)
    mean = float(weights @ values)
    rest = 1.0 - float(weights @ weights)
    if len(values) == 1 or rest < 1e-12:
        return mean, float("nan")
    return mean, float(np.sqrt(weights @ (values - mean) ** 2 / rest))


def histogram(
    values: Float[np.ndarray, " n"],
    weights: Float[np.ndarray, " n"] | None = None,
    edges: Float[np.ndarray, " edges"] | None = None,
) -> Density:
    """Return the density as a histogram.

    Parameters
    ----------
    values, weights
        As for `cumulative`.
    edges : float array, optional
        Of the bins, so that two populations share them; else by `bin_edges`. Values outside do not count.

    Raises
    ------
    MeasureError
        As `cumulative`.
    """
    values, weights = _check_values(values, weights)
    chosen = bin_edges(values, weights) if edges is None else np.asarray(edges, dtype=float)
    heights, _ = np.histogram(values, chosen, weights=weights)
    return Density(chosen, heights / np.diff(chosen))


def bin_edges(
    values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"] | None = None
) -> Float[np.ndarray, " edges"]:
    """Return bins as wide as the rule of Freedman and Diaconis says: 2 IQR / n**(1/3).

    Weighted values have weighted quartiles and the effective number 1 / sum(w**2). Without a quartile range
    Sturges' number of bins is taken; equal values have one bin around them.

    References
    ----------
    Freedman & Diaconis (1981), On the histogram as a density estimator, Z. Wahrscheinlichkeitstheorie verw.
    Gebiete 57, 453-476.
    """
    values, weights = _check_values(values, weights)
    low, high = float(values.min()), float(values.max())
    span = high - low
    # Values that differ by less than rounding are one value.
    if span <= 1e-12 * max(abs(low), abs(high)):
        half = 0.05 * abs(low) or 0.5
        return np.array([low - half, high + half])
    cdf = cumulative(values, weights)
    number = 1.0 / float(weights @ weights)
    width = 2.0 * (cdf.quantile(0.75) - cdf.quantile(0.25)) / np.cbrt(number)
    bins = int(np.ceil(span / width)) if width > span / _MOST_BINS else 0
    if width <= 0:
        bins = int(np.ceil(np.log2(number))) + 1
    return np.linspace(low, high, max(1, min(bins or _MOST_BINS, _MOST_BINS)) + 1)


def kernel_density(
    values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"] | None = None
) -> Density:
    """Return the density by Gaussian kernels of Scott's width, three widths beyond the values on both sides.

    Raises
    ------
    MeasureError
        As `cumulative`, or if all values are equal: they have no density.

    References
    ----------
    Scott (1992), Multivariate Density Estimation, Wiley.
    """
    from scipy.stats import gaussian_kde

    values, weights = _check_values(values, weights)
    low, high = float(values.min()), float(values.max())
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        raise MeasureError(
            "The density of values that are all equal is undefined: show their number instead."
        )
    kernel = gaussian_kde(values, weights=weights)
    reach = 3.0 * kernel_width(values, weights)
    x = np.linspace(low - reach, high + reach, _DENSITY_POINTS)
    return Density(x, kernel(x))


def kernel_width(values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"] | None = None) -> float:
    """Return Scott's width of the kernels of `kernel_density`: n**(-1/5) standard deviations.

    n is the effective number of weighted values, 1 / sum(w**2).

    Raises
    ------
    MeasureError
        As `cumulative`, or if all values are equal.
    """
    values, weights = _check_values(values, weights)
    _, deviation = moments(values, weights)
    if not deviation > 0:
        raise MeasureError(
            "The density of values that are all equal is undefined: show their number instead."
        )
    return float(deviation * (1.0 / float(weights @ weights)) ** -0.2)


def _check_values(
    values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"] | None
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    values = np.asarray(values, dtype=float)
    if values.ndim != 1 or not len(values):
        raise MeasureError("A distribution needs at least one value.")
    if not np.isfinite(values).all():
        raise MeasureError("A distribution needs finite values: leave out bodies that could not be measured.")
    weights = np.ones(len(values)) if weights is None else np.asarray(weights, dtype=float)
    if weights.shape != values.shape or not np.isfinite(weights).all() or (weights < 0).any():
        raise MeasureError(f"{len(values)} values need the same number of finite, non-negative weights.")
    total = float(weights.sum())
    if not total > 0:
        raise MeasureError("All weights are zero.")
    return values, weights / total
