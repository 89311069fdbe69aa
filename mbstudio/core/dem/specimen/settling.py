"""What the example decks share: a box for the particles to fall into, and a contact law to suit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.particles import Specimen
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.placing import lattice, random_quaternions
from mbstudio.core.units import METRES_PER_UNIT

GRAVITY = 9.81
POISSON = 0.3
_OVERLAP, _HEAVIEST = 0.1, 1.5
STEPS_A_CONTACT = 30


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
    heaviest, mean, lightest : float
        Masses in kg.
    finest : float
        Least share of a particle's reach that a sphere of it has for its radius.
    half : float
        Half the width of the box, in m.
    low, top : float
        Where particles are inserted, in m above the floor.
    periodic : bool
        Whether the sides are periodic and not walls.
    """

    particles: int
    reach: float
    smallest: float
    heaviest: float
    mean: float
    lightest: float
    finest: float
    half: float
    low: float
    top: float
    periodic: bool = False

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
        float(np.mean([body.mass.mass for body in bodies])),
        min(body.mass.mass for body in bodies),
        finest_sphere(clumps),
        width / 2,
        low,
        low + layer + 2 * reach,
    )


def specimen_box(specimen: Specimen, bodies: Sequence[DemBody], clumps: Sequence[Clump]) -> SettlingBox:
    """Return the box of a specimen, which it is placed in from the floor up."""
    metres = METRES_PER_UNIT[specimen.unit]
    masses = np.array([body.mass.mass for body in bodies])[specimen.kinds] * specimen.scales**3
    radii = np.array([clump.radii.min() for clump in clumps])[specimen.kinds] * specimen.scales
    reach = float((specimen.reaches[specimen.kinds] * specimen.scales).max()) * metres
    return SettlingBox(
        len(specimen.kinds),
        reach,
        float(radii.min()) * metres,
        float(masses.max()),
        float(masses.mean()),
        float(masses.min()),
        finest_sphere(clumps),
        specimen.half * metres,
        0.0,
        specimen.top * metres + reach,
        specimen.periodic,
    )


def finest_sphere(clumps: Sequence[Clump]) -> float:
    """Return the least radius of a sphere over the reach of its own clump."""
    return min(
        float(clump.radii.min() / (np.linalg.norm(clump.centers, axis=1) + clump.radii).max())
        for clump in clumps
    )


@dataclass(frozen=True, eq=False)
class Stack:
    """Grains above each other in a narrow box, for engines that are told every place.

    Attributes
    ----------
    places : float array, shape (particles, 3)
        Centres of mass, in the unit of the reach.
    quaternions : float array, shape (particles, 4)
        Orientations (w, x, y, z).
    half : float
        Half the width of the box, around the z axis.
    top : float
        Height that the grains reach.
    """

    places: Float[np.ndarray, "particles 3"]
    quaternions: Float[np.ndarray, "particles 4"]
    half: float
    top: float


def stacked_grains(poured: int, kinds: int, reach: float) -> Stack:
    """Return places and random orientations for some grains, at least one of each kind.

    Parameters
    ----------
    poured, kinds : int
    reach : float
        Radius of the largest bounding sphere.
    """
    particles = max(poured, kinds)
    half = 2.4 * reach * max(1.0, particles / 10) ** (1 / 3)
    places = lattice(particles, half, 1.1 * reach, reach)
    turns = random_quaternions(particles, np.random.default_rng(0))
    return Stack(places, turns, half, float(places[:, 2].max()) + reach)


@dataclass(frozen=True)
class SpringContact:
    """A linear spring and dashpot for the normal direction, in SI units.

    Attributes
    ----------
    stiffness : float
        N/m, such that a particle of mean mass that falls from the top of the box overlaps by a tenth of its
        reach, or by its smallest sphere; the heaviest one by at most one and a half times that share of its
        own.
    damping : float
        1/s, times the effective mass.
    step : float
        Time step in s: a 30th of the shortest contact, of two particles of least mass.
    impact : float
        Overlap of the heaviest particle that falls from the top onto a wall, in m, without damping.
    """

    stiffness: float
    damping: float
    step: float
    impact: float


def spring_contact(box: SettlingBox) -> SpringContact:
    """Return a contact law for particles that fall from the top of a box, restitution about 0.3.

    At rest overlaps are far smaller than in the fall, which lasts a moment: with a tenth of the reach in the
    fall, below a layer that is a third of the box high they are about a thousandth of it. A contact as stiff
    as the heaviest particle would need at a fraction of the smallest sphere takes ten times the steps for the
    same packing.
    """
    share = min(_OVERLAP, box.finest)
    mean_reach = box.reach * np.cbrt(box.mean / box.heaviest)
    hardest = max(box.mean / mean_reach**2, box.heaviest / (_HEAVIEST * box.reach) ** 2)
    stiffness = 2 * GRAVITY * box.top * hardest / share**2
    frequency = np.sqrt(stiffness / (box.lightest / 2))
    # e = exp(-pi z / sqrt(1 - z**2)) is 0.3 at z = 0.358, here for two particles of mean mass.
    damping = 2 * 0.358 * np.sqrt(stiffness / (box.mean / 2))
    step = float(f"{np.pi / frequency / STEPS_A_CONTACT:.3g}")
    impact = float(np.sqrt(2 * GRAVITY * box.top * box.heaviest / stiffness))
    return SpringContact(float(stiffness), float(damping), step, impact)
