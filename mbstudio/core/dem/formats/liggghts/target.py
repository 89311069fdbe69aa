"""LIGGGHTS multisphere templates, with mass and inertia of the avatar, and a deck that pours them.

``<name>.multisphere`` holds a line ``x y z r`` a sphere and nothing else, in the unit of the export;
``<name>.template`` the command that reads it, to be included in any deck (lengths are scaled to
metres there); ``in.settle`` inserts some of each into a box and lets them fall.

LIGGGHTS 3.8.0 takes the inertia tensor in row order and believes whatever it reads; its own Monte
Carlo inertia is wrong for templates that are not principal. So the command always states mass and
tensor, and :func:`validate` compares every number with the manifest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float

from mbstudio.core.dem.formats.clump_files import (
    OPTIONS,
    POURED,
    check_spheres,
    describe_clumps,
    fitted_clumps,
    sphere_rows,
)
from mbstudio.core.dem.formats.liggghts.deck import (
    DECK_NAME,
    check_end,
    template_command,
    write_settling_deck,
)
from mbstudio.core.dem.formats.liggghts.specimen import DECK_NAME as SPECIMEN_DECK_NAME
from mbstudio.core.dem.formats.liggghts.specimen import check_specimen_deck, write_specimen_deck
from mbstudio.core.dem.manifest import check_moments
from mbstudio.core.dem.reading_back import agrees, number_rows, read_lines, read_text
from mbstudio.core.dem.specimen.deck_cost import HOURS
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import ExportError
from mbstudio.core.options import Option
from mbstudio.core.units import METRES_PER_UNIT


def write(job: Job) -> Written:
    """Write a sphere file and a template command for each body, and one deck for all."""
    files = []
    clumps = fitted_clumps(job)
    for index, (body, clump) in enumerate(zip(job.bodies, clumps, strict=True)):
        spheres, template = f"{body.name}.multisphere", f"{body.name}.template"
        # No comment, no empty line: run with '-screen none', LIGGGHTS 3.8.0 crashes when it skips one.
        np.savetxt(job.folder / spheres, sphere_rows(clump), fmt="%.9e")
        command = template_command(body, spheres, len(clump.radii), index + 1, int(job.options["ntry"]))
        (job.folder / template).write_text(command, encoding="ascii")
        files.append((spheres, template))
    templates = [entry[1] for entry in files]
    runs = {DECK_NAME: write_settling_deck(job, clumps, templates, int(job.options["poured"]))}
    if job.specimen is not None:
        runs[SPECIMEN_DECK_NAME] = write_specimen_deck(job, job.specimen, clumps)
    details = describe_clumps(clumps, job.bodies)
    return Written(files, details, tuple(runs), runs)


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read spheres, template commands and deck back and compare them with the manifest.

    Raises
    ------
    ExportError
        For what LIGGGHTS would swallow: text in place of numbers, radii that are not positive, a wrong
        number of spheres, a missing or reordered inertia tensor, a wrong scale, templates out of order.
    """
    for number, item in enumerate(manifest["items"], start=1):
        spheres, template = item["files"]
        rows = read_spheres(folder / spheres)
        check_spheres(folder / spheres, rows, item)
        _check_template(folder / template, spheres, len(rows), number, item, manifest)
    deck = folder / DECK_NAME
    included = [line.split()[1] for line in read_lines(deck) if line.startswith("include ")]
    if included != [item["files"][1] for item in manifest["items"]]:
        raise ExportError(f"{deck} does not include the templates of the manifest, each once and in order.")
    check_end(deck)
    if "specimen" in manifest:
        check_specimen_deck(folder, manifest)


def read_spheres(path: Path) -> Float[np.ndarray, "n 4"]:
    """Return the rows ``x y z r`` of a sphere file; ExportError for anything that is no number."""
    return number_rows(path, read_text(path).splitlines(), 4)


def _check_template(
    path: Path, spheres: str, count: int, number: int, item: Mapping[str, Any], manifest: Mapping[str, Any]
) -> None:
    words = " ".join(line.removesuffix("&") for line in read_lines(path) if not line.startswith("#")).split()
    found = _parse_template(path, words)
    expected: dict[str, Sequence[str | float]] = {
        "id": [f"template{number}"],
        "density": [manifest["density"]],
        "nspheres": [float(count)],
        "file": [spheres],
        "scale": [METRES_PER_UNIT[manifest["unit"]]],
        "mass": [item["mass"]],
        "inertia_tensor": [item["moments"][0], 0.0, 0.0, item["moments"][1], 0.0, item["moments"][2]],
        "type": [float(number)],
    }
    for keyword, wanted in expected.items():
        values = found.get(keyword)
        if values is None:
            raise ExportError(f"{path} lacks '{keyword}'.")
        if not agrees(values, wanted):
            raise ExportError(
                f"{path} has '{keyword}' {' '.join(values)}; the manifest says {' '.join(map(str, wanted))}."
            )
    if "use_volume" not in found:
        raise ExportError(
            f"{path} lacks 'use_volume': LIGGGHTS would not know which density belongs to the mass."
        )
    if not agrees(found.get("ntry", ["0"]), [float(manifest["options"]["ntry"])]):
        raise ExportError(f"'ntry' in {path} differs from the manifest.")
    check_moments(
        item["name"], float(found["mass"][0]), [float(found["inertia_tensor"][i]) for i in (0, 3, 5)]
    )


def _parse_template(path: Path, words: list[str]) -> dict[str, list[str]]:
    """Return keyword and values of a template command, by the grammar of LIGGGHTS 3.8.0."""
    if words[:1] != ["fix"] or words[2:4] != ["all", "particletemplate/multisphere"]:
        raise ExportError(f"{path} is no 'fix ... all particletemplate/multisphere' command.")
    found = {"id": words[1:2]}
    lengths = {
        "atom_type": 1, "density": 2, "nspheres": 1, "ntry": 1, "spheres": 0, "file": 1, "scale": 1,
        "mass": 1, "inertia_tensor": 6, "use_volume": 0, "type": 1,
    }  # fmt: skip
    place = 5
    while place < len(words):
        keyword = words[place]
        if keyword not in lengths or keyword in found:
            raise ExportError(f"{path} has '{keyword}' where a keyword of LIGGGHTS should stand (once).")
        values = words[place + 1 : place + 1 + lengths[keyword]]
        if len(values) != lengths[keyword]:
            raise ExportError(f"{path} ends within '{keyword}'.")
        found[keyword] = values[1:] if keyword == "density" else values
        place += 1 + lengths[keyword]
    return found


TARGET = Target(
    name="liggghts",
    title="LIGGGHTS multisphere templates",
    geometry="clump",
    needs_density=True,
    default_unit="m",
    write=write,
    validate=validate,
    options=MappingProxyType(
        {
            **OPTIONS,
            "poured": POURED,
            "hours": HOURS,
            "classes": Option(6, "sizes of each avatar that the deck of a specimen inserts", 1, 200),
            "ntry": Option(
                200000, "Monte Carlo points of LIGGGHTS for the clump's volume and centre", 1000, 10**8
            ),
        }
    ),
)
