"""The example deck of a LIGGGHTS export: pour some of each template into a box and let them settle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.clump import Clump
from mbstudio.core.units import METRES_PER_UNIT

DECK_NAME = "in.settle"

_POISSON = 0.3
_GRAVITY = 9.81


def settling_deck(
    bodies: Sequence[DemBody], clumps: Sequence[Clump], templates: Sequence[str], poured: int
) -> str:
    """Return a deck in SI units that runs as it is, from within its folder.

    The box is a few grain diameters wide and high enough for all particles to be inserted at once
    without touching. Young's modulus is the lowest that LIGGGHTS takes or such that an impact
    overlaps little, which keeps the time step long; the step is 15 % of Rayleigh's for the
    smallest sphere.
    """
    metres = METRES_PER_UNIT[bodies[0].mass.unit]
    density = bodies[0].mass.density
    reach = max(float((np.linalg.norm(c.centers, axis=1) + c.radii).max()) for c in clumps) * metres
    smallest = min(float(c.radii.min()) for c in clumps) * metres
    particles = max(poured, len(bodies))
    # Random insertion fills boxes of one bounding sphere each to about a fifth.
    width = 8.0 * reach * max(1.0, particles / 10) ** (1 / 3)
    layer = max(4.0 * reach, particles * (2.2 * reach) ** 3 / (0.2 * (width - 2 * reach) ** 2))
    low = 1.5 * reach
    top = low + layer + 2 * reach
    young = max(5e6, 2000.0 * density * _GRAVITY * top)
    shear = young / (2 * (1 + _POISSON))
    rayleigh = np.pi * smallest * np.sqrt(density / shear) / (0.1631 * _POISSON + 0.8766)
    step = float(f"{0.15 * rayleigh:.3g}")
    seconds = 3.0 * np.sqrt(2 * top / _GRAVITY)
    steps = int(np.ceil(seconds / step / 1000) * 1000)
    half = width / 2
    box = f"{-half:.6e} {half:.6e} {-half:.6e} {half:.6e}"
    include = "\n".join(f"include {name}" for name in templates)
    shares = " ".join(f"template{number} {1 / len(bodies):.9g}" for number in range(1, len(bodies) + 1))
    return f"""# {particles} particles of {len(bodies)} kinds settle in a box. Run: liggghts -in {DECK_NAME}
units si
atom_style granular
atom_modify map array
boundary f f f
newton off
communicate single vel yes

region domain block {box} {-0.01 * reach:.6e} {top:.6e} units box
create_box 1 domain
neighbor {0.3 * smallest:.6e} bin
neigh_modify delay 0

fix m1 all property/global youngsModulus peratomtype {young:.6e}
fix m2 all property/global poissonsRatio peratomtype {_POISSON}
fix m3 all property/global coefficientRestitution peratomtypepair 1 0.3
fix m4 all property/global coefficientFriction peratomtypepair 1 0.5
pair_style gran model hertz tangential history
pair_coeff * *
timestep {step:.6e}

fix gravity all gravity {_GRAVITY} vector 0 0 -1
fix floor all wall/gran model hertz tangential history primitive type 1 zplane 0.0
fix west all wall/gran model hertz tangential history primitive type 1 xplane {-half:.6e}
fix east all wall/gran model hertz tangential history primitive type 1 xplane {half:.6e}
fix south all wall/gran model hertz tangential history primitive type 1 yplane {-half:.6e}
fix north all wall/gran model hertz tangential history primitive type 1 yplane {half:.6e}

{include}
fix kinds all particledistribution/discrete/numberbased 32452843 {len(bodies)} {shares}
region above block {box} {low:.6e} {top:.6e} units box
fix pour all insert/pack seed 49979687 distributiontemplate kinds maxattempt 1000 insert_every once &
    overlapcheck yes orientation random all_in yes vel constant 0. 0. 0. region above &
    particles_in_region {particles}
fix bodies all multisphere

compute energy all ke/multisphere
compute bodies all multisphere property masstotal
thermo_style custom step atoms c_energy
thermo {max(1, steps // 20)}
thermo_modify lost error
run {steps}
"""
