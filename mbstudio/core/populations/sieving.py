"""Particle-size distribution as a sieve analysis finds it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import MeasureError, UnitError
from mbstudio.core.metrics.bodies import UNITLESS
from mbstudio.core.populations.population import Population
from mbstudio.core.units import conversion_factor

SieveSeries = Literal["iso", "astm"]

# Nominal apertures in mm.
_SERIES: dict[str, tuple[float, ...]] = {
    # Principal sizes R 20/3.
    "iso": (
        125, 90, 63, 45, 31.5, 22.4, 16, 11.2, 8, 5.6, 4, 2.8, 2, 1.4, 1, 0.71, 0.5, 0.355, 0.25, 0.18, 0.125,
        0.09, 0.063, 0.045,
    ),
    # No. 4 is 4.75 mm, No. 200 is 0.075 mm.
    "astm": (
        125, 106, 100, 90, 75, 63, 53, 50, 45, 37.5, 31.5, 26.5, 25, 22.4, 19, 16, 13.2, 12.5, 11.2, 9.5, 8,
        6.7, 6.3, 5.6, 4.75, 4, 3.35, 2.8, 2.36, 2, 1.7, 1.4, 1.18, 1, 0.85, 0.71, 0.6, 0.5, 0.425, 0.355,
        0.3, 0.25, 0.212, 0.18, 0.15, 0.125, 0.106, 0.09, 0.075, 0.063, 0.053, 0.045, 0.038, 0.032, 0.025,
        0.02,
    ),
}  # fmt: skip
SERIES_NAMES = {"iso": "ISO 3310-1 (R 20/3)", "astm": "ASTM E11"}


@dataclass(frozen=True, eq=False)
class SizeDistribution:
    """Percent finer by mass against size.

    The size of a body is its intermediate axis L_i, about the smallest opening that it passes;
    its mass is its volume times one density for all.

    Attributes
    ----------
    sizes : float array, shape (points,)
        Rising, in `unit`: sieve openings, or the bodies' own sizes.
    finer : float array, shape (points,)
        Percent of the mass at or below each size, 0 to 100.
    unit : str
    sieves : str
        Name of the series; empty for the bodies' own sizes.

    References
    ----------
    ISO 3310-1:2016 and ASTM E11-22 for the openings; ASTM D6913 and ISO 14688-2 for D_x, C_u and C_c.
    """

    sizes: Float[np.ndarray, " points"]
    finer: Float[np.ndarray, " points"]
    unit: str
    sieves: str = ""

    def diameter(self, percent: float) -> float:
        """Return D_x, the size that `percent` of the mass is finer than, in `unit`.

        Linear in the logarithm of the size between two points. On sieves NaN where none bounds it: more
        passes the finest sieve, or less the coarsest. Of the bodies' own sizes the smallest body's where that
        body alone is more.
        """
        if not 0 < percent <= 100:
            raise MeasureError(f"D{percent:g} is not defined: give a percentage above 0, at most 100.")
        above = int(np.searchsorted(self.finer, percent - 1e-9))
        if above == len(self.finer):
            return float("nan")
        if above == 0:
            return float("nan") if self.sieves else float(self.sizes[0])
        (low, high), (under, over) = (
            np.log(self.sizes[above - 1 : above + 1]),
            self.finer[above - 1 : above + 1],
        )
        return float(np.exp(low + (percent - under) / (over - under) * (high - low)))

    @property
    def d10(self) -> float:
        """Effective size, in `unit`."""
        return self.diameter(10)

    @property
    def d30(self) -> float:
        """Size that 30 % of the mass is finer than, in `unit`."""
        return self.diameter(30)

    @property
    def d50(self) -> float:
        """Median size by mass, in `unit`."""
        return self.diameter(50)

    @property
    def d60(self) -> float:
        """Size that 60 % of the mass is finer than, in `unit`."""
        return self.diameter(60)

    @property
    def cu(self) -> float:
        """Coefficient of uniformity C_u = D60 / D10."""
        return self.d60 / self.d10

    @property
    def cc(self) -> float:
        """Coefficient of curvature C_c = D30^2 / (D10 D60)."""
        return self.d30**2 / (self.d10 * self.d60)


def size_distribution(
    population: Population,
    sieves: SieveSeries | None = None,
    *,
    counts: Float[np.ndarray, " bodies"] | None = None,
    openings: Float[np.ndarray, " openings"] | None = None,
) -> SizeDistribution:
    """Return the particle-size distribution of a population.

    Parameters
    ----------
    population : Population
    sieves : {"iso", "astm"}, optional
        Read it off at the openings of a standard series, as a laboratory would; else at every body's size.
    counts : float array, shape (bodies,), optional
        How many bodies each stands for (`border_weights`); one by default.
    openings : float array, optional
        Read it off at these sizes, rising, in the population's unit, instead of a series.

    Raises
    ------
    MeasureError
        If no body could be measured, or the series is not known.
    UnitError
        If sieves are wanted for a population without a unit.
    """
    size, volume = population.column("intermediate"), population.column("volume")
    defined = np.isfinite(size) & np.isfinite(volume)
    if not defined.any():
        raise MeasureError(
            f"No body of population '{population.name}' could be measured, so it has no sizes."
        )
    if counts is not None and (len(counts) != len(population) or not (np.asarray(counts)[defined] > 0).all()):
        raise MeasureError(f"{len(population)} bodies need as many counts, all above zero.")
    size, volume = size[defined], (volume if counts is None else volume * counts)[defined]
    if openings is not None:
        return _read_at(size, volume, np.asarray(openings, dtype=float), population.unit, "own sieves")
    if sieves is None:
        at = np.unique(size)
    else:
        at = standard_sieves(sieves, float(size.min()), float(size.max()), population.unit)
    return _read_at(size, volume, at, population.unit, SERIES_NAMES[sieves] if sieves else "")


def _read_at(
    size: Float[np.ndarray, " n"],
    volume: Float[np.ndarray, " n"],
    openings: Float[np.ndarray, " openings"],
    unit: str,
    sieves: str,
) -> SizeDistribution:
    order = np.argsort(size, kind="stable")
    mass = np.concatenate([[0.0], np.cumsum(volume[order])])
    finer = 100.0 * mass[np.searchsorted(size[order], openings, side="right")] / mass[-1]
    return SizeDistribution(openings, finer, unit, sieves)


def standard_sieves(
    series: SieveSeries, low: float, high: float, unit: str
) -> Float[np.ndarray, " openings"]:
    """Return the openings of a series, rising, in `unit`, that hold the sizes `low` to `high` between them.

    Where the series ends inside that range, its last sieve is the last.

    Raises
    ------
    MeasureError
        If the series is not known, or ends before the range begins.
    UnitError
        If the unit is no length.
    """
    if series not in get_args(SieveSeries):
        raise MeasureError(f"sieves='{series}' is not known: use 'iso' or 'astm'.")
    if unit == UNITLESS:
        raise UnitError("Sieve openings are in mm, but these bodies have no unit: measure them with a unit.")
    openings = np.sort(np.array(_SERIES[series])) * conversion_factor("mm", unit)
    # The coarsest sieve that nothing passes, and the finest that everything passes.
    first = max(0, int(np.searchsorted(openings, low, side="left")) - 1)
    last = min(len(openings), int(np.searchsorted(openings, high, side="left")) + 1)
    if high < openings[0] or low > openings[-1]:
        raise MeasureError(
            f"Sizes of {low:.3g} to {high:.3g} {unit} lie outside the sieves of {SERIES_NAMES[series]}: "
            "take the bodies' own sizes."
        )
    return openings[first:last]
