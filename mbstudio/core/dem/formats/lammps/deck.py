"""The example deck of a LAMMPS export: pour some of each molecule into a box and let them settle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.settling import (
    GRAVITY,
    SettlingBox,
    SpringContact,
    settling_box,
    spring_contact,
)

DECK_NAME = "in.settle"


def pouring_deck(
    bodies: Sequence[DemBody], clumps: Sequence[Clump], molecules: Sequence[str], poured: int
) -> str:
    """Return a deck in SI units that runs as it is, from within its folder (LAMMPS 29Sep2021 and later)."""
    box = settling_box(bodies, clumps, poured)
    contact = spring_contact(box)
    # Molecules are inserted where earlier ones have fallen out: the time for all of them is not known
    # beforehand, but the region holds them all.
    steps = int(np.ceil(box.seconds / contact.step / 1000) * 1000)
    share = 1.0 / len(bodies)
    shares = [f"{share:.9g}"] * (len(bodies) - 1)
    shares.append(f"{1.0 - sum(float(word) for word in shares):.9g}")
    half = box.half - 1.01 * box.reach
    return f"""{opening(box, contact, f"{box.particles} particles of {len(bodies)} kinds settle in a box")}
molecule grains {" ".join(molecules)}
# A second run would weigh the spheres anew and forget the inertia of the files but for 'reinit no'.
fix bodies all rigid/small molecule mol grains gravity gravity reinit no
region above block {-half:.6e} {half:.6e} {-half:.6e} {half:.6e} {box.low:.6e} {box.top:.6e} units box
fix pour all pour {box.particles} 0 49979687 region above mol grains molfrac {" ".join(shares)} &
    rigid bodies vol 0.15 200

{closing(steps)}"""


def opening(box: SettlingBox, contact: SpringContact, title: str, name: str = DECK_NAME) -> str:
    """Return the part of a deck that makes the box, its walls, the contact law and gravity."""
    law = (
        f"{contact.stiffness:.6e} {contact.stiffness * 2 / 7:.6e} "
        f"{contact.damping:.6e} {contact.damping / 2:.6e} 0.5 1"
    )
    half, high = box.half, box.top + 2 * box.reach
    return f"""# {title}. Run: lmp -in {name}
units si
atom_style sphere
atom_modify map array
boundary f f f
newton off
comm_modify vel yes cutoff {4.2 * box.reach:.6e}

region domain block {-half:.6e} {half:.6e} {-half:.6e} {half:.6e} {-0.1 * box.reach:.6e} {high:.6e} units box
create_box 1 domain
neighbor {0.3 * box.smallest:.6e} bin
fix mol all property/atom mol ghost yes
neigh_modify delay 0 every 1 check yes exclude molecule/intra all one 10000 page 100000

pair_style gran/hooke/history {law}
pair_coeff * *
timestep {contact.step:.6e}
fix floor all wall/gran hooke/history {law} zplane 0.0 NULL
fix sides_x all wall/gran hooke/history {law} xplane {-half:.6e} {half:.6e}
fix sides_y all wall/gran hooke/history {law} yplane {-half:.6e} {half:.6e}

# Gravity acts on whole bodies, not on the spheres.
fix gravity all gravity {GRAVITY} vector 0 0 -1 disable
"""


def closing(steps: int) -> str:
    """Return the part of a deck that runs it and prints the energy."""
    return f"""compute translation all ke/rigid bodies
compute rotation all erotate/rigid bodies
compute highest all reduce max z
thermo_style custom step atoms c_translation c_rotation c_highest
thermo {max(1, steps // 40)}
thermo_modify lost error
run {steps}
"""
