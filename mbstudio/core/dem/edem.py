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

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mbstudio.core.dem.clump_files import (
    WITH_DECK,
    check_sphere_table,
    describe_clumps,
    fitted_clumps,
    write_sphere_table,
)
from mbstudio.core.dem.edem_steps import STEPS_NAME, check_steps, moments_per_density, settling_steps
from mbstudio.core.dem.target import Job, Target, Written

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
    needs_density=False,
    default_unit="m",
    write=write,
    validate=validate,
    options=WITH_DECK,
)
