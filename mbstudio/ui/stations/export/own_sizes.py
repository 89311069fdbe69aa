"""The sizes of avatars that were measured before: of all of them, not of some."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from mbstudio.core.batch.processes import usable_cores
from mbstudio.core.dem.specimen.specimen import SpecimenKinds
from mbstudio.core.metaball import Avatar
from mbstudio.core.populations import Population
from mbstudio.core.populations.measuring import (
    FEWEST_FOR_PROCESSES,
    Bodies,
    Conventions,
    Known,
    Progress,
    given_body,
    measure_together,
)
from mbstudio.core.units import conversion_factor
from mbstudio.ui.stations.export.work import ChosenAvatars

EACH, STARTING = 0.45, 1.5
"""Seconds of one core for an avatar, and until processes work."""
_FACTORS = ("longest", "intermediate", "shortest", "volume")


def known_sizes(chosen: ChosenAvatars, known: Known) -> Float[np.ndarray, "avatars 4"]:
    """Return axes and volume of each avatar in its unit; NaN where it was not measured or could not be.

    Parameters
    ----------
    chosen : ChosenAvatars
    known : mapping
        Measurements so far.
    """
    found = np.full((len(chosen), 4), np.nan)
    if not len(chosen):
        return found
    unit = chosen.named[0][1].unit
    if chosen.factors is not None and chosen.factors.axes == "obb":
        found = _of_population(chosen.factors, unit)
    for place in np.flatnonzero(np.isnan(found).any(1)).tolist():
        for detail in (False, True):
            measured = known.get((chosen.named[place][1], Conventions(unit, "obb", None, detail)))
            if measured is not None and measured.factors:
                found[place] = [measured.factors[name] for name in _FACTORS]
    return found


def _of_population(factors: Population, unit: str) -> Float[np.ndarray, "avatars 4"]:
    f = conversion_factor(factors.unit, unit)
    columns = [factors.column(name) for name in _FACTORS]
    return np.column_stack(columns) * np.array([f, f, f, f**3])


def unmeasured(chosen: ChosenAvatars, known: Known) -> list[Avatar]:
    """Return the avatars that nobody has tried to measure yet."""
    sizes = known_sizes(chosen, known)
    missing = [chosen.named[place][1] for place in np.flatnonzero(np.isnan(sizes).any(1)).tolist()]
    return [one for one in missing if (one, Conventions(one.unit, "obb", None, False)) not in known]


def kinds_of(chosen: ChosenAvatars, known: Known) -> SpecimenKinds | None:
    """Return what a specimen needs to know of all avatars that could be measured; None if there are none."""
    sizes = known_sizes(chosen, known)
    there = np.isfinite(sizes).all(1)
    if not there.any():
        return None
    names = [name for (name, _), one in zip(chosen.named, there, strict=True) if one]
    return SpecimenKinds.from_factors(names, sizes[there, :3], sizes[there, 3], chosen.named[0][1].unit)


def seconds_for(count: int) -> float:
    """Return about how long measuring so many avatars takes."""
    cores = usable_cores() if count >= FEWEST_FOR_PROCESSES else 1
    return EACH * count / cores + (STARTING if cores > 1 else 0.0)


def measure_sizes(avatars: Sequence[Avatar], known: Known, progress: Progress) -> None:
    """Measure avatars; each comes into `known` as soon as it is done."""
    group = Bodies(
        "avatars", "avatars", range(len(avatars)), [given_body(one) for one in avatars], list(avatars)
    )
    measure_together([group], unit=avatars[0].unit, progress=progress, known=known)
