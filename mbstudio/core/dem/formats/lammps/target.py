"""LAMMPS molecules for ``fix rigid/small``, with the avatar's mass and inertia, and a deck that pours.

``<name>.mol`` is a molecule file in SI units with the sections Coords, Types, Diameters and Masses;
``in.settle`` pours the molecules into a box.

Two traps are shut here. LAMMPS reads the inertia line as ``Ixx Iyy Izz Iyz Ixz Ixy``, while its
documentation says ``Ixy Ixz Iyz`` (29Sep2021 and 22Jul2025): with principal axes the last three are
zero and the order is nothing to get wrong. And gravity acts on every sphere by its own mass, which
turns a falling clump unless the spheres' masses are balanced about the body's centre: they are, and
the deck moreover lets ``fix rigid/small`` apply gravity to whole bodies.
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
    describe_clump,
    fitted_clumps,
)
from mbstudio.core.dem.formats.lammps.deck import DECK_NAME, check_end, write_pouring_deck
from mbstudio.core.dem.formats.lammps.specimen import DECK_NAME as SPECIMEN_DECK_NAME
from mbstudio.core.dem.formats.lammps.specimen import check_specimen_files, write_specimen_deck
from mbstudio.core.dem.manifest import check_moments
from mbstudio.core.dem.reading_back import number_rows, read_lines, read_text, require_agreement
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.shapes.point_masses import balanced_masses
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import ExportError

_SECTIONS = {"Coords": 4, "Types": 2, "Diameters": 2, "Masses": 2}


def write(job: Job) -> Written:
    """Write a molecule file for each body, and one deck for all."""
    clumps = fitted_clumps(job)
    files, details = [], []
    for body, clump in zip(job.bodies, clumps, strict=True):
        masses, balanced = balanced_masses(clump.centers, clump.radii**3, body.mass.mass)
        name = f"{body.name}.mol"
        (job.folder / name).write_text(molecule_text(body, clump, masses), encoding="ascii")
        files.append((name,))
        details.append({**describe_clump(clump, body), "balanced_masses": balanced})
    molecules = [entry[0] for entry in files]
    runs = {DECK_NAME: write_pouring_deck(job, clumps, molecules, int(job.options["poured"]))}
    shared: tuple[str, ...] = (DECK_NAME,)
    if job.specimen is not None:
        names, runs[SPECIMEN_DECK_NAME] = write_specimen_deck(job, job.specimen, clumps)
        shared += names
    return Written(files, details, shared, runs)


def molecule_text(body: DemBody, clump: Clump, masses: np.ndarray) -> str:
    """Return a molecule file: first line skipped by LAMMPS, one blank line after each keyword."""
    moments = " ".join(f"{moment:.17g}" for moment in body.mass.principal)
    numbers = range(1, len(clump.radii) + 1)
    coords = [f"{i} {x:.17g} {y:.17g} {z:.17g}" for i, (x, y, z) in zip(numbers, clump.centers, strict=True)]
    diameters = [f"{i} {2 * r:.17g}" for i, r in zip(numbers, clump.radii, strict=True)]
    lines = [
        f"# {body.name}: SI units, inertia Ixx Iyy Izz and three zeros",
        "",
        f"{len(clump.radii)} atoms",
        f"{body.mass.mass:.17g} mass",
        "0 0 0 com",
        f"{moments} 0 0 0 inertia",
    ]
    sections = {
        "Coords": coords,
        "Types": [f"{i} 1" for i in numbers],
        "Diameters": diameters,
        "Masses": [f"{i} {mass:.17g}" for i, mass in zip(numbers, masses, strict=True)],
    }
    for keyword, rows in sections.items():
        lines += ["", keyword, "", *rows]
    return "\n".join(lines) + "\n"


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read molecules and deck back and compare them with the manifest.

    Raises
    ------
    ExportError
        For what LAMMPS would swallow: a negative or reordered inertia, spheres whose masses do not
        balance, another mass or centre than the manifest's, a missing blank line, atoms out of order.
    """
    for item in manifest["items"]:
        _check_molecule(folder / item["files"][0], item)
    deck = folder / DECK_NAME
    loaded = [line.split()[2:] for line in read_lines(deck) if line.startswith("molecule ")]
    if loaded != [[item["files"][0] for item in manifest["items"]]]:
        raise ExportError(f"{deck} does not load the molecules of the manifest, each once and in order.")
    check_end(deck)
    if "specimen" in manifest:
        check_specimen_files(folder, manifest)


def _check_molecule(path: Path, item: Mapping[str, Any]) -> None:
    header, sections = _parse(path)
    count = item["details"]["spheres"]
    expected = {
        "atoms": [float(count)],
        "mass": [item["mass"]],
        "com": [0.0, 0.0, 0.0],
        "inertia": [*item["moments"], 0.0, 0.0, 0.0],
    }
    for keyword, wanted in expected.items():
        if keyword not in header:
            raise ExportError(f"{path} lacks '{keyword}'.")
        require_agreement(path, f"'{keyword}'", header[keyword], wanted)
    check_moments(item["name"], float(header["mass"][0]), [float(word) for word in header["inertia"][:3]])
    tables = {}
    for keyword, columns in _SECTIONS.items():
        if keyword not in sections:
            raise ExportError(f"{path} lacks the section '{keyword}'.")
        table = number_rows(path, sections[keyword], columns)
        if not np.array_equal(table[:, 0], np.arange(1, count + 1)):
            raise ExportError(f"{path} does not number its {keyword} 1 to {count}.")
        tables[keyword] = table[:, 1:]
    if not (tables["Types"] == 1).all():
        raise ExportError(f"{path} has types other than 1, for which the deck sets no contact law.")
    check_spheres(path, np.hstack([tables["Coords"], tables["Diameters"] / 2]), item)
    _check_masses(path, tables["Masses"][:, 0], tables["Coords"], item)


def _check_masses(path: Path, masses: np.ndarray, coords: np.ndarray, item: Mapping[str, Any]) -> None:
    if masses.min() <= 0 or abs(masses.sum() / item["mass"] - 1) > 1e-9:
        raise ExportError(f"{path} has masses that are not positive or do not sum up to the body's.")
    reach = np.abs(coords).max()
    if item["details"]["balanced_masses"] and np.abs(masses @ coords).max() > 1e-9 * item["mass"] * reach:
        raise ExportError(
            f"{path} has masses whose centre is not the body's: falling, such a clump begins to turn."
        )


def _parse(path: Path) -> tuple[dict[str, list[str]], dict[str, list[str]]]:
    """Return header values and section lines of a molecule file, by the grammar of LAMMPS."""
    lines = [line.partition("#")[0].strip() for line in read_text(path).splitlines()[1:]]
    header: dict[str, list[str]] = {}
    place = 0
    while place < len(lines) and lines[place] not in _SECTIONS:
        if lines[place]:
            *values, keyword = lines[place].split()
            if keyword not in ("atoms", "mass", "com", "inertia") or keyword in header:
                raise ExportError(f"{path} has '{keyword}' where a keyword of LAMMPS should stand (once).")
            header[keyword] = values
        place += 1
    sections: dict[str, list[str]] = {}
    while place < len(lines):
        keyword = lines[place]
        if keyword not in _SECTIONS or keyword in sections:
            raise ExportError(f"{path} has '{keyword}' where a section of LAMMPS should begin (once).")
        if place + 1 >= len(lines) or lines[place + 1]:
            raise ExportError(f"{path} has no empty line after '{keyword}': LAMMPS skips the line there.")
        end = place + 2
        while end < len(lines) and lines[end]:
            end += 1
        sections[keyword] = lines[place + 2 : end]
        while end < len(lines) and not lines[end]:
            end += 1
        place = end
    return header, sections


TARGET = Target(
    name="lammps",
    title="LAMMPS rigid molecules",
    geometry="clump",
    needs_density=True,
    default_unit="m",
    write=write,
    validate=validate,
    options=WITH_TIMED_DECK,
    units=("m",),
)
