"""Yade clumps: sphere tables for ``ymport.textClumps`` and a script that gives them our mass and inertia.

``<name>.txt`` has five columns ``x y z r clumpId`` in metres and no blank line. Yade weighs a clump
of overlapping spheres by itself: as the naive sum with ``discretization=0``, on a coarse grid
otherwise. So ``settle.py`` loads with a grid of 100 cells, for the axes, and then sets mass and
principal moments of every clump to the avatar's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.formats.clump_files import (
    WITH_TIMED_DECK,
    check_spheres,
    describe_clumps,
    fitted_clumps,
    sphere_rows,
)
from mbstudio.core.dem.formats.yade.script import SCRIPT_NAME, check_kinds, write_script
from mbstudio.core.dem.reading_back import number_rows, read_text
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import ExportError

_LOADER = '''
def make(kind, position, orientation):
    """Make one clump of a kind; return its id."""
    name, mass, moments = KINDS[kind]
    from yade import ymport

    ((clump, _),) = ymport.textClumps(
        name, shift=Vector3(position), orientation=Quaternion(*orientation), discretization=100,
        material="grain",
    )
    state = O.bodies[clump].state
    # The engine's own moments, from the union of spheres, tell which of its axes is which.
    order = sorted(range(3), key=lambda axis: state.inertia[axis])
    inertia = [0.0] * 3
    for axis, moment in zip(order, moments):
        inertia[axis] = moment
    state.mass, state.inertia = mass, Vector3(inertia)
    return clump
'''


def write(job: Job) -> Written:
    """Write a sphere table for each body, and one script for all."""
    clumps = fitted_clumps(job)
    names = [f"{body.name}.txt" for body in job.bodies]
    for name, clump in zip(names, clumps, strict=True):
        rows = np.column_stack([sphere_rows(clump), np.zeros(len(clump.radii))])
        np.savetxt(job.folder / name, rows, fmt="%.12e %.12e %.12e %.12e %d")
    reach = max(float((np.linalg.norm(c.centers, axis=1) + c.radii).max()) for c in clumps)
    smallest = min(float(c.radii.min()) for c in clumps)
    spheres = round(float(np.mean([len(clump.radii) for clump in clumps])))
    kinds = kinds_of(names, job.bodies)
    runs = {SCRIPT_NAME: write_script(job, kinds, _LOADER, reach, smallest, spheres=spheres)}
    details = describe_clumps(clumps, job.bodies)
    return Written([(name,) for name in names], details, (SCRIPT_NAME,), runs)


def kinds_of(names: Sequence[str], bodies: Sequence[DemBody]) -> list[tuple[str, float, list[float]]]:
    """Return file, mass in kg and ascending moments in kg m2 of each body, all in SI units."""
    return [
        (name, body.mass.mass, [float(moment) for moment in body.mass.principal])
        for name, body in zip(names, bodies, strict=True)
    ]


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read tables and script back and compare them with the manifest.

    Raises
    ------
    ExportError
        For what Yade would swallow or crash on: blank lines, four columns, several clumps in one file, radii
        that are not positive, a script with another mass or inertia than the manifest's.
    """
    for item in manifest["items"]:
        path = folder / item["files"][0]
        rows = number_rows(path, read_text(path).splitlines(), 5)
        if not (rows[:, 4] == 0).all():
            raise ExportError(f"{path} has clump numbers other than 0: it must hold one clump.")
        check_spheres(path, rows[:, :4], item)
    check_kinds(folder / SCRIPT_NAME, manifest)


TARGET = Target(
    name="yade",
    title="Yade clumps",
    geometry="clump",
    needs_density=True,
    default_unit="m",
    write=write,
    validate=validate,
    options=WITH_TIMED_DECK,
    units=("m",),
)
