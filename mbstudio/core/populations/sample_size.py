"""Enough grains? How many bodies numbers of a size distribution need for a precision.

Two answers, of which the larger counts. One follows from the population at hand: its bodies are drawn again,
and the width of the interval goes with one over the root of their number. The other takes the sizes for
log-normal, as ISO 13322-1 does after Masuda and Iinoya: then it depends on their spread alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from mbstudio.core.errors import MeasureError
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations.bootstrap import FEWEST, LEVEL, Bootstrap, Interval
from mbstudio.core.populations.population import Population

SIZES = ("mean", "d10", "d50", "d90")
_BY_VOLUME = 3
"""Power of the size that a body counts with, in a distribution by volume."""
_FEWEST_LOGNORMAL = 3
_ALIKE = 1e-9


@dataclass(frozen=True)
class Need:
    """How many bodies one number needs.

    Attributes
    ----------
    name : str
        'mean', 'd10', 'd50' or 'd90' (sizes by volume), or the name of a shape factor, whose mean is by
        number.
    found : Interval
        The number with its interval, in the population's unit.
    bodies : int
        That there are.
    precision : float
        Wanted: half of the interval over the value.
    by_bootstrap : int or None
        Bodies needed as the population at hand says; None where there are too few to draw again, or all are
        alike.
    by_lognormal : int or None
        Bodies needed if sizes were log-normal with the spread of these: the larger of `lognormal_bodies` and
        `read_off_bodies`. None for shape factors, and where sizes do not spread.
    """

    name: str
    found: Interval
    bodies: int
    precision: float
    by_bootstrap: int | None
    by_lognormal: int | None

    @property
    def needed(self) -> int | None:
        """The larger of both; None if there is neither."""
        given = [number for number in (self.by_bootstrap, self.by_lognormal) if number is not None]
        return max(given) if given else None

    @property
    def is_enough(self) -> bool | None:
        """Whether there are as many; None if that cannot be told."""
        return None if self.needed is None or self.by_bootstrap is None else self.bodies >= self.needed


def needed_bodies(
    population: Population,
    precision: float = 0.05,
    *,
    level: float = LEVEL,
    factors: tuple[str, ...] = (),
    samples: int = 1000,
    seed: int = 0,
) -> list[Need]:
    """Return how many bodies mean size, D10, D50 and D90 by volume need, and the means of some factors.

    The size of a body is its intermediate axis.

    Parameters
    ----------
    population : Population
    precision : float
        Wanted half width of the interval over the value, such as 0.05.
    level : float
        Of the intervals.
    factors : tuple of str
        Further factors, by their mean by number.
    samples, seed : int
        Of :class:`~mbstudio.core.populations.bootstrap.Bootstrap`.

    Raises
    ------
    MeasureError
        If the precision is not between 0 and 1, no body could be measured, or a factor is not there.

    References
    ----------
    ISO 13322-1:2014, annex on the number of particles; Masuda & Iinoya (1971), Theoretical analysis of the
    scatter of experimental data due to particle-size-distribution, J. Chem. Eng. Japan 4, 60-66.
    """
    if not 0 < precision < 1:
        raise MeasureError(f"The precision is a share between 0 and 1, such as 0.05, not {precision:g}.")
    drawn = Bootstrap(population, samples=samples, level=level, seed=seed)
    sizes = population.column("intermediate")
    there = np.isfinite(sizes) & np.isfinite(population.column("volume"))
    spread = _log_spread(sizes[there])
    count = int(there.sum())
    needs = []
    for name in SIZES:
        found = drawn.mean("intermediate", "volume") if name == "mean" else drawn.diameter(int(name[1:]))
        expected = None
        if spread is not None:
            percent = None if name == "mean" else int(name[1:])
            expected = max(
                how(spread, precision, percent, level) for how in (lognormal_bodies, read_off_bodies)
            )
        needs.append(Need(name, found, count, precision, _drawn_number(found, count, precision), expected))
    for name in factors:
        if name not in FACTORS:
            raise MeasureError(f"'{name}' is not a factor: use one of {', '.join(population.factors)}.")
        found, count = drawn.mean(name), len(population.values(name))
        needs.append(Need(name, found, count, precision, _drawn_number(found, count, precision), None))
    return needs


def lognormal_bodies(
    spread: float, precision: float, percent: float | None = None, level: float = LEVEL
) -> int:
    """Return how many bodies of log-normal sizes a number of their distribution by volume needs.

    With n bodies of spread s (standard deviation of ln size, by number), ln D has the variance
    (s**2 / n) (1 + (2 c s + z)**2 / 2): c = 3 and z the normal quantile for D_x; c = 3.5, z = 0 for the mean.
    For the mean and the median this is Masuda and Iinoya's s**2 (2 c**2 s**2 + 1) / n.

    Parameters
    ----------
    spread : float
    precision : float
        Half of the interval over the value.
    percent : float, optional
        Of D_x; None for the mean size by volume.
    level : float
        Of the interval.
    """
    if not spread > 0:
        raise MeasureError("Sizes that do not spread need no number of bodies: give a spread above 0.")
    if percent is not None and not 0 < percent < 100:
        raise MeasureError(f"D{percent:g} is not defined: give a percentage between 0 and 100.")
    c = _BY_VOLUME + (0.5 if percent is None else 0.0)
    z = 0.0 if percent is None else float(ndtri(percent / 100.0))
    u = float(ndtri(0.5 + level / 2.0))
    return int(np.ceil((u / precision * spread) ** 2 * (1.0 + (2.0 * c * spread + z) ** 2 / 2.0)))


def read_off_bodies(
    spread: float, precision: float, percent: float | None = None, level: float = LEVEL
) -> int:
    """Return how many bodies of log-normal sizes a number needs that is read off, not fitted.

    Masuda and Iinoya's number is for one who fits the law to the sizes. Whoever weighs the bodies themselves
    has the wider spread of a quotient of sums: for the mean sum(d**4) / sum(d**3) the variance of ln D is
    (e**(16 s**2) - 2 e**(12 s**2) + e**(9 s**2)) / n, for D_x
    e**(9 s**2) s**2 ((1 - p)**2 P + p**2 (1 - P)) / (n f(z)**2) with p = x / 100, P = F(z - 3 s), and f and F
    the normal density and distribution.

    Parameters
    ----------
    spread, precision, percent, level
        As for `lognormal_bodies`.
    """
    lognormal_bodies(spread, precision, percent, level)  # refuses what has no answer
    squared = spread**2
    if percent is None:
        variance = np.exp(16 * squared) - 2 * np.exp(12 * squared) + np.exp(9 * squared)
    else:
        p, z = percent / 100.0, float(ndtri(percent / 100.0))
        below = float(ndtr(z - _BY_VOLUME * spread))
        density = np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)
        variance = np.exp(9 * squared) * squared * ((1 - p) ** 2 * below + p**2 * (1 - below)) / density**2
    u = float(ndtri(0.5 + level / 2.0))
    return int(np.ceil((u / precision) ** 2 * float(variance)))


def _log_spread(sizes: np.ndarray) -> float | None:
    """Return the standard deviation of ln size; None where there are too few, or all are alike."""
    if len(sizes) < _FEWEST_LOGNORMAL or not (sizes > 0).all():
        return None
    spread = float(np.log(sizes).std(ddof=1))
    return spread if spread > _ALIKE else None


def _drawn_number(found: Interval, count: int, precision: float) -> int | None:
    if count < FEWEST or not found.half_width > _ALIKE:
        return None
    return int(np.ceil(count * (found.half_width / precision) ** 2))
