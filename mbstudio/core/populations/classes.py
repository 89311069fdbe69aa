"""Classes of size and indices of form by name, as standards and textbooks define them.

All are found from the three axes and the volume of each body, at one density for all. A laboratory lets
stones through square openings and slots: here a body passes a square opening that its intermediate axis fits,
and a slot that its shortest axis fits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from mbstudio.core.errors import MeasureError, UnitError
from mbstudio.core.metrics.bodies import UNITLESS
from mbstudio.core.populations.population import Population
from mbstudio.core.populations.sieving import size_distribution
from mbstudio.core.units import conversion_factor

WENTWORTH = (
    ("clay", 0.0), ("very fine silt", 1 / 256), ("fine silt", 1 / 128), ("medium silt", 1 / 64),
    ("coarse silt", 1 / 32), ("very fine sand", 1 / 16), ("fine sand", 1 / 8), ("medium sand", 1 / 4),
    ("coarse sand", 1 / 2), ("very coarse sand", 1.0), ("granule", 2.0), ("pebble", 4.0), ("cobble", 64.0),
    ("boulder", 256.0),
)  # fmt: skip
"""Classes and their lower bounds in mm: Wentworth (1922), A scale of grade and class terms, J. Geology 30,
377-392."""

USCS_SIZES = (
    ("fines", 0.0), ("fine sand", 0.075), ("medium sand", 0.425), ("coarse sand", 2.0),
    ("fine gravel", 4.75), ("coarse gravel", 19.0), ("cobbles", 75.0), ("boulders", 300.0),
)  # fmt: skip
"""Classes and their lower bounds in mm: ASTM D2487-17, with the sieves of ASTM E11."""

ISO_14688 = (
    ("clay", 0.0), ("fine silt", 0.002), ("medium silt", 0.0063), ("coarse silt", 0.02),
    ("fine sand", 0.063), ("medium sand", 0.2), ("coarse sand", 0.63), ("fine gravel", 2.0),
    ("medium gravel", 6.3), ("coarse gravel", 20.0), ("cobble", 63.0), ("boulder", 200.0),
    ("large boulder", 630.0),
)  # fmt: skip
"""Classes and their lower bounds in mm: ISO 14688-1:2017, table 1."""

SCALES = {"wentworth": WENTWORTH, "uscs": USCS_SIZES, "iso14688": ISO_14688}

_BS_812 = (
    # From, to, slot of the thickness gauge, gap of the length gauge (none for the coarsest), in mm.
    (6.3, 10.0, 4.9, 14.7), (10.0, 14.0, 7.2, 21.6), (14.0, 20.0, 10.2, 30.6), (20.0, 28.0, 14.4, 43.2),
    (28.0, 37.5, 19.7, 59.0), (37.5, 50.0, 26.3, 78.7), (50.0, 63.0, 33.9, None),
)  # fmt: skip
_EN_933_3 = (
    # From, to, slot of the bar sieve, in mm.
    (4.0, 5.0, 2.5), (5.0, 6.3, 3.15), (6.3, 8.0, 4.0), (8.0, 10.0, 5.0), (10.0, 12.5, 6.3),
    (12.5, 16.0, 8.0),
    (16.0, 20.0, 10.0), (20.0, 25.0, 12.5), (25.0, 31.5, 16.0), (31.5, 40.0, 20.0), (40.0, 50.0, 25.0),
    (50.0, 63.0, 31.5), (63.0, 80.0, 40.0), (80.0, 100.0, 50.0),
)  # fmt: skip
_EN_933_4_RATIO = 3.0
_EN_933_4_SIZES = (4.0, 63.0)
_D4791_FROM = 4.75
_WELL_GRADED = {"gravel": 4.0, "sand": 6.0}
_MOST_CLEAN, _FEWEST_DIRTY = 5.0, 12.0


@dataclass(frozen=True)
class FormIndex:
    """An index of form that a standard defines.

    Attributes
    ----------
    name : str
        As in tables and commands.
    standard : str
    percent : float
        Of the mass tested; NaN where no body is of a size that the standard tests.
    bodies : int
        Bodies of sizes that it tests.
    mass_share : float
        Their share of the mass of all, 0 to 1.
    sizes : tuple of float
        From and to, in mm, that it tests.
    """

    name: str
    standard: str
    percent: float
    bodies: int
    mass_share: float
    sizes: tuple[float, float]


def class_shares(population: Population, scale: str) -> dict[str, float]:
    """Return the percent of the mass in every class of sizes, fine to coarse.

    Parameters
    ----------
    population : Population
    scale : {'wentworth', 'uscs', 'iso14688'}

    Raises
    ------
    MeasureError
        If the scale is not known, or no body could be measured.
    UnitError
        If the population has no unit.
    """
    if scale not in SCALES:
        raise MeasureError(f"The scale '{scale}' is not known: use one of {', '.join(SCALES)}.")
    sizes, volumes = _axes_in_mm(population)[1], _axes_in_mm(population)[3]
    names, bounds = zip(*SCALES[scale], strict=True)
    # A grain of exactly the bound is retained on that sieve, so that it belongs to the coarser class.
    places = np.searchsorted(np.array(bounds), sizes * (1 + 1e-12), side="right") - 1
    masses = np.bincount(places, weights=volumes, minlength=len(names))
    return {name: float(100.0 * mass / volumes.sum()) for name, mass in zip(names, masses, strict=True)}


def uscs_symbol(population: Population) -> tuple[str, str]:
    """Return the group symbol by ASTM D2487 and what stands behind it, in a sentence.

    Sizes give the symbol of clean sands and gravels (fewer than 5 % fines): SW, SP, GW or GP. With more
    fines, or mostly fines, it depends on their plasticity, which no scan shows: the symbol is then empty.
    """
    shares = class_shares(population, "uscs")
    sand = sum(shares[name] for name in ("fine sand", "medium sand", "coarse sand"))
    gravel = shares["fine gravel"] + shares["coarse gravel"]
    soil = sand + gravel + shares["fines"]  # cobbles and boulders are left out of the classification
    if soil <= 0:
        return "", "All grains are cobbles or boulders, which ASTM D2487 leaves out."
    fines = 100.0 * shares["fines"] / soil
    if fines > 50:
        return "", f"{fines:.0f} % are fines, whose class follows from plasticity: test it in the laboratory."
    if fines >= _MOST_CLEAN:
        kind = "a second symbol" if fines <= _FEWEST_DIRTY else "the symbol"
        return (
            "",
            f"{fines:.1f} % are fines: {kind} follows from their plasticity. Test it in the laboratory.",
        )
    curve = size_distribution(population)
    kind = "gravel" if gravel > sand else "sand"
    limit = _WELL_GRADED[kind]
    is_well = curve.cu >= limit and 1.0 <= curve.cc <= 3.0
    symbol = ("G" if kind == "gravel" else "S") + ("W" if is_well else "P")
    words = f"{'Well' if is_well else 'Poorly'} graded {kind}: C_u = {curve.cu:.2f}, C_c = {curve.cc:.2f}"
    return symbol, f"{words} (well graded from C_u = {limit:g} on with C_c of 1 to 3), {fines:.1f} % fines."


def form_indices(population: Population) -> list[FormIndex]:
    """Return flakiness, elongation and shape indices of the sizes that each standard tests.

    - BS 812-105.1:1989: flaky is what passes the slot of 0.6 times the mean sieve size of its fraction.
    - BS 812-105.2:1990: elongated is what is longer than 1.8 times that mean size.
    - EN 933-3:2012: what passes a bar sieve of half the upper sieve of its fraction.
    - EN 933-4:2008: what is more than three times as long as thick.
    - ASTM D4791-19: flat (b / c), elongated (a / b), and flat and elongated (a / c) above 2, 3 and 5.

    Raises
    ------
    MeasureError
        If no body could be measured.
    UnitError
        If the population has no unit.
    """
    c, b, a, volume = _axes_in_mm(population)
    found = []
    flaky, long_, tested, tested_length = (np.zeros(len(b), dtype=bool) for _ in range(4))
    for low, high, slot, gap in _BS_812:
        among = (b > low) & (b <= high)
        tested |= among
        flaky |= among & (c <= slot)
        if gap is not None:
            tested_length |= among
            long_ |= among & (a > gap)
    found.append(_index("flakiness_bs812", "BS 812-105.1", flaky, tested, volume, (6.3, 63.0)))
    found.append(_index("elongation_bs812", "BS 812-105.2", long_, tested_length, volume, (6.3, 50.0)))
    passing, tested = np.zeros(len(b), dtype=bool), np.zeros(len(b), dtype=bool)
    for low, high, slot in _EN_933_3:
        among = (b > low) & (b <= high)
        tested |= among
        passing |= among & (c <= slot)
    found.append(_index("flakiness_en933_3", "EN 933-3", passing, tested, volume, (4.0, 100.0)))
    among = (b > _EN_933_4_SIZES[0]) & (b <= _EN_933_4_SIZES[1])
    found.append(_index("shape_en933_4", "EN 933-4", a > _EN_933_4_RATIO * c, among, volume, _EN_933_4_SIZES))
    among = b > _D4791_FROM
    for ratio in (2, 3, 5):
        kinds = {"flat": b > ratio * c, "elongated": a > ratio * b, "flat_and_elongated": a > ratio * c}
        for kind, chosen in kinds.items():
            found.append(
                _index(f"{kind}_{ratio}_d4791", f"ASTM D4791, {ratio}:1", chosen, among, volume,
                       (_D4791_FROM, float("inf")))
            )  # fmt: skip
    return found


def _index(
    name: str,
    standard: str,
    chosen: Bool[np.ndarray, " bodies"],
    tested: Bool[np.ndarray, " bodies"],
    volume: Float[np.ndarray, " bodies"],
    sizes: tuple[float, float],
) -> FormIndex:
    mass = float(volume[tested].sum())
    percent = 100.0 * float(volume[chosen & tested].sum()) / mass if mass > 0 else float("nan")
    return FormIndex(name, standard, percent, int(tested.sum()), mass / float(volume.sum()), sizes)


def _axes_in_mm(population: Population) -> tuple[Float[np.ndarray, " bodies"], ...]:
    """Return c, b, a in mm and the volume of each body that has them."""
    if population.unit == UNITLESS:
        raise UnitError(
            "Classes of sizes are in mm, but these bodies have no unit: measure them with a unit."
        )
    columns = [population.column(name) for name in ("shortest", "intermediate", "longest", "volume")]
    defined = np.isfinite(np.stack(columns)).all(axis=0)
    if not defined.any():
        raise MeasureError(
            f"No body of population '{population.name}' could be measured, so it has no classes."
        )
    scale = conversion_factor(population.unit, "mm")
    return (*(scale * column[defined] for column in columns[:3]), columns[3][defined])
