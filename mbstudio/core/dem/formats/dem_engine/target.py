"""Chrono DEM-Engine clumps: sphere tables, and a script that loads them with our mass and inertia.

``<name>.csv`` has the header ``x,y,z,r`` and nothing but these columns (a missing ``r`` silently gives
spheres of no radius), in metres; mass and moments are arguments of ``LoadClumpType``, which ``clumps.json``
holds and ``load_clumps.py`` passes on. ``settle.py`` lets some of each fall into a box.

References
----------
Chrono DEM-Engine, API.h and its Python demos (``LoadClumpType``, ``AddClumps``, ``SetOriQ`` as x, y, z, w).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mbstudio.core.dem.formats.clump_files import (
    WITH_DECK,
    check_sphere_table,
    describe_clumps,
    fitted_clumps,
    write_sphere_table,
)
from mbstudio.core.dem.formats.dem_engine.deck import DECK_NAME, check_deck, settling_deck
from mbstudio.core.dem.manifest import check_moments
from mbstudio.core.dem.reading_back import read_text, require_agreement
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import ExportError

_HEADER = "x,y,z,r"
_TABLE, _LOADER = "clumps.json", "load_clumps.py"

_SCRIPT = '''"""Load the clumps into Chrono DEM-Engine. In a simulation: templates = load(solver, material)"""

import json
from pathlib import Path

FOLDER = Path(__file__).resolve().parent


def load(solver, material):
    """Return a clump template by name, with the mass (kg) and moments (kg m2) of the grain."""
    clumps = json.loads((FOLDER / "clumps.json").read_text())
    return {
        name: solver.LoadClumpType(entry["mass"], entry["moi"], str(FOLDER / entry["file"]), material)
        for name, entry in clumps.items()
    }
'''


def write(job: Job) -> Written:
    """Write a sphere table for each body, and one table and script for all."""
    clumps = fitted_clumps(job)
    entries = {}
    for body, clump in zip(job.bodies, clumps, strict=True):
        name = f"{body.name}.csv"
        write_sphere_table(job.folder / name, clump, _HEADER)
        moments = [float(moment) for moment in body.mass.principal]
        entries[body.name] = {"file": name, "mass": body.mass.mass, "moi": moments}
    text = json.dumps(entries, indent=1, allow_nan=False)
    (job.folder / _TABLE).write_text(text + "\n", encoding="ascii")
    (job.folder / _LOADER).write_text(_SCRIPT, encoding="ascii")
    (job.folder / DECK_NAME).write_text(settling_deck(job, clumps), encoding="ascii")
    details = describe_clumps(clumps, job.bodies)
    shared = (_TABLE, _LOADER, DECK_NAME)
    return Written([(f"{body.name}.csv",) for body in job.bodies], details, shared)


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read the tables back and compare them with the manifest.

    Raises
    ------
    ExportError
        For another header or column, radii that are not positive, another mass or moments.
    """
    path = folder / _TABLE
    try:
        entries = json.loads(read_text(path))
        found = {
            name: (str(entry["file"]), [str(value) for value in (entry["mass"], *entry["moi"])])
            for name, entry in entries.items()
        }
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ExportError(f"{path} cannot be read ({error}).") from error
    if list(found) != [item["name"] for item in manifest["items"]]:
        raise ExportError(f"{path} does not name the clumps of the manifest, each once and in order.")
    for item in manifest["items"]:
        check_sphere_table(folder / item["files"][0], item, _HEADER)
        file, numbers = found[item["name"]]
        require_agreement(path, "'file'", [file], [item["files"][0]])
        require_agreement(path, "'mass'", numbers[:1], [item["mass"]])
        require_agreement(path, "'moi'", numbers[1:], item["moments"])
        check_moments(item["name"], item["mass"], [float(number) for number in numbers[1:]])
    if read_text(folder / _LOADER) != _SCRIPT:
        raise ExportError(f"{folder / _LOADER} is not the script that mbstudio writes: export again.")
    check_deck(folder / DECK_NAME, manifest)


TARGET = Target(
    name="dem-engine",
    title="Chrono DEM-Engine clumps",
    geometry="clump",
    needs_density=True,
    default_unit="m",
    write=write,
    validate=validate,
    options=WITH_DECK,
    units=("m",),
)
