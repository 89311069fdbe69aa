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

from mbstudio.core.dem.body import DemBody, is_finite
from mbstudio.core.dem.clump import Clump, sphere_clump
from mbstudio.core.dem.liggghts_deck import DECK_NAME, settling_deck
from mbstudio.core.dem.manifest import check_moments
from mbstudio.core.dem.target import Job, Option, Target, Written
from mbstudio.core.errors import ExportError
from mbstudio.core.units import METRES_PER_UNIT


def write(job: Job) -> Written:
    """Write a sphere file and a template command for each body, and one deck for all."""
    files, details, clumps = [], [], []
    for index, body in enumerate(job.bodies):
        job.progress(index / len(job.bodies), f"Fitting spheres to {body.name}")
        clump = sphere_clump(body.avatar, int(job.options["spheres"]))
        clumps.append(clump)
        spheres, template = f"{body.name}.multisphere", f"{body.name}.template"
        _write_spheres(job.folder / spheres, clump)
        command = template_command(body, spheres, len(clump.radii), index + 1, int(job.options["ntry"]))
        (job.folder / template).write_text(command, encoding="ascii")
        files.append((spheres, template))
        details.append(_describe(clump, body))
    deck = settling_deck(job.bodies, clumps, [entry[1] for entry in files], int(job.options["poured"]))
    (job.folder / DECK_NAME).write_text(deck, encoding="ascii")
    return Written(files, details, (DECK_NAME,))


def template_command(body: DemBody, spheres_file: str, nspheres: int, number: int, ntry: int) -> str:
    """Return the ``fix particletemplate/multisphere`` command of one body: SI units, principal axes."""
    metres = METRES_PER_UNIT[body.mass.unit]
    ixx, iyy, izz = (f"{moment:.9e}" for moment in body.mass.principal * metres**2)
    return (
        f"# {body.name}: mass in kg, inertia tensor in kg m2 as Ixx Ixy Ixz Iyy Iyz Izz\n"
        f"fix template{number} all particletemplate/multisphere {prime_above(15485863 + 1000 * number)} &\n"
        f"    atom_type 1 density constant {body.mass.density:.9g} &\n"
        f"    nspheres {nspheres} ntry {ntry} spheres file {spheres_file} scale {metres:.9g} &\n"
        f"    mass {body.mass.mass:.9e} inertia_tensor {ixx} 0 0 {iyy} 0 {izz} use_volume type {number}\n"
    )


def _write_spheres(path: Path, clump: Clump) -> None:
    rows = np.column_stack([clump.centers, clump.radii])
    # No comment, no empty line: run with '-screen none', LIGGGHTS 3.8.0 crashes when it skips one.
    np.savetxt(path, rows, fmt="%.9e")


def _describe(clump: Clump, body: DemBody) -> dict[str, Any]:
    diameter = (6 * body.mass.volume / np.pi) ** (1 / 3)
    return {
        "spheres": len(clump.radii),
        "smallest_radius": float(clump.radii.min()),
        "largest_radius": float(clump.radii.max()),
        "iou": clump.iou,
        "volume_ratio": clump.volume_ratio,
        "mean_distance": clump.mean_distance,
        "hausdorff": clump.hausdorff,
        "hausdorff_over_nominal_diameter": clump.hausdorff / diameter,
    }


def prime_above(number: int) -> int:
    """Return the smallest prime above a number: LIGGGHTS wants prime seeds."""
    candidate = number + 1 + number % 2
    while any(candidate % divisor == 0 for divisor in range(3, int(candidate**0.5) + 1, 2)):
        candidate += 2
    return candidate


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
        _check_spheres(folder / spheres, rows, item)
        _check_template(folder / template, spheres, len(rows), number, item, manifest)
    deck = folder / DECK_NAME
    included = [line.split()[1] for line in _lines(deck) if line.startswith("include ")]
    if included != [item["files"][1] for item in manifest["items"]]:
        raise ExportError(f"{deck} does not include the templates of the manifest, each once and in order.")


def read_spheres(path: Path) -> np.ndarray:
    """Return the rows ``x y z r`` of a sphere file; ExportError for anything that is no number."""
    rows = []
    for line in _text(path).splitlines():
        try:
            row = [float(part) for part in line.split()]
        except ValueError:
            row = []
        if len(row) != 4:
            raise ExportError(f"{path} has the line '{line}', which is not four numbers.")
        rows.append(row)
    return np.array(rows, dtype=float).reshape(-1, 4)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise ExportError(f"{path} cannot be read ({error}).") from error


def _lines(path: Path) -> list[str]:
    return [line.strip() for line in _text(path).splitlines() if line.strip()]


def _check_spheres(path: Path, rows: np.ndarray, item: Mapping[str, Any]) -> None:
    if len(rows) < 2:
        raise ExportError(f"{path} has {len(rows)} spheres; LIGGGHTS needs at least 2.")
    if len(rows) != item["details"]["spheres"]:
        raise ExportError(f"{path} has {len(rows)} spheres; the manifest says {item['details']['spheres']}.")
    if not is_finite(rows) or rows[:, 3].min() <= 0:
        raise ExportError(f"{path} has numbers that are not finite, or a radius that is not positive.")
    reach = (np.linalg.norm(rows[:, :3], axis=1) + rows[:, 3]).max()
    size = (6 * item["volume"] / np.pi) ** (1 / 3)
    smallest, largest = rows[:, 3].min(), rows[:, 3].max()
    stated = item["details"]["smallest_radius"], item["details"]["largest_radius"]
    if not 0.4 * size < reach < 20 * size or not np.allclose((smallest, largest), stated, rtol=1e-6):
        raise ExportError(f"{path} holds spheres of another size than the manifest says.")


def _check_template(
    path: Path, spheres: str, count: int, number: int, item: Mapping[str, Any], manifest: Mapping[str, Any]
) -> None:
    words = " ".join(line.removesuffix("&") for line in _lines(path) if not line.startswith("#")).split()
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
        if not _agree(values, wanted):
            raise ExportError(
                f"{path} has '{keyword}' {' '.join(values)}; the manifest says {' '.join(map(str, wanted))}."
            )
    if "use_volume" not in found:
        raise ExportError(
            f"{path} lacks 'use_volume': LIGGGHTS would not know which density belongs to the mass."
        )
    if not _agree(found.get("ntry", ["0"]), [float(manifest["options"]["ntry"])]):
        raise ExportError(f"{path} has another 'ntry' than the manifest.")
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


def _agree(values: Sequence[str], wanted: Sequence[str | float]) -> bool:
    if len(values) != len(wanted):
        return False
    for value, target in zip(values, wanted, strict=True):
        if isinstance(target, str):
            if value != target:
                return False
            continue
        try:
            number = float(value)
        except ValueError:
            return False
        if not abs(number - target) <= 1e-7 * abs(target):
            return False
    return True


TARGET = Target(
    name="liggghts",
    title="LIGGGHTS multisphere templates",
    needs_density=True,
    default_unit="m",
    write=write,
    validate=validate,
    options=MappingProxyType(
        {
            "spheres": Option(40, "spheres in each clump", 2, 2000),
            "poured": Option(10, "particles that the example deck pours", 1, 100000),
            "ntry": Option(
                200000, "Monte Carlo points of LIGGGHTS for the clump's volume and centre", 1000, 10**8
            ),
        }
    ),
)
