"""The example deck of a LAMMPS export: pour some of each molecule into a box and let them settle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.reading_back import read_text
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.deck_cost import DeckCost, bounds_of, require_affordable
from mbstudio.core.dem.specimen.settling import (
    GRAVITY,
    SettlingBox,
    SpringContact,
    settling_box,
    spring_contact,
)
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError

DECK_NAME = "in.settle"


def write_pouring_deck(
    job: Job, clumps: Sequence[Clump], molecules: Sequence[str], poured: int
) -> Mapping[str, Any]:
    """Write a deck in SI units that runs as it is, from within its folder (LAMMPS 29Sep2021 and later).

    Returns what the manifest says of its cost; ExportError if it is too long.
    """
    bodies = job.bodies
    box = settling_box(bodies, clumps, poured)
    contact = spring_contact(box)
    # Molecules are inserted where earlier ones have fallen out: the time for all of them is not known
    # beforehand, but the region holds them all.
    spheres = round(box.particles * float(np.mean([len(clump.radii) for clump in clumps])))
    cost = cost_of(box, contact, spheres)
    require_affordable(job, DECK_NAME, cost, box)
    share = 1.0 / len(bodies)
    shares = [f"{share:.9g}"] * (len(bodies) - 1)
    shares.append(f"{1.0 - sum(float(word) for word in shares):.9g}")
    half = box.half - 1.01 * box.reach
    title = f"{box.particles} particles of {len(bodies)} kinds settle in a box"
    density = bodies[0].mass.density
    text = f"""{opening(box, contact, title, cost)}
molecule grains {" ".join(molecules)}
# A second run would weigh the spheres anew and forget the inertia of the files but for 'reinit no'.
fix bodies all rigid/small molecule mol grains gravity gravity reinit no
region above block {-half:.6e} {half:.6e} {-half:.6e} {half:.6e} {box.low:.6e} {box.top:.6e} units box
fix pour all pour {box.particles} 0 49979687 region above mol grains molfrac {" ".join(shares)} &
    rigid bodies vol 0.15 200

{closing(box, contact, cost, density, DECK_NAME)}"""
    (job.folder / DECK_NAME).write_text(text, encoding="ascii")
    return cost.record()


def cost_of(box: SettlingBox, contact: SpringContact, spheres: int) -> DeckCost:
    """Return steps and time of a deck."""
    steps = int(np.ceil(box.seconds / contact.step / 1000) * 1000)
    return DeckCost("LAMMPS", steps, contact.step, spheres)


def opening(
    box: SettlingBox, contact: SpringContact, title: str, cost: DeckCost, name: str = DECK_NAME
) -> str:
    """Return the part of a deck that makes the box, its walls, the contact law and gravity."""
    law = (
        f"{contact.stiffness:.6e} {contact.stiffness * 2 / 7:.6e} "
        f"{contact.damping:.6e} {contact.damping / 2:.6e} 0.5 1"
    )
    half, high = box.half, box.top + 2 * box.reach
    return f"""# {title}. Run: lmp -in {name}
# It takes {cost.told}.
# It writes {stem(name)}.lammpstrj (the spheres at rest, for 'mbstudio packing read'),
# {stem(name)}.moving.lammpstrj, {stem(name)}.data and {stem(name)}.restart, and prints a line that
# begins with SETTLED.
units si
atom_style sphere
atom_modify map array
boundary {"p p f" if box.periodic else "f f f"}
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
{"" if box.periodic else _side_walls(law, half)}
# Gravity acts on whole bodies, not on the spheres.
fix gravity all gravity {GRAVITY} vector 0 0 -1 disable
"""


def _side_walls(law: str, half: float) -> str:
    return f"""fix sides_x all wall/gran hooke/history {law} xplane {-half:.6e} {half:.6e}
fix sides_y all wall/gran hooke/history {law} yplane {-half:.6e} {half:.6e}
"""


def stem(name: str) -> str:
    """Return what the files that a deck writes are called: 'settled' for in.settle."""
    return {"in.settle": "settled", "in.specimen": "specimen_settled"}[name]


def check_end(path: Path) -> None:
    """Raise ExportError unless a deck ends by saving what has settled."""
    if not read_text(path).endswith(f"\nwrite_restart {stem(path.name)}.restart\n"):
        raise ExportError(f"{path} is cut off: it does not end by saving what has settled.")


def closing(box: SettlingBox, contact: SpringContact, cost: DeckCost, density: float, name: str) -> str:
    """Return the part of a deck that watches the run, runs it, saves what has settled and sums it up.

    Parameters
    ----------
    box : SettlingBox
    contact : SpringContact
    cost : DeckCost
    density : float
        Of the grains, in kg/m**3.
    name : str
        Of the deck.
    """
    bounds = bounds_of(box, contact.impact, density)
    half, result = box.half, stem(name)
    wall = 1e9 * half if box.periodic else half  # no grain is ever in a side that is not there
    columns = "id mol x y z radius"
    return f"""compute translation all ke/rigid bodies
compute rotation all erotate/rigid bodies
compute highest all reduce max z
compute radii all property/atom radius
compute owners all property/atom mol
compute grains all reduce max c_owners
compute pairs all pair/local force
compute push all reduce max c_pairs
compute touching all contact/atom
compute touches all reduce sum c_touching
variable in_floor atom c_radii-z
variable in_x atom c_radii+abs(x)-{wall:.9e}
variable in_y atom c_radii+abs(y)-{wall:.9e}
compute walls all reduce max v_in_floor v_in_x v_in_y
variable kinetic equal c_translation+c_rotation
variable in_grains equal c_push/{contact.stiffness:.6e}
variable in_sides equal (c_walls[2]>=c_walls[3])*c_walls[2]+(c_walls[2]<c_walls[3])*c_walls[3]
variable in_walls equal (c_walls[1]>=v_in_sides)*c_walls[1]+(c_walls[1]<v_in_sides)*v_in_sides
variable overlap equal (v_in_grains>=v_in_walls)*v_in_grains+(v_in_grains<v_in_walls)*v_in_walls

# The run ends with an error where more energy is there than there was to fall, or a grain lies deeper in
# another or in a wall than twice the hardest fall by design. Spheres that leave the box are an error anyway.
fix too_fast all halt 20 v_kinetic > {bounds.energy:.6e} error hard
fix too_deep all halt 20 v_overlap > {bounds.impact:.6e} error hard
thermo_style custom step atoms c_translation c_rotation c_highest c_grains c_touches v_overlap
thermo {max(1, cost.steps // 40)}
thermo_modify lost error
dump moving all custom {max(1, cost.steps // 20)} {result}.moving.lammpstrj {columns}
dump_modify moving sort id format float %.9g
run {cost.steps}

variable grains equal c_grains
variable solid equal mass(all)/{density:.9g}
# Of an even layer the centre of mass lies at half its height.
variable height equal 2*xcm(all,z)
variable porosity equal 1-v_solid/({4 * half * half:.9e}*v_height)
variable contacts equal c_touches/c_grains
variable at_rest equal v_overlap
print "SETTLED ${{grains}} grains, porosity ${{porosity}}, height ${{height}} m, &
${{contacts}} sphere contacts a grain, overlap ${{at_rest}} m, kinetic energy ${{kinetic}} J"
if "${{grains}} != {bounds.grains}" then &
    "print 'ERROR: not {bounds.grains} grains are in the box: some are lost or were not poured.'" "quit 1"
if "${{at_rest}} > {bounds.rest:.6e}" then &
    "print 'ERROR: at rest grains overlap by more than {bounds.rest:.3g} m: they are too soft.'" "quit 1"
write_dump all custom {result}.lammpstrj {columns} modify sort id format float %.12g
write_data {result}.data
write_restart {result}.restart
"""
