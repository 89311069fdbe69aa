"""The example deck of a LIGGGHTS export: pour some of each template into a box and let them settle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.settling import GRAVITY, POISSON, SettlingBox, settling_box
from mbstudio.core.units import METRES_PER_UNIT


def template_command(
    body: DemBody, spheres_file: str, nspheres: int, number: int, ntry: int, scale: float = 1.0
) -> str:
    """Return the ``fix particletemplate/multisphere`` command of one body: SI units, principal axes.

    Parameters
    ----------
    body : DemBody
    spheres_file : str
    nspheres : int
        Lines of that file.
    number : int
        Of the template, from 1.
    ntry : int
        Monte Carlo points.
    scale : float
        Size over the body's: mass goes by its third power, inertia by its fifth.
    """
    mass = body.mass.mass * scale**3
    metres = METRES_PER_UNIT[body.mass.unit]
    ixx, iyy, izz = (f"{moment:.9e}" for moment in body.mass.principal * metres**2 * scale**5)
    return (
        f"# {body.name}: mass in kg, inertia tensor in kg m2 as Ixx Ixy Ixz Iyy Iyz Izz\n"
        f"fix template{number} all particletemplate/multisphere {prime_above(15485863 + 1000 * number)} &\n"
        f"    atom_type 1 density constant {body.mass.density:.9g} &\n"
        f"    nspheres {nspheres} ntry {ntry} spheres file {spheres_file} scale {metres * scale:.9g} &\n"
        f"    mass {mass:.9e} inertia_tensor {ixx} 0 0 {iyy} 0 {izz} use_volume type {number}\n"
    )


def prime_above(number: int) -> int:
    """Return the smallest prime above a number: LIGGGHTS wants prime seeds."""
    candidate = number + 1 + number % 2
    while any(candidate % divisor == 0 for divisor in range(3, int(candidate**0.5) + 1, 2)):
        candidate += 2
    return candidate


DECK_NAME = "in.settle"


def settling_deck(
    bodies: Sequence[DemBody], clumps: Sequence[Clump], templates: Sequence[str], poured: int
) -> str:
    """Return a deck in SI units that runs as it is, from within its folder.

    The box is a few grain diameters wide and high enough for all particles to be inserted at once
    without touching. Young's modulus is the lowest that LIGGGHTS takes or such that an impact
    overlaps little, which keeps the time step long; the step is 15 % of Rayleigh's for the
    smallest sphere.
    """
    box = settling_box(bodies, clumps, poured)
    title = f"{box.particles} particles of {len(bodies)} kinds settle in a box"
    head, steps = opening(box, bodies[0].mass.density, title, DECK_NAME)
    include = "\n".join(f"include {name}" for name in templates)
    shares = " ".join(f"template{number} {1 / len(bodies):.9g}" for number in range(1, len(bodies) + 1))
    return f"""{head}
{include}
fix kinds all particledistribution/discrete/numberbased 32452843 {len(bodies)} {shares}
fix pour all insert/pack seed 49979687 distributiontemplate kinds maxattempt 1000 insert_every once &
    overlapcheck yes orientation random all_in yes vel constant 0. 0. 0. region above &
    particles_in_region {box.particles}
{closing(steps)}"""


def opening(box: SettlingBox, density: float, title: str, name: str) -> tuple[str, int]:
    """Return the part of a deck that makes box, walls, contact law, gravity and the region of insertion.

    Parameters
    ----------
    box : SettlingBox
    density : float
        In kg/m**3.
    title, name : str
        What the deck does, and its file.

    Returns
    -------
    text : str
    steps : int
        Time steps until the particles have come to rest.
    """
    young = max(5e6, 2000.0 * density * GRAVITY * box.top)
    shear = young / (2 * (1 + POISSON))
    rayleigh = np.pi * box.smallest * np.sqrt(density / shear) / (0.1631 * POISSON + 0.8766)
    step = float(f"{0.15 * rayleigh:.3g}")
    steps = int(np.ceil(box.seconds / step / 1000) * 1000)
    half, low, top = box.half, box.low, box.top
    sides = f"{-half:.6e} {half:.6e} {-half:.6e} {half:.6e}"
    text = f"""# {title}: liggghts -in {name}
units si
atom_style granular
atom_modify map array
boundary f f f
newton off
communicate single vel yes

region domain block {sides} {-0.01 * box.reach:.6e} {top:.6e} units box
create_box 1 domain
neighbor {0.3 * box.smallest:.6e} bin
neigh_modify delay 0

fix m1 all property/global youngsModulus peratomtype {young:.6e}
fix m2 all property/global poissonsRatio peratomtype {POISSON}
fix m3 all property/global coefficientRestitution peratomtypepair 1 0.3
fix m4 all property/global coefficientFriction peratomtypepair 1 0.5
pair_style gran model hertz tangential history
pair_coeff * *
timestep {step:.6e}

fix gravity all gravity {GRAVITY} vector 0 0 -1
fix floor all wall/gran model hertz tangential history primitive type 1 zplane 0.0
fix west all wall/gran model hertz tangential history primitive type 1 xplane {-half:.6e}
fix east all wall/gran model hertz tangential history primitive type 1 xplane {half:.6e}
fix south all wall/gran model hertz tangential history primitive type 1 yplane {-half:.6e}
fix north all wall/gran model hertz tangential history primitive type 1 yplane {half:.6e}

region above block {sides} {low:.6e} {top:.6e} units box
"""
    return text, steps


def closing(steps: int) -> str:
    """Return the part of a deck that joins the spheres to bodies, runs, and prints the energy."""
    return f"""fix bodies all multisphere

compute energy all ke/multisphere
compute bodies all multisphere property masstotal
thermo_style custom step atoms c_energy
thermo {max(1, steps // 20)}
thermo_modify lost error
run {steps}
"""
