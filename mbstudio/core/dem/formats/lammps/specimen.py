"""The deck of a LAMMPS specimen: every particle with its own size, place, mass and inertia tensor.

``specimen.data`` holds the spheres, ``specimen.bodies`` the bodies for ``fix rigid/small ... infile``: mass,
centre, inertia tensor in the box's axes (``Ixx Iyy Izz Ixy Ixz Iyz``), velocity, spin and image flags.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.formats.lammps.deck import check_end, closing, cost_of, opening
from mbstudio.core.dem.manifest import check_moments
from mbstudio.core.dem.particles import Specimen
from mbstudio.core.dem.reading_back import number_rows, read_lines, read_text
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.deck_cost import DeckCost, require_affordable
from mbstudio.core.dem.specimen.placing import rotations_of
from mbstudio.core.dem.specimen.settling import (
    SettlingBox,
    SpringContact,
    specimen_box,
    spring_contact,
)
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError

DECK_NAME, DATA_NAME, BODIES_NAME = "in.specimen", "specimen.data", "specimen.bodies"


def write_specimen_deck(
    job: Job, specimen: Specimen, clumps: Sequence[Clump]
) -> tuple[tuple[str, ...], Mapping[str, Any]]:
    """Write deck, spheres and bodies in SI units; return the names of the files, and what the deck costs.

    Raises
    ------
    ExportError
        If it would take longer than the export allows.
    """
    folder, bodies = job.folder, job.bodies
    box = specimen_box(specimen, bodies, clumps)
    contact = spring_contact(box)
    cost = cost_of(box, contact, sum(len(clumps[kind].radii) for kind in specimen.kinds))
    require_affordable(job, DECK_NAME, cost, box)
    rotations = rotations_of(specimen.quaternions)
    atoms, rows = [], []
    particles = zip(specimen.kinds, specimen.scales, specimen.positions, rotations, strict=True)
    for number, (kind, scale, place, rotation) in enumerate(particles, start=1):
        body, clump = bodies[kind], clumps[kind]
        centers = scale * clump.centers @ rotation.T + place
        density = body.mass.mass * scale**3 / float((4 / 3 * np.pi * (scale * clump.radii) ** 3).sum())
        atoms += [
            (number, 2 * scale * radius, density, *center)
            for center, radius in zip(centers, clump.radii, strict=True)
        ]
        tensor = rotation @ np.diag(body.mass.principal * scale**5) @ rotation.T
        entries = (tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2])
        rows.append((number, body.mass.mass * scale**3, *place, *entries))
    (folder / DATA_NAME).write_text(_data_text(atoms), encoding="ascii")
    lines = [f"{row[0]} " + " ".join(f"{value:.15g}" for value in row[1:]) for row in rows]
    text = "\n".join([str(len(rows)), *(f"{line} 0 0 0 0 0 0 0 0 0" for line in lines)])
    (folder / BODIES_NAME).write_text(text + "\n", encoding="ascii")
    text = _deck_text(box, contact, cost, bodies[0].mass.density)
    (folder / DECK_NAME).write_text(text, encoding="ascii")
    return (DECK_NAME, DATA_NAME, BODIES_NAME), cost.record()


def _data_text(atoms: Sequence[tuple[float, ...]]) -> str:
    """Return a data file that is added to a box which is there; molecule numbers by fix property/atom."""
    lines = [
        f"{n} 1 {diameter:.15g} {density:.15g} {x:.15g} {y:.15g} {z:.15g}"
        for n, (_, diameter, density, x, y, z) in enumerate(atoms, start=1)
    ]
    molecules = [f"{n} {atom[0]}" for n, atom in enumerate(atoms, start=1)]
    places = np.array([atom[3:] for atom in atoms])
    bounds = "\n".join(
        f"{low:.9e} {high:.9e} {axis}lo {axis}hi"
        for axis, low, high in zip("xyz", places.min(axis=0) - 1e-9, places.max(axis=0) + 1e-9, strict=True)
    )
    return (
        f"# spheres of a specimen, SI units\n\n{len(atoms)} atoms\n1 atom types\n\n{bounds}\n\n"
        "Atoms # sphere\n\n" + "\n".join(lines) + "\n\nMolecules\n\n" + "\n".join(molecules) + "\n"
    )


def _deck_text(box: SettlingBox, contact: SpringContact, cost: DeckCost, density: float) -> str:
    title = f"A specimen of {box.particles} particles settles in a box"
    return f"""{opening(box, contact, title, cost, DECK_NAME)}
read_data {DATA_NAME} add append fix mol NULL Molecules
# A second run would weigh the spheres anew and forget the inertia of the file but for 'reinit no'.
fix bodies all rigid/small molecule infile {BODIES_NAME} gravity gravity reinit no

{closing(box, contact, cost, density, DECK_NAME)}"""


def check_specimen_files(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Raise ExportError unless spheres and bodies of a specimen are those of the manifest.

    LAMMPS believes every body it is given: masses, tensors and the belonging of spheres are checked here.
    """
    check_end(folder / DECK_NAME)
    said, items = manifest["specimen"], manifest["items"]
    path = folder / BODIES_NAME
    lines = read_lines(path)
    rows = number_rows(path, lines[1:], 20)
    if lines[:1] != [str(said["count"])] or not np.array_equal(rows[:, 0], 1 + np.arange(said["count"])):
        raise ExportError(f"{path} does not number the bodies 1 to {said['count']}.")
    wanted = manifest["density"] * said["solid_volume"]
    if rows[:, 1].min() <= 0 or abs(rows[:, 1].sum() / wanted - 1) > 1e-9:
        raise ExportError(f"{path} has masses that are not positive or not those of the specimen.")
    for number, row in enumerate(rows, start=1):
        xx, yy, zz, xy, xz, yz = row[5:11]
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        check_moments(f"Body {number} of {path}", float(row[1]), [float(moment) for moment in moments])
    _check_data(folder / DATA_NAME, {item["name"]: item["details"]["spheres"] for item in items}, said)


def _check_data(path: Path, spheres: Mapping[str, int], said: Mapping[str, Any]) -> None:
    parts = re.split(r"\n\n(Atoms # sphere|Molecules)\n\n", read_text(path))
    if len(parts) != 5 or parts[1] == parts[3]:
        raise ExportError(f"{path} must have the sections 'Atoms # sphere' and 'Molecules', each once.")
    atoms = number_rows(path, parts[2].split("\n"), 7)
    owners = number_rows(path, parts[4].rstrip("\n").split("\n"), 2)
    count = sum(number * spheres[name] for name, number in said["numbers"].items())
    if len(atoms) != count or not np.array_equal(owners[:, 0], atoms[:, 0]):
        raise ExportError(f"{path} does not hold the {count} spheres of the specimen, each with its body.")
    if atoms[:, 2:4].min() <= 0:
        raise ExportError(f"{path} has a diameter or density that is not positive.")
    if set(owners[:, 1]) != set(range(1, said["count"] + 1)):
        raise ExportError(f"{path} has bodies without spheres, or spheres without a body.")
