"""How sure the numbers and curves of a population are: its bodies drawn again.

A population is taken for a random sample of bodies. Drawing as many bodies from it, with replacement, shows
how its numbers would spread over other samples of the same size (Efron 1979). Intervals are those of the
percentiles. They do not hold what no body of the sample shows: the tail beyond the largest, or what sampling
or segmentation left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from mbstudio.core.errors import MeasureError
from mbstudio.core.populations.population import Population, Weighting

FEWEST = 10
"""Bodies below which there is no interval: drawing so few again shows far too little."""
SAMPLES = 1000
LEVEL = 0.95
_MOST_CELLS = 20_000_000
"""Bodies times samples that are held at once."""


@dataclass(frozen=True)
class Interval:
    """A number with its interval.

    Attributes
    ----------
    value : float
        Of the population itself.
    low, high : float
        Ends of the interval; NaN where there is none.
    """

    value: float
    low: float
    high: float

    @property
    def half_width(self) -> float:
        """Half of the interval over the value; NaN where there is none."""
        return abs((self.high - self.low) / 2 / self.value) if self.value else float("nan")


@dataclass(frozen=True, eq=False)
class Band:
    """A curve with an interval at each point (pointwise, not of the curve as a whole).

    Attributes
    ----------
    x : float array, shape (points,)
    value, low, high : float array, shape (points,)
        NaN for the ends where there is no interval.
    """

    x: Float[np.ndarray, " points"]
    value: Float[np.ndarray, " points"]
    low: Float[np.ndarray, " points"]
    high: Float[np.ndarray, " points"]


class Bootstrap:
    """The bodies of a population drawn again and again.

    Parameters
    ----------
    population : Population
    samples : int
        How often.
    level : float
        Of the intervals, 0 to 1.
    seed : int
        The same seed gives the same intervals.

    Raises
    ------
    MeasureError
        If there are fewer than 100 samples, or the level is not between 0 and 1.
    """

    def __init__(
        self, population: Population, *, samples: int = SAMPLES, level: float = LEVEL, seed: int = 0
    ) -> None:
        if samples < 100:
            raise MeasureError(f"{samples} samples are too few for an interval: draw at least 100.")
        if not 0 < level < 1:
            raise MeasureError(f"The level of an interval lies between 0 and 1, not at {level:g}.")
        self.population, self.samples, self.level, self.seed = population, samples, level, seed
        self._kept: dict[bytes, Int[np.ndarray, "samples bodies"]] = {}

    def mean(self, factor: str, by: Weighting = "number") -> Interval:
        """Return the mean of a factor, by number or by volume."""
        values, weights, rows = self._of(factor, by)
        return self._interval(rows, lambda counts: counts * weights @ values / (counts @ weights))

    def deviation(self, factor: str, by: Weighting = "number") -> Interval:
        """Return the sample standard deviation of a factor."""
        values, weights, rows = self._of(factor, by)

        def spread(counts: Float[np.ndarray, "samples bodies"]) -> Float64[np.ndarray, " samples"]:
            shares = counts * weights
            shares = shares / shares.sum(axis=1, keepdims=True)
            means = shares @ values
            # As in `moments`: each body that was drawn is one value, also one that was drawn twice.
            drawn = (counts * (weights**2)).sum(axis=1) / (counts @ weights) ** 2
            away = shares @ values**2 - means**2
            with np.errstate(divide="ignore", invalid="ignore"):
                found: np.ndarray = np.sqrt(np.maximum(away, 0.0) / (1.0 - drawn))
            return found

        return self._interval(rows, spread)

    def quantile(self, factor: str, share: float, by: Weighting = "number") -> Interval:
        """Return the smallest value with at least this share (0 to 1) at or below it."""
        if not 0 <= share <= 1:
            raise MeasureError(f"The share must be between 0 and 1, not {share:g}.")
        values, weights, rows = self._of(factor, by)
        order = np.argsort(values, kind="stable")

        def read(counts: Float[np.ndarray, "samples bodies"]) -> Float64[np.ndarray, " samples"]:
            sums = np.cumsum((counts * weights)[:, order], axis=1)
            place = (sums < (share - 1e-12) * sums[:, -1:]).sum(axis=1)
            found: np.ndarray = values[order][np.minimum(place, len(order) - 1)]
            return found

        return self._interval(rows, read)

    def diameter(self, percent: float) -> Interval:
        """Return D_x by volume, in the population's unit, of the bodies' own sizes."""
        return self._interval(self._sized, lambda counts: self._diameters(counts, (percent,))[:, 0])

    @property
    def cu(self) -> Interval:
        """Coefficient of uniformity D60 / D10."""

        def ratio(counts: Float[np.ndarray, "samples bodies"]) -> Float64[np.ndarray, " samples"]:
            d10, d60 = self._diameters(counts, (10, 60)).T
            found: np.ndarray = d60 / d10
            return found

        return self._interval(self._sized, ratio)

    @property
    def cc(self) -> Interval:
        """Coefficient of curvature D30^2 / (D10 D60)."""

        def ratio(counts: Float[np.ndarray, "samples bodies"]) -> Float64[np.ndarray, " samples"]:
            d10, d30, d60 = self._diameters(counts, (10, 30, 60)).T
            found: np.ndarray = d30**2 / (d10 * d60)
            return found

        return self._interval(self._sized, ratio)

    def finer(self, sizes: Float[np.ndarray, " points"]) -> Band:
        """Return the percent finer by mass at sizes in the population's unit."""
        own, volume = (self.population.column(name)[self._sized] for name in ("intermediate", "volume"))
        at = np.asarray(sizes, dtype=float)
        below = (own[:, None] <= at[None]) * volume[:, None]
        return self._band(self._sized, at, lambda counts: 100.0 * counts @ below / (counts @ volume)[:, None])

    def cumulative(self, factor: str, at: Float[np.ndarray, " points"], by: Weighting = "number") -> Band:
        """Return the share at or below each of these values."""
        values, weights, rows = self._of(factor, by)
        below = (values[:, None] <= np.asarray(at, dtype=float)[None]) * weights[:, None]
        return self._band(rows, at, lambda counts: counts @ below / (counts @ weights)[:, None])

    def density(self, factor: str, at: Float[np.ndarray, " points"], by: Weighting = "number") -> Band:
        """Return the kernel density at these values, with the width of the population's own kernels.

        Raises
        ------
        MeasureError
            If all values are equal.
        """
        from mbstudio.core.populations.distributions import kernel_width

        values, weights, rows = self._of(factor, by)
        width = kernel_width(values, weights)
        away = (np.asarray(at, dtype=float)[None] - values[:, None]) / width
        kernels = np.exp(-0.5 * away**2) * (weights / (width * np.sqrt(2 * np.pi)))[:, None]
        return self._band(rows, at, lambda counts: counts @ kernels / (counts @ weights)[:, None])

    def share(self, chosen: Bool[np.ndarray, " bodies"], by: Weighting = "number") -> Interval:
        """Return the share of some bodies (one flag a row of the population) among all that were measured."""
        rows = self._sized
        weights = np.ones(int(rows.sum())) if by == "number" else self.population.column("volume")[rows]
        marked = np.asarray(chosen, dtype=bool)[rows] * weights
        return self._interval(rows, lambda counts: (counts @ marked) / (counts @ weights))

    # ---- drawing -------------------------------------------------------------------------------

    @property
    def _sized(self) -> Bool[np.ndarray, " bodies"]:
        """Which bodies have size and volume."""
        rows: np.ndarray = np.isfinite(
            np.stack([self.population.column("intermediate"), self.population.column("volume")])
        ).all(axis=0)
        return rows

    def _of(
        self, factor: str, by: Weighting
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Bool[np.ndarray, " bodies"]]:
        column = self.population.column(factor)
        rows = np.isfinite(column)
        if by == "volume":
            rows = rows & np.isfinite(self.population.column("volume"))
            return column[rows], self.population.column("volume")[rows], rows
        return column[rows], self.population.weights(factor, by), rows

    def _diameters(
        self, counts: Float[np.ndarray, "samples bodies"], percents: tuple[float, ...]
    ) -> Float64[np.ndarray, "samples percents"]:
        """Return D_x of each sample, linear in the logarithm of the size between two bodies."""
        own, volume = (self.population.column(name)[self._sized] for name in ("intermediate", "volume"))
        sizes, place = np.unique(own, return_inverse=True)
        mass = np.zeros((len(counts), len(sizes)))
        for column, weighed in zip(place, (counts * volume).T, strict=True):
            mass[:, column] += weighed
        finer = 100.0 * np.cumsum(mass, axis=1) / mass.sum(axis=1, keepdims=True)
        logs = np.log(sizes)
        found = np.empty((len(counts), len(percents)))
        for row, shares in enumerate(finer):
            there = np.flatnonzero(mass[row] > 0)  # sizes that were not drawn are no points of the curve
            for column, percent in enumerate(percents):
                above = int(np.searchsorted(shares[there], percent - 1e-9))
                above = min(above, len(there) - 1)
                if above == 0:
                    found[row, column] = sizes[there[0]]
                    continue
                low, high = there[above - 1], there[above]
                part = (percent - shares[low]) / (shares[high] - shares[low])
                found[row, column] = np.exp(logs[low] + part * (logs[high] - logs[low]))
        return found

    def _counts(self, count: int) -> Float64[np.ndarray, "samples bodies"]:
        """Return how often each body was drawn into each sample."""
        rng = np.random.default_rng([self.seed, count])
        drawn = rng.integers(count, size=(self.samples, count))
        offsets = count * np.arange(self.samples)[:, None]
        counts = np.bincount((drawn + offsets).ravel(), minlength=self.samples * count)
        return counts.reshape(self.samples, count).astype(np.float64)

    def _drawn(
        self, rows: Bool[np.ndarray, " bodies"], of: Callable[[Float[np.ndarray, "s n"]], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Return a statistic of the population, and of each sample; None where there are too few."""
        count = int(rows.sum())
        if count == 0:
            raise MeasureError(
                f"No body of population '{self.population.name}' has what is asked for: there is nothing to "
                "draw."
            )
        own = of(np.ones((1, count)))[0]
        if count < FEWEST:
            return own, None
        if count * self.samples > _MOST_CELLS:
            rng = np.random.default_rng([self.seed, count])
            parts = []
            for _ in range(self.samples):
                drawn = np.bincount(rng.integers(count, size=count), minlength=count)
                parts.append(of(drawn[None].astype(np.float64))[0])
            return own, np.array(parts)
        return own, of(self._counts(count))

    def _interval(
        self, rows: Bool[np.ndarray, " bodies"], of: Callable[[Float[np.ndarray, "s n"]], np.ndarray]
    ) -> Interval:
        own, drawn = self._drawn(rows, of)
        low, high = self._ends(drawn, np.shape(own))
        return Interval(float(own), float(low), float(high))

    def _band(
        self,
        rows: Bool[np.ndarray, " bodies"],
        at: Float[np.ndarray, " points"],
        of: Callable[[Float[np.ndarray, "s n"]], np.ndarray],
    ) -> Band:
        own, drawn = self._drawn(rows, of)
        low, high = self._ends(drawn, own.shape)
        return Band(np.asarray(at, dtype=float), own, low, high)

    def _ends(self, drawn: np.ndarray | None, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        if drawn is None:
            return np.full(shape, np.nan), np.full(shape, np.nan)
        outside = 50.0 * (1.0 - self.level)
        low, high = np.percentile(drawn, [outside, 100.0 - outside], axis=0)
        return low, high
