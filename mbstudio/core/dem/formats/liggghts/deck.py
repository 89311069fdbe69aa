"""The example deck of a LIGGGHTS export: pour some of each template into a box and let them settle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.reading_back import read_text
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.deck_cost import DeckCost, bounds_of, require_affordable
from mbstudio.core.dem.specimen.settling import GRAVITY, POISSON, SettlingBox, settling_box
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError
from mbstudio.core.units import METRES_PER_UNIT

_PARTS = 20


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


def write_settling_deck(
    job: Job, clumps: Sequence[Clump], templates: Sequence[str], poured: int
) -> Mapping[str, Any]:
    """Write a deck in SI units that runs as it is, from within its folder; return what it costs.

    The box is a few grain diameters wide and high enough for all particles to be inserted at once
    without touching. Young's modulus is the lowest that LIGGGHTS takes or such that an impact
    overlaps little, which keeps the time step long; the step is 15 % of Rayleigh's for the
    smallest sphere.

    Raises
    ------
    ExportError
        If it would take longer than the export allows.
    """
    bodies = job.bodies
    box = settling_box(bodies, clumps, poured)
    contact = hertz_contact(box, bodies[0].mass.density)
    spheres = round(box.particles * float(np.mean([len(clump.radii) for clump in clumps])))
    cost = cost_of(box, contact, spheres)
    require_affordable(job, DECK_NAME, cost, box)
    title = f"{box.particles} particles of {len(bodies)} kinds settle in a box"
    include = "\n".join(f"include {name}" for name in templates)
    shares = " ".join(f"template{number} {1 / len(bodies):.9g}" for number in range(1, len(bodies) + 1))
    text = f"""{opening(box, contact, title, DECK_NAME, cost)}
{include}
fix kinds all particledistribution/discrete/numberbased 32452843 {len(bodies)} {shares}
fix pour all insert/pack seed 49979687 distributiontemplate kinds maxattempt 1000 insert_every once &
    overlapcheck yes orientation random all_in yes vel constant 0. 0. 0. region above &
    particles_in_region {box.particles}
{closing(box, contact, cost, DECK_NAME)}"""
    (job.folder / DECK_NAME).write_text(text, encoding="ascii")
    return cost.record()


@dataclass(frozen=True)
class HertzContact:
    """Hertz's law for all spheres and walls, in SI units.

    Attributes
    ----------
    density : float
        Of the grains, in kg/m**3.
    young : float
        In Pa.
    step : float
        Time step in s.
    impact : float
        Overlap of the heaviest particle that falls from the top onto its smallest sphere, in m.
    """

    density: float
    young: float
    step: float
    impact: float


def hertz_contact(box: SettlingBox, density: float) -> HertzContact:
    """Return the contact law of a box of grains of a density in kg/m**3."""
    young = max(5e6, 2000.0 * density * GRAVITY * box.top)
    shear = young / (2 * (1 + POISSON))
    rayleigh = np.pi * box.smallest * np.sqrt(density / shear) / (0.1631 * POISSON + 0.8766)
    effective = young / (2 * (1 - POISSON**2))
    # Half m v**2 becomes 8/15 E* sqrt(R) d**2.5.
    energy = box.heaviest * GRAVITY * box.top
    impact = (15 / 8 * energy / (effective * np.sqrt(box.smallest))) ** 0.4
    return HertzContact(density, float(young), float(f"{0.15 * rayleigh:.3g}"), float(impact))


def cost_of(box: SettlingBox, contact: HertzContact, spheres: int) -> DeckCost:
    """Return steps, in twenty parts of which the run is watched, and time of a deck."""
    steps = int(np.ceil(box.seconds / contact.step / 1000) * 1000)
    return DeckCost("LIGGGHTS", steps, contact.step, spheres)


def opening(box: SettlingBox, contact: HertzContact, title: str, name: str, cost: DeckCost) -> str:
    """Return the part of a deck that makes box, walls, contact law, gravity and the region of insertion.

    Parameters
    ----------
    box : SettlingBox
    contact : HertzContact
    title, name : str
        What the deck does, and its file.
    cost : DeckCost
    """
    young, step = contact.young, contact.step
    half, low, top = box.half, box.low, box.top
    sides = f"{-half:.6e} {half:.6e} {-half:.6e} {half:.6e}"
    return f"""# {title}: liggghts -in {name}
# It takes {cost.told}.
# It writes {stem(name)}.dump (the spheres at rest, for 'mbstudio packing read'), {stem(name)}.moving.dump
# and {stem(name)}.restart, and prints a line that begins with SETTLED.
# Do not run it with '-screen none': LIGGGHTS 3.8.0 crashes where it skips a comment or an empty line then.
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


def stem(name: str) -> str:
    """Return what the files that a deck writes are called: 'settled' for in.settle."""
    return {"in.settle": "settled", "in.specimen": "specimen_settled"}[name]


def check_end(path: Path) -> None:
    """Raise ExportError unless a deck ends by saving what has settled."""
    if not read_text(path).endswith(f"\nwrite_restart {stem(path.name)}.restart\n"):
        raise ExportError(f"{path} is cut off: it does not end by saving what has settled.")


def closing(box: SettlingBox, contact: HertzContact, cost: DeckCost, name: str) -> str:
    """Return the part of a deck that joins spheres to bodies, watches the run, saves and sums up."""
    bounds = bounds_of(box, contact.impact, contact.density)
    half, part = box.half, cost.steps // _PARTS
    # An unknown command is the one way to end LIGGGHTS 3.8 with an error from within a deck.
    checks = " &\n".join(
        f"""    "if '{condition}' then 'ERROR_{message}'\""""
        for condition, message in (
            ("${overlap} > " + f"{bounds.impact:.6e}", "grains_overlap_too_deep"),
            ("${kinetic} > " + f"{bounds.energy:.6e}", "more_energy_than_there_was_to_fall"),
            ("${grains} < " + f"{bounds.grains}", "grains_are_lost_or_were_not_inserted"),
        )
    )
    return f"""fix bodies all multisphere

compute translation all ke/multisphere
compute rotation all erotate/multisphere
compute radii all property/atom radius
compute owners all property/atom mol
compute grains all reduce max c_owners
compute pairs all pair/gran/local delta
compute deepest all reduce max c_pairs[1]
compute touching all contact/atom
compute touches all reduce sum c_touching
variable in_floor atom c_radii-z
variable in_x atom c_radii+abs(x)-{half:.9e}
variable in_y atom c_radii+abs(y)-{half:.9e}
compute walls all reduce max v_in_floor v_in_x v_in_y
variable kinetic equal c_translation+c_rotation
variable grains equal c_grains
variable in_sides equal (c_walls[2]>=c_walls[3])*c_walls[2]+(c_walls[2]<c_walls[3])*c_walls[3]
variable in_walls equal (c_walls[1]>=v_in_sides)*c_walls[1]+(c_walls[1]<v_in_sides)*v_in_sides
variable overlap equal (c_deepest>=v_in_walls)*c_deepest+(c_deepest<v_in_walls)*v_in_walls
variable touches equal c_touches
compute masses all multisphere property masstotal
compute weight all reduce sum c_masses
compute centers all multisphere property xcm
compute middle all reduce ave c_centers[3]
variable weight equal c_weight
variable middle equal c_middle
thermo_style custom step atoms c_translation c_rotation c_grains c_touches v_overlap c_weight c_middle
thermo {part}
thermo_modify lost error
dump moving all custom {part} {stem(name)}.moving.dump id type mol x y z radius
dump_modify moving sort id format "%d %d %d %.9g %.9g %.9g %.9g"
# The run ends with an error where a grain is lost, more energy is there than there was to fall, or a grain
# lies deeper in another or in a wall than twice the hardest fall by design.
run {part * _PARTS} every {part} &
{checks}

# Of an even layer the centres lie, in the mean, at half its height.
variable height equal 2*v_middle
variable porosity equal 1-v_weight/({contact.density:.9g}*{4 * half * half:.9e}*v_height)
variable contacts equal v_touches/v_grains
print "SETTLED ${{grains}} grains, porosity ${{porosity}}, height ${{height}} m, &
${{contacts}} sphere contacts a grain, overlap ${{overlap}} m, kinetic energy ${{kinetic}} J"
if "${{overlap}} > {bounds.rest:.6e}" then "ERROR_at_rest_grains_overlap_by_more_than_a_hundredth"
undump moving
dump settled all custom 1 {stem(name)}.dump id type mol x y z radius
dump_modify settled sort id format "%d %d %d %.12g %.12g %.12g %.12g"
run 0
write_restart {stem(name)}.restart
"""
