"""MercuryDPM clumps: a folder for each avatar, as its MClump loader reads it.

``<name>/Clump/Clump.txt`` holds rows ``x,y,z,r`` without a header, ``<name>/Inertia/Mass.txt`` one number,
``<name>/Inertia/TOI.txt`` the inertia tensor and ``<name>/Inertia/PD.txt`` the principal directions, 3 x 3
comma-separated; here diagonal and the identity, in SI units. ``Settle.cpp`` is a driver that reads them and
lets some of each fall into a box.

References
----------
MercuryDPM, Drivers/Clump (ClumpHeaders/ClumpInput.h, Mercury3DClump.h, TGas, RotatingDrum).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.formats.clump_files import (
    WITH_DECK,
    check_sphere_table,
    describe_clumps,
    fitted_clumps,
    write_sphere_table,
)
from mbstudio.core.dem.formats.mercury.deck import DECK_NAME, check_deck, settling_deck
from mbstudio.core.dem.manifest import check_moments
from mbstudio.core.dem.reading_back import number_rows, read_text, require_agreement
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import ExportError


def write(job: Job) -> Written:
    """Write a folder with four files for each body."""
    clumps = fitted_clumps(job)
    files = [_write_folder(job.folder, body) for body in job.bodies]
    for body_files, clump in zip(files, clumps, strict=True):
        write_sphere_table(job.folder / body_files[0], clump)
    (job.folder / DECK_NAME).write_text(settling_deck(job, clumps), encoding="ascii")
    details = describe_clumps(clumps, job.bodies)
    return Written(files, details, (DECK_NAME,))


def _write_folder(folder: Path, body: DemBody) -> tuple[str, ...]:
    """Make the folder of a body, write mass, tensor and directions; return all its files, the clump first."""
    texts = {
        f"{body.name}/Inertia/Mass.txt": f"{body.mass.mass:.12e}\n",
        f"{body.name}/Inertia/TOI.txt": _matrix_text(np.diag(body.mass.principal)),
        f"{body.name}/Inertia/PD.txt": _matrix_text(np.eye(3)),
    }
    for place in ("Clump", "Inertia"):
        (folder / body.name / place).mkdir(parents=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="ascii")
    return (f"{body.name}/Clump/Clump.txt", *texts)


def _matrix_text(matrix: np.ndarray) -> str:
    return "".join(",".join(f"{value:.12e}" for value in row) + "\n" for row in matrix)


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read the four files of every clump back and compare them with the manifest.

    Raises
    ------
    ExportError
        For a header (its loader would stop at it), radii that are not positive, another mass, a tensor that
        is not the avatar's, or directions other than the axes.
    """
    for item in manifest["items"]:
        spheres, mass, tensor, directions = (folder / name for name in item["files"])
        check_sphere_table(spheres, item)
        require_agreement(mass, "the mass", read_text(mass).split(), [item["mass"]])
        found = _read_matrix(tensor)
        require_agreement(tensor, "the tensor", _words(found), _words_wanted(np.diag(item["moments"])))
        check_moments(item["name"], item["mass"], list(found.diagonal()))
        require_agreement(
            directions, "the directions", _words(_read_matrix(directions)), _words_wanted(np.eye(3))
        )
    check_deck(folder / DECK_NAME, manifest)


def _read_matrix(path: Path) -> np.ndarray:
    rows = number_rows(path, read_text(path).splitlines(), 3, ",")
    if len(rows) != 3:
        raise ExportError(f"{path} has {len(rows)} rows instead of 3.")
    return rows


def _words(matrix: np.ndarray) -> list[str]:
    return [f"{value:.12e}" for value in matrix.ravel()]


def _words_wanted(matrix: np.ndarray) -> list[float]:
    return [float(value) for value in matrix.ravel()]


TARGET = Target(
    name="mercury",
    title="MercuryDPM clumps",
    geometry="clump",
    needs_density=True,
    default_unit="m",
    write=write,
    validate=validate,
    options=WITH_DECK,
    units=("m",),
)
