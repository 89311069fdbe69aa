"""PFC 6 to 9 clump templates, with volume and inertia of the avatar.

``<name>.dat`` holds one ``clump template create`` command in the unit of the export: pebbles as ``r x y z``,
the volume, and the inertia per unit density (a density of 1 and lengths in that unit) as ``Ixx Iyy
Izz Ixy Ixz Iyz``; ``templates.dat`` calls them all, and ``settle.dat`` lets some of each fall into a box.

References
----------
Itasca, PFC command reference (6.0 to 9.0): ``clump template``, ``clump replicate``,
``contact cmat``, ``model solve``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mbstudio.core.dem.formats.clump_files import (
    WITH_DECK,
    check_spheres,
    describe_clump,
    fitted_clumps,
    sphere_rows,
)
from mbstudio.core.dem.formats.pfc.deck import DECK_NAME, check_deck, settling_deck
from mbstudio.core.dem.manifest import check_moments
from mbstudio.core.dem.reading_back import number_rows, read_lines, read_text, require_agreement
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import ExportError

_ALL = "templates.dat"


def write(job: Job) -> Written:
    """Write a template command for each body, and a file that calls them all."""
    clumps = fitted_clumps(job)
    details = []
    for body, clump in zip(job.bodies, clumps, strict=True):
        inertia = [float(moment) for moment in body.mass.principal / body.mass.mass * body.mass.volume]
        pebbles = "\n".join(
            f"    {r:.12e} {x:.12e} {y:.12e} {z:.12e} ..." for x, y, z, r in sphere_rows(clump)
        )
        (job.folder / f"{body.name}.dat").write_text(
            f"; {body.name}: lengths in {job.unit}, inertia per unit density\n"
            f"clump template create name '{body.name}' pebbles {len(clump.radii)} ...\n"
            f"{pebbles}\n"
            f"    volume {body.mass.volume:.12e} ...\n"
            f"    inertia {' '.join(f'{moment:.12e}' for moment in inertia)} 0 0 0\n",
            encoding="ascii",
        )
        details.append({**describe_clump(clump, body), "inertia_per_density": inertia})
    calls = "".join(f"program call '{body.name}.dat'\n" for body in job.bodies)
    (job.folder / _ALL).write_text(calls, encoding="ascii")
    (job.folder / DECK_NAME).write_text(settling_deck(job, clumps, _ALL), encoding="ascii")
    return Written([(f"{body.name}.dat",) for body in job.bodies], details, (_ALL, DECK_NAME))


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read the commands back and compare them with the manifest.

    Raises
    ------
    ExportError
        If a command is broken, its pebbles are not the clump, or volume or inertia are not the avatar's.
    """
    for item in manifest["items"]:
        _check_template(folder / item["files"][0], item)
    called = [f"program call '{item['files'][0]}'" for item in manifest["items"]]
    if read_lines(folder / _ALL) != called:
        raise ExportError(
            f"{folder / _ALL} does not call the templates of the manifest, each once, in order."
        )
    check_deck(folder / DECK_NAME, manifest, _ALL)


def _check_template(path: Path, item: Mapping[str, Any]) -> None:
    lines = [line.partition(";")[0].rstrip() for line in read_text(path).splitlines()]
    lines = [line for line in lines if line]
    if any(not line.endswith("...") for line in lines[:-1]) or not lines or lines[-1].endswith("..."):
        raise ExportError(f"{path} is not a single command: all lines but the last must end in '...'.")
    words = " ".join(line.removesuffix("...") for line in lines).split()
    count = item["details"]["spheres"]
    head = ["clump", "template", "create", "name", f"'{item['name']}'", "pebbles", str(count)]
    if words[: len(head)] != head:
        raise ExportError(f"{path} does not begin with '{' '.join(head)}'.")
    numbers, tail = words[len(head) : len(head) + 4 * count], words[len(head) + 4 * count :]
    if len(tail) != 9 or (tail[0], tail[2]) != ("volume", "inertia"):
        raise ExportError(f"{path} does not have {count} pebbles, then a volume, then six moments.")
    rows = number_rows(path, [" ".join(numbers[i : i + 4]) for i in range(0, 4 * count, 4)], 4)
    check_spheres(path, rows[:, [1, 2, 3, 0]], item)
    require_agreement(path, "'volume'", tail[1:2], [item["volume"]])
    require_agreement(path, "'inertia'", tail[3:], [*item["details"]["inertia_per_density"], 0.0, 0.0, 0.0])
    check_moments(item["name"], 1.0, [float(word) for word in tail[3:6]])


TARGET = Target(
    name="pfc",
    title="PFC clump templates",
    geometry="clump",
    needs_density=False,
    default_unit="m",
    write=write,
    validate=validate,
    options=WITH_DECK,
)
