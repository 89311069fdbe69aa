"""EDEM sphere tables: a CSV of positions and radii for each avatar, in the unit of the export.

EDEM reads no such file: its table of a multi-sphere particle takes rows that are copied and pasted, in
the order of its own columns; the header names ours, so that they can be put in that order. The centre of
mass is the origin and the axes are principal, as EDEM wants its particles. ``settle.txt`` has what is to be
typed in: volume, mass and moments of each particle, and the settings with which they settle in a box.

References
----------
Altair EDEM manual, "Add Multi-Sphere Particles": the table must match the format of the table in EDEM, and
particles must be centred on the origin along the principal axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.formats.clump_files import (
    WITH_DECK,
    check_sphere_table,
    describe_clumps,
    fitted_clumps,
    write_sphere_table,
)
from mbstudio.core.dem.reading_back import read_text, require_agreement
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.pouring import (
    ASSUMED_DENSITY,
    NOT_RUN,
    check_names,
    check_pouring,
    extent_of,
    hertz_young,
    plan_pouring,
)
from mbstudio.core.dem.specimen.settling import POISSON
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.units import METRES_PER_UNIT

STEPS_NAME = "settle.txt"
_COLUMNS = "file volume mass Ixx Iyy Izz"


def settling_steps(job: Job, clumps: Sequence[Clump], header: str) -> str:
    """Return the steps to a box of settled grains in EDEM's windows, in words and numbers.

    Parameters
    ----------
    job : Job
    clumps : sequence of Clump
    header : str
        The columns of the sphere tables.
    """
    reach, smallest = extent_of(clumps)
    plan = plan_pouring(job, reach, smallest)
    metres = METRES_PER_UNIT[job.unit]
    density = ASSUMED_DENSITY if job.density is None else job.density
    young = hertz_young(plan.contact.stiffness, smallest * metres)
    rows = []
    for body in job.bodies:
        volume = body.mass.volume * metres**3
        numbers = [volume, density * volume, *(density * moment for moment in moments_per_density(body))]
        rows.append(" ".join([f"{body.name}.csv", *(f"{number:.12e}" for number in numbers)]))
    table, half, top = "\n".join(rows), plan.stack.half, plan.stack.top
    count = len(plan.stack.places)
    return f"""{count} grains settle in a box: what to type into EDEM, which reads no file of particles.
{NOT_RUN}

Lengths in the tables of spheres and of the box are in {job.unit}; all else says its unit.

1. Bulk material. Interaction with itself and with the box: restitution 0.3,
   static friction 0.5, rolling friction 0.
   Density of the solid, in kg/{job.unit}3:
   DENSITY = {plan.density:.9g}
   Poisson's ratio {POISSON}, shear modulus {young / (2 * (1 + POISSON)):.6g} Pa (soft: that of real
   grains needs a shorter time step). At an overlap of a tenth of the smallest radius this is, in N/m:
   STIFFNESS = {plan.contact.stiffness:.6g}

2. Particles. For each file make a multi-sphere particle and paste its rows into the table of spheres;
   they are in the order {header}, which EDEM's columns may not be. Leave position and axes: the
   centre of mass is the origin and the axes are principal. Do not let EDEM calculate the properties, which
   counts overlaps in its own way, but type volume (m3), mass (kg) and moments (kg m2):

{_COLUMNS}
{table}

3. Geometry. A box open at the top, centred on the z axis, in {job.unit}: {2 * half:.9g} wide and deep,
   from z = 0 to {1.4 * top:.9g}. A factory in its upper part, random orientation, {count} particles in
   all, equal numbers of each kind.

4. Physics. Hertz-Mindlin (no slip). Gravity along -z, in {job.unit}/s2:
   GRAVITY = {plan.gravity:.9g}

5. Simulation. Fixed time step, a 30th of the shortest contact, and the time until rest, both in s:
   STEP = {plan.contact.step:.6g}
   SECONDS = {plan.seconds:.6g}
"""


def moments_per_density(body: DemBody) -> list[float]:
    """Return the principal moments of a body of 1 kg/m3, in kg m2, ascending."""
    metres = METRES_PER_UNIT[body.mass.unit]
    return [float(moment) for moment in body.mass.principal / body.mass.mass * body.mass.volume * metres**5]


def check_steps(path: Path, manifest: Mapping[str, Any]) -> None:
    """Raise ExportError unless the numbers to be typed in are those of the manifest.

    Raises
    ------
    ExportError
        If a particle is missing, or volume, mass, moments, density, gravity or time step are off.
    """
    text = read_text(path)
    _, _, rest = text.partition(f"\n{_COLUMNS}\n")
    rows = [line.split() for line in rest.partition("\n\n")[0].splitlines()]
    files = [item["files"][0] for item in manifest["items"]]
    check_names(path, [row[0] for row in rows if row], files)
    metres = METRES_PER_UNIT[manifest["unit"]]
    density = manifest["density"] or ASSUMED_DENSITY
    for row, item in zip(rows, manifest["items"], strict=True):
        volume = item["volume"] * metres**3
        require_agreement(path, f"volume and mass of {row[0]}", row[1:3], [volume, density * volume], 1e-6)
        moments = [density * moment for moment in item["details"]["moments_per_density"]]
        require_agreement(path, f"moments of {row[0]}", row[3:], moments, 1e-9)
    check_pouring(path, text, manifest)


_HEADER = "x,y,z,radius"


def write(job: Job) -> Written:
    """Write a sphere table for each body."""
    clumps = fitted_clumps(job)
    for body, clump in zip(job.bodies, clumps, strict=True):
        write_sphere_table(job.folder / f"{body.name}.csv", clump, _HEADER)
    (job.folder / STEPS_NAME).write_text(settling_steps(job, clumps, _HEADER), encoding="ascii")
    details = [
        {**found, "moments_per_density": moments_per_density(body)}
        for found, body in zip(describe_clumps(clumps, job.bodies), job.bodies, strict=True)
    ]
    return Written([(f"{body.name}.csv",) for body in job.bodies], details, (STEPS_NAME,))


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read the tables back and compare them, and what is to be typed in, with the manifest."""
    for item in manifest["items"]:
        check_sphere_table(folder / item["files"][0], item, _HEADER)
    check_steps(folder / STEPS_NAME, manifest)


TARGET = Target(
    name="edem",
    title="EDEM sphere tables",
    geometry="clump",
    needs_density=False,
    default_unit="m",
    write=write,
    validate=validate,
    options=WITH_DECK,
)
