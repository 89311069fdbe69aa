"""What decks for engines that are not at hand share: places, contact law and step, and their checks.

Every deck states what it stands on as ``NAME = number`` (``DENSITY``, ``GRAVITY``, ``STIFFNESS``, ``STEP``),
so that it can be changed in one place and read back.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.reading_back import require_agreement
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.settling import (
    GRAVITY,
    POISSON,
    SettlingBox,
    SpringContact,
    Stack,
    spring_contact,
    stacked_grains,
)
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError
from mbstudio.core.units import METRES_PER_UNIT

ASSUMED_DENSITY = 2650.0
"""Density of quartz in kg/m3, for decks of files that state no mass where the export has no density."""
NOT_RUN = "Written from the engine's manual or source; mbstudio has not been able to run it in that engine."
_LARGEST_SHARE = 20


@dataclass(frozen=True, eq=False)
class Pouring:
    """Grains above each other in a box, and the numbers that a deck needs to let them fall.

    Lengths are in the unit of the files, masses in kg, times in s: a stiffness is in N/m in any of them.

    Attributes
    ----------
    stack : Stack
        Places and orientations; particle i is of kind ``i % kinds``.
    density : float
        In kg/unit**3.
    gravity : float
        In unit/s**2.
    contact : SpringContact
    dissipation : float
        Of the dashpot between two of the lightest grains, in kg/s.
    speed : float
        Of the longest fall, in unit/s.
    seconds : float
        Time for the grains to fall and come to rest.
    """

    stack: Stack
    density: float
    gravity: float
    contact: SpringContact
    dissipation: float
    speed: float
    seconds: float


def plan_pouring(job: Job, reach: float, smallest: float) -> Pouring:
    """Return places and numbers for the ``poured`` particles of an export, at least one of each body.

    Parameters
    ----------
    job : Job
    reach : float
        Radius of the largest bounding sphere about a centre of mass, in the unit of the files.
    smallest : float
        Smallest radius that touches, in that unit.
    """
    metres = METRES_PER_UNIT[job.unit]
    stack = stacked_grains(int(job.options["poured"]), len(job.bodies), reach)
    density = ASSUMED_DENSITY if job.density is None else job.density
    masses = [density * body.mass.volume * metres**3 for body in job.bodies]
    top = stack.top * metres
    box = SettlingBox(
        len(stack.places),
        reach * metres,
        smallest * metres,
        max(masses),
        float(np.mean(masses)),
        min(masses),
        smallest / reach,
        stack.half * metres,
        0.0,
        top,
    )
    contact = spring_contact(box)
    # The damping ratio is that of spring_contact; here of a dashpot in kg/s, between two light grains.
    dissipation = 2 * 0.358 * float(np.sqrt(contact.stiffness * min(masses) / 2))
    return Pouring(
        stack,
        density * metres**3,
        GRAVITY / metres,
        contact,
        dissipation,
        float(np.sqrt(2 * GRAVITY * top)) / metres,
        4.0 * float(np.sqrt(2 * top / GRAVITY)),
    )


def hertz_young(stiffness: float, radius: float) -> float:
    """Return Young's modulus of two spheres as stiff as a spring at an overlap of a tenth of the radius.

    Parameters
    ----------
    stiffness : float
        In N/m.
    radius : float
        Of both, in m.

    Returns
    -------
    float
        In Pa: ``k = 2 E* sqrt(R d)`` with ``E* = E / (2 (1 - nu**2))`` and R half the radius.
    """
    effective = stiffness / (2.0 * np.sqrt(radius / 2 * radius / 10))
    return float(2.0 * (1.0 - POISSON**2) * effective)


def extent_of(clumps: Sequence[Clump]) -> tuple[float, float]:
    """Return the radius of the largest bounding sphere about a centre of mass, and the smallest radius."""
    reach = max(float((np.linalg.norm(clump.centers, axis=1) + clump.radii).max()) for clump in clumps)
    return reach, min(float(clump.radii.min()) for clump in clumps)


def stated_number(path: Path, text: str, name: str) -> float:
    """Return the number that a deck states as ``NAME = number``, once; ExportError otherwise."""
    found = re.findall(rf"(?<![\w.])(?i:{name}) *= *([-+.\w]+)", text)
    try:
        (number,) = (float(word) for word in found)
    except ValueError as error:
        raise ExportError(f"{path} does not state '{name} = number' once.") from error
    return number


def check_pouring(path: Path, text: str, manifest: Mapping[str, Any], *, has_step: bool = True) -> None:
    """Raise ExportError unless density, gravity and step of a deck suit the manifest.

    Raises
    ------
    ExportError
        If the density or gravity are those of other units or grains, a number is not positive, or the step is
        longer than a 20th of the contact that the stiffness means for the lightest grain.
    """
    metres = METRES_PER_UNIT[manifest["unit"]]
    density = manifest["density"] or ASSUMED_DENSITY
    wanted = {"DENSITY": density * metres**3, "GRAVITY": GRAVITY / metres}
    for name, value in wanted.items():
        require_agreement(path, name, [f"{stated_number(path, text, name):.12g}"], [value], 1e-6)
    stiffness = stated_number(path, text, "STIFFNESS")
    if not (np.isfinite(stiffness) and stiffness > 0):
        raise ExportError(f"{path} has a stiffness of {stiffness:g}, which is not positive.")
    if not has_step:
        return
    step = stated_number(path, text, "STEP")
    lightest = min(item["volume"] for item in manifest["items"]) * density * metres**3
    longest = np.pi / np.sqrt(2 * stiffness / lightest) / _LARGEST_SHARE
    if not 0 < step <= longest:
        raise ExportError(
            f"{path} has a time step of {step:g} s; the stiffness of the contacts allows {longest:.3g} s."
        )


def check_names(path: Path, found: list[str], wanted: list[str]) -> None:
    """Raise ExportError unless a deck names what lies beside it, each once and in order."""
    if found != wanted:
        raise ExportError(f"{path} does not load {', '.join(wanted)}, each once and in order.")


def check_count(path: Path, found: int, manifest: Mapping[str, Any]) -> None:
    """Raise ExportError unless a deck has as many particles as the manifest says, at least one of each."""
    wanted = max(int(manifest["options"]["poured"]), len(manifest["items"]))
    if found != wanted:
        raise ExportError(f"{path} has {found} particles; the manifest says {wanted}.")
