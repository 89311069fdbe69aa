"""What the example decks share: a box for the particles to fall into, and a contact law to suit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.clump import Clump
from mbstudio.core.units import METRES_PER_UNIT

GRAVITY = 9.81
POISSON = 0.3


@dataclass(frozen=True)
class SettlingBox:
    """A box a few grain diameters wide and high enough to insert all particles without touching, in SI units.

    Attributes
    ----------
    particles : int
        At least one of each body.
    reach : float
        Radius of the largest bounding sphere about a centre of mass, in m.
    smallest : float
        Smallest sphere radius, in m.
    heaviest, lightest : float
        Masses in kg.
    half : float
        Half the width of the box, in m.
    low, top : float
        Where particles are inserted, in m above the floor.
    """

    particles: int
    reach: float
    smallest: float
    heaviest: float
    lightest: float
    half: float
    low: float
    top: float

    @property
    def seconds(self) -> float:
        """Time for the last particle to fall and come to rest, in s."""
        return 3.0 * float(np.sqrt(2 * self.top / GRAVITY))


def settling_box(bodies: Sequence[DemBody], clumps: Sequence[Clump], poured: int) -> SettlingBox:
    """Return the box for some particles of each body, whichever is more: `poured`, or one of each."""
    metres = METRES_PER_UNIT[bodies[0].mass.unit]
    reach = max(float((np.linalg.norm(c.centers, axis=1) + c.radii).max()) for c in clumps) * metres
    particles = max(poured, len(bodies))
    # Random insertion fills boxes of one bounding sphere each to about a fifth.
    width = 8.0 * reach * max(1.0, particles / 10) ** (1 / 3)
    layer = max(4.0 * reach, particles * (2.2 * reach) ** 3 / (0.2 * (width - 2 * reach) ** 2))
    low = 1.5 * reach
    return SettlingBox(
        particles,
        reach,
        min(float(c.radii.min()) for c in clumps) * metres,
        max(body.mass.mass for body in bodies),
        min(body.mass.mass for body in bodies),
        width / 2,
        low,
        low + layer + 2 * reach,
    )


@dataclass(frozen=True)
class SpringContact:
    """A linear spring and dashpot for the normal direction, in SI units.

    Attributes
    ----------
    stiffness : float
        N/m, such that the fall from the top of the box overlaps by a tenth of the smallest sphere.
    damping : float
        1/s, times the effective mass.
    step : float
        Time step in s: a 60th of the shortest contact.
    """

    stiffness: float
    damping: float
    step: float


def spring_contact(box: SettlingBox) -> SpringContact:
    """Return a contact law for particles that fall from the top of a box, restitution about 0.3."""
    stiffness = box.heaviest * 2 * GRAVITY * box.top / (0.1 * box.smallest) ** 2
    frequency = np.sqrt(stiffness / (box.lightest / 2))
    # e = exp(-pi z / sqrt(1 - z**2)) is 0.3 at z = 0.358; the damping is 2 z times the slowest frequency.
    damping = 2 * 0.358 * np.sqrt(stiffness / box.heaviest)
    return SpringContact(float(stiffness), float(damping), float(f"{np.pi / frequency / 60:.3g}"))
