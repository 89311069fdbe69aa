"""All that a laboratory asks of a population: sizes with intervals, grains needed, classes, indices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from mbstudio.core.metrics.bodies import UNITLESS
from mbstudio.core.populations.bootstrap import LEVEL, Bootstrap, Interval
from mbstudio.core.populations.classes import SCALES, FormIndex, class_shares, form_indices, uscs_symbol
from mbstudio.core.populations.laboratory import LaboratoryCurve, largest_gap
from mbstudio.core.populations.population import Population
from mbstudio.core.populations.sample_size import Need, needed_bodies
from mbstudio.core.populations.sieving import SizeDistribution, size_distribution

PERCENTS = (10, 30, 50, 60, 90)


@dataclass(frozen=True, eq=False)
class Against:
    """A curve of a laboratory beside that of the scan.

    Attributes
    ----------
    table : LaboratoryCurve
    scan : SizeDistribution
        Of the scan at the laboratory's openings.
    gap, gap_at : float
        Largest difference in percent finer, scan less laboratory, and the opening in mm where it is.
    """

    table: LaboratoryCurve
    scan: SizeDistribution
    gap: float
    gap_at: float


@dataclass(frozen=True, eq=False)
class Findings:
    """What is found of one population.

    Attributes
    ----------
    population : Population
    curve : SizeDistribution
        Of the bodies' own sizes, corrected for the border where counts were given.
    is_corrected : bool
    sizes : mapping of str to Interval
        'd10' to 'd90', 'cu' and 'cc', of the sample as it is; in the population's unit.
    needs : list of Need
    classes : mapping of str to (mapping of str to float)
        Percent of the mass in every class, by scale; empty without a unit.
    symbol : tuple of str
        By ASTM D2487, and why; empty without a unit.
    indices : list of FormIndex
    against : list of Against
    level, precision : float
    seed : int
    """

    population: Population
    curve: SizeDistribution
    is_corrected: bool
    sizes: Mapping[str, Interval]
    needs: list[Need]
    classes: Mapping[str, Mapping[str, float]]
    symbol: tuple[str, str]
    indices: list[FormIndex]
    against: list[Against]
    level: float
    precision: float
    seed: int


def find_sizes(
    population: Population,
    *,
    counts: Float[np.ndarray, " bodies"] | None = None,
    tables: Sequence[LaboratoryCurve] = (),
    precision: float = 0.05,
    level: float = LEVEL,
    seed: int = 0,
) -> Findings:
    """Return sizes, needed numbers, classes, indices and the comparison with laboratory tables.

    Parameters
    ----------
    population : Population
    counts : float array, shape (bodies,), optional
        How many bodies each stands for (`border_weights`): they correct curve and comparison.
    tables : sequence of LaboratoryCurve
    precision, level, seed
        As for `needed_bodies`.

    Raises
    ------
    MeasureError
        If no body could be measured, or a table has no size in common with the bodies.
    UnitError
        If there are tables for bodies without a unit.
    """
    drawn = Bootstrap(population, level=level, seed=seed)
    sizes = {f"d{percent}": drawn.diameter(percent) for percent in PERCENTS}
    sizes |= {"cu": drawn.cu, "cc": drawn.cc}
    has_unit = population.unit != UNITLESS
    curve = size_distribution(population, counts=counts)
    return Findings(
        population, curve, counts is not None, sizes,
        needed_bodies(population, precision, level=level, seed=seed),
        {scale: class_shares(population, scale) for scale in SCALES} if has_unit else {},
        uscs_symbol(population) if has_unit else ("", ""),
        form_indices(population) if has_unit else [],
        [_compare(population, counts, table) for table in tables], level, precision, seed,
    )  # fmt: skip


def _compare(
    population: Population, counts: Float[np.ndarray, " bodies"] | None, table: LaboratoryCurve
) -> Against:
    scan = size_distribution(population.in_unit("mm"), counts=counts, openings=table.curve.sizes)
    return Against(table, scan, *largest_gap(table.curve, scan))
