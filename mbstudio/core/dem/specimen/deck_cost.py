"""What a deck costs and how far it may go: time steps and hours, and the bounds at which it must fail."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from mbstudio.core.dem.specimen.settling import GRAVITY, SettlingBox
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError
from mbstudio.core.options import Option

HOURS = Option(24.0, "most hours that an example deck may take: a longer one is refused", 1e-4, 1e6)
ENERGY_MARGIN = 1.05
_IMPACT_MARGIN = 2.0
"""Grains that are hit from two sides, or several that land on one, go deeper than one on a floor."""
_REST = 0.01
MICROSECONDS: Mapping[str, float] = MappingProxyType(
    {"LAMMPS": 0.15, "LIGGGHTS": 0.08, "Kratos": 1.4, "Yade": 5.0}
)
"""Processor time of a time step for each sphere, measured on one core of a server (Yade: estimated)."""


@dataclass(frozen=True)
class DeckCost:
    """The time steps of a deck, and about how long an engine takes for them on one core.

    Attributes
    ----------
    engine : str
    steps : int
    step : float
        In s.
    spheres : int
        In all grains.
    """

    engine: str
    steps: int
    step: float
    spheres: int

    @property
    def seconds(self) -> float:
        """Processor time, to a factor of about two."""
        return self.steps * self.spheres * MICROSECONDS[self.engine] * 1e-6

    @property
    def told(self) -> str:
        """Steps and time in words."""
        return f"{self.steps:,} steps of {self.step:.3g} s, about {_in_words(self.seconds)} on one core"

    def record(self) -> dict[str, Any]:
        """Return what the manifest says."""
        return {"steps": self.steps, "step": self.step, "hours": self.seconds / 3600}


def _in_words(seconds: float) -> str:
    for unit, length in (("years", 3.156e7), ("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:,.0f} {unit}"
    return f"{max(seconds, 1.0):.0f} s"


def require_affordable(job: Job, name: str, cost: DeckCost, box: SettlingBox) -> None:
    """Tell what a deck costs before it is written.

    Parameters
    ----------
    job : Job
        With the option ``hours``.
    name : str
        Of the deck.
    cost : DeckCost
    box : SettlingBox
        What makes it long: the lightest grain sets the step, the heaviest the stiffness.

    Raises
    ------
    ExportError
        If it takes longer than the option allows.
    """
    job.progress(0.97, f"{name} takes {cost.told}")
    limit = float(job.options["hours"])
    if cost.seconds > 3600 * limit:
        spread = float(np.cbrt(box.heaviest / box.lightest))
        raise ExportError(
            f"{name} would take {cost.told}; at most {limit:g} hours are allowed. The largest grain is "
            f"{spread:.3g} times as large as the smallest, which sets the time step: leave out the smallest "
            "grains, pour fewer, or allow more with the option hours."
        )


@dataclass(frozen=True)
class Bounds:
    """At what a run is wrong and must end with an error; SI units.

    Attributes
    ----------
    grains : int
    energy : float
        Kinetic energy, in J: all that there is to fall, and a margin.
    impact : float
        Overlap while the grains fall, in m: twice that of the hardest fall by design.
    rest : float
        Overlap at rest, in m: a hundredth of the mean nominal diameter.
    """

    grains: int
    energy: float
    impact: float
    rest: float


def bounds_of(box: SettlingBox, impact: float, density: float) -> Bounds:
    """Return the bounds of a deck.

    Parameters
    ----------
    box : SettlingBox
    impact : float
        The overlap that the heaviest grain makes by design when it falls from the top, in m.
    density : float
        In kg/m**3.
    """
    # Engines that draw kinds at random may draw heavier ones: three standard errors.
    drawn = box.mean + min(1.0, 3.0 / np.sqrt(box.particles)) * (box.heaviest - box.lightest)
    energy = ENERGY_MARGIN * box.particles * min(drawn, box.heaviest) * GRAVITY * box.top
    diameter = float(np.cbrt(6 * box.mean / (np.pi * density)))
    return Bounds(box.particles, float(energy), _IMPACT_MARGIN * impact, _REST * diameter)
