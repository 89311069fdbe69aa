"""Kratos clusters (``.clu``) with mass, centre and inertia of the avatar, and a case that runs.

``<name>.clu`` holds spheres, volume and inertia per unit mass, in metres, about the centre of mass
and along the principal axes; ``MaterialsDEM.json``, ``ProjectParametersDEM.json``, two ``.mdpa`` files
and ``settle.py`` let some of each fall into a box.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.formats.clump_files import (
    WITH_TIMED_DECK,
    check_spheres,
    describe_clumps,
    fitted_clumps,
)
from mbstudio.core.dem.formats.kratos.case import CASE_FILES, SCRIPT_NAME, check_case, write_case
from mbstudio.core.dem.manifest import check_moments
from mbstudio.core.dem.reading_back import agrees, number_rows, read_text, require_agreement
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import ExportError

_CENTER = "Particle_center_and_diameter"
_INERTIA = "Inertia per unit mass"


def write(job: Job) -> Written:
    """Write a cluster file for each body, and one case for all."""
    clumps = fitted_clumps(job)
    for body, clump in zip(job.bodies, clumps, strict=True):
        (job.folder / f"{body.name}.clu").write_text(cluster_text(body, clump), encoding="ascii")
    runs = {SCRIPT_NAME: write_case(job, clumps, int(job.options["poured"]))}
    details = describe_clumps(clumps, job.bodies)
    return Written([(f"{body.name}.clu",) for body in job.bodies], details, CASE_FILES, runs)


def cluster_size(clump: Clump) -> float:
    """Return the diameter of the sphere about the centre of mass that holds a clump."""
    return 2 * float((np.linalg.norm(clump.centers, axis=1) + clump.radii).max())


def cluster_text(body: DemBody, clump: Clump) -> str:
    """Return a cluster file; no blank line may follow a keyword."""
    spheres = "\n".join(
        f"{x:.12e} {y:.12e} {z:.12e} {r:.12e}"
        for (x, y, z), r in zip(clump.centers, clump.radii, strict=True)
    )
    size = cluster_size(clump)
    inertia = "\n".join(f"{moment:.12e}" for moment in body.mass.principal / body.mass.mass)
    return (
        f"Name\n{body.name}\n\n"
        f"Begin centers_and_radii\n{spheres}\nEnd centers_and_radii\n\n"
        f"{_CENTER}\n0 0 0 {size:.12e}\n\n"
        f"Size\n{size:.12e}\n\n"
        f"Volume\n{body.mass.volume:.12e}\n\n"
        f"{_INERTIA}\n{inertia}\n"
    )


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read clusters and materials back and compare them with the manifest.

    Raises
    ------
    ExportError
        For what Kratos would swallow: a blank line after a keyword, a name with spaces, another volume,
        centre or inertia than the manifest's, radii that are not positive, a case that does not fit it.
    """
    for item in manifest["items"]:
        _check_cluster(folder / item["files"][0], item)
    check_case(folder, manifest)


def _check_cluster(path: Path, item: Mapping[str, Any]) -> None:
    found = _parse(path)
    if found["Name"] != [item["name"]]:
        raise ExportError(f"{path} has the name '{' '.join(found['Name'])}' instead of '{item['name']}'.")
    rows = number_rows(path, found["spheres"], 4)
    check_spheres(path, rows, item)
    size = 2 * float((np.linalg.norm(rows[:, :3], axis=1) + rows[:, 3]).max())
    if not agrees(found["Size"], [size], 1e-6) or not agrees(found[_CENTER], [0.0, 0.0, 0.0, size], 1e-6):
        raise ExportError(f"{path} states another centre or size than its spheres have: Kratos scales by it.")
    require_agreement(path, "'Volume'", found["Volume"], [item["volume"]])
    wanted = [moment / item["mass"] for moment in item["moments"]]
    require_agreement(path, f"'{_INERTIA}'", found[_INERTIA], wanted)
    check_moments(item["name"], 1.0, [float(word) for word in found[_INERTIA]])


def _parse(path: Path) -> dict[str, list[str]]:
    """Return the values after each keyword, by the grammar of Kratos 10."""
    lines = [line.rstrip() for line in read_text(path).splitlines() if not line.startswith("//")]
    rows_after = {"Name": 1, _CENTER: 1, "Size": 1, "Volume": 1, _INERTIA: 3}
    found: dict[str, list[str]] = {}
    place = 0
    while place < len(lines):
        keyword = lines[place]
        if not keyword:
            place += 1
        elif keyword == "Begin centers_and_radii" and "spheres" not in found:
            if "End centers_and_radii" not in lines[place:]:
                raise ExportError(f"{path} does not end its spheres by 'End centers_and_radii'.")
            end = lines.index("End centers_and_radii", place)
            found["spheres"] = lines[place + 1 : end]
            place = end + 1
        elif keyword in rows_after and keyword not in found:
            values = lines[place + 1 : place + 1 + rows_after[keyword]]
            if len(values) < rows_after[keyword] or not all(values):
                raise ExportError(f"{path} has an empty or missing line after '{keyword}'.")
            found[keyword] = " ".join(values).split()
            place += 1 + rows_after[keyword]
        else:
            raise ExportError(f"{path} has '{keyword}' where a keyword of Kratos should stand (once).")
    for keyword in (*rows_after, "spheres"):
        if keyword not in found:
            raise ExportError(f"{path} lacks '{keyword}'.")
    return found


TARGET = Target(
    name="kratos",
    title="Kratos DEM clusters",
    geometry="clump",
    needs_density=True,
    default_unit="m",
    write=write,
    validate=validate,
    options=WITH_TIMED_DECK,
    units=("m",),
)
