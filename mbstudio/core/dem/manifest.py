"""manifest.json: what an export holds, in numbers that another program can rely on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.body import DemBody, is_finite, is_unit_quaternion
from mbstudio.core.errors import ExportError
from mbstudio.core.plain_files import PlainFileError, read_json
from mbstudio.core.units import METRES_PER_UNIT
from mbstudio.core.version import __version__

FILE_NAME = "manifest.json"
FORMAT = "mbstudio-export"
VERSION = 1


def describe_body(
    body: DemBody, density: float | None, files: Sequence[str], details: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the manifest's entry for one body: volume in unit**3, mass in kg, moments in kg m2."""
    metres = METRES_PER_UNIT[body.mass.unit]
    return {
        "name": body.name,
        "files": list(files),
        "source": {"name": body.source.name, "label": body.source.label, "control_points": body.source.n},
        "volume": body.mass.volume,
        "mass": None if density is None else body.mass.mass,
        "moments": None if density is None else (body.mass.principal * metres**2).tolist(),
        "pose": {
            "position": body.mass.com.tolist(),
            "quaternion": body.mass.quaternion.tolist(),
        },
        "details": dict(details),
    }


def make_manifest(
    target: str,
    unit: str,
    density: float | None,
    options: Mapping[str, Any],
    items: Sequence[Mapping[str, Any]],
    shared_files: Sequence[str],
    folder: Path,
) -> dict[str, Any]:
    """Return the whole manifest of the files that lie in `folder`."""
    names = [name for item in items for name in item["files"]] + list(shared_files)
    return {
        "format": FORMAT,
        "version": VERSION,
        "mbstudio": __version__,
        "target": target,
        "unit": unit,
        "density": density,
        "conventions": {
            "frame": "centre of mass at the origin, principal axes along x, y, z (moments ascending)",
            "pose": "x_source = position + R(quaternion) x; quaternion is (w, x, y, z); position in unit",
            "volume": "unit**3",
            "mass": "kg",
            "moments": "kg m2, about the centre of mass, of the avatar (not of a clump's spheres)",
            "density": "kg/m3",
        },
        "options": dict(options),
        "items": [dict(item) for item in items],
        "shared_files": list(shared_files),
        "files": {name: _digest(folder / name) for name in names},
    }


def write_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Write the manifest; a number that is not finite is an error of the program, not written as NaN."""
    text = json.dumps(manifest, indent=2, allow_nan=False)
    (folder / FILE_NAME).write_text(text + "\n", encoding="utf-8")


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read and check a manifest.

    Raises
    ------
    ExportError
        If it is missing, not JSON, of another format or a later version, or its numbers cannot be.
    """
    path = folder / FILE_NAME
    if not path.exists():
        raise ExportError(f"{path} is missing: {folder} is not an export of mbstudio.")
    try:
        manifest = read_json(path)
    except PlainFileError as error:
        raise ExportError(f"{path} cannot be read ({error}): export again.") from error
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise ExportError(f"{path} is not a manifest of mbstudio.")
    if manifest.get("version") != VERSION:
        raise ExportError(
            f"{path} has version {manifest.get('version')}, this mbstudio reads {VERSION}: export again."
        )
    try:
        _check_numbers(path, manifest)
    except (AttributeError, LookupError, OverflowError, TypeError, ValueError) as error:
        told = " ".join(str(error).split())[:200]
        raise ExportError(f"{path} has a missing or invalid entry {told}: export again.") from error
    return manifest


def files_of_earlier_export(folder: Path) -> list[str] | None:
    """Return the names that an earlier export wrote here, or None if there was none."""
    if not (folder / FILE_NAME).is_file():
        return None
    try:
        manifest = read_json(folder / FILE_NAME)
    except PlainFileError:
        return None
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        return None
    if not isinstance(manifest.get("files", {}), dict):
        return None
    return [FILE_NAME, *(str(name) for name in manifest.get("files", {}))]


def check_digests(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Raise ExportError if a file was changed or lost since it was written."""
    for name, digest in manifest["files"].items():
        path = folder / name
        if not path.is_file():
            raise ExportError(f"{path} is missing: export again.")
        if _digest(path) != digest:
            raise ExportError(f"{path} was changed after the export: export again.")


def check_moments(what: str, mass: float, moments: Sequence[float]) -> None:
    """Raise ExportError unless mass and principal moments are those of a solid body."""
    if not is_finite(mass, moments) or mass <= 0 or min(moments) <= 0:
        raise ExportError(f"{what} has a mass or moment that is not a positive number.")
    low, middle, high = sorted(moments)
    if low + middle < high * (1 - 1e-9):
        raise ExportError(
            f"{what} has moments {list(moments)} that no solid body has (the largest exceeds the sum)."
        )


def _check_numbers(path: Path, manifest: Mapping[str, Any]) -> None:
    if not isinstance(manifest["target"], str) or not isinstance(manifest["unit"], str):
        raise ValueError("'target' or 'unit'")
    if manifest["unit"] not in METRES_PER_UNIT:
        raise ExportError(f"{path} has the unknown unit '{manifest['unit']}'.")
    density = manifest["density"]
    if density is not None and not (is_finite(density) and density > 0):
        raise ExportError(f"{path} has a density of {density}.")
    for name in manifest["files"]:
        if Path(name).is_absolute() or ".." in Path(name).parts or "\\" in name:
            raise ExportError(f"{path} names '{name}', which lies outside the folder.")
    for item in manifest["items"]:
        if not (is_finite(item["volume"]) and item["volume"] > 0):
            raise ExportError(f"{path}: '{item['name']}' has a volume of {item['volume']}.")
        quaternion = np.asarray(item["pose"]["quaternion"], dtype=float)
        if not is_unit_quaternion(quaternion):
            raise ExportError(f"{path}: the quaternion of '{item['name']}' is not of length 1.")
        if not is_finite(item["pose"]["position"]):
            raise ExportError(f"{path}: the position of '{item['name']}' is not finite.")
        if density is not None:
            check_moments(f"{path}: '{item['name']}'", item["mass"], item["moments"])
            expected = density * item["volume"] * METRES_PER_UNIT[manifest["unit"]] ** 3
            if abs(item["mass"] / expected - 1) > 1e-6:
                raise ExportError(f"{path}: the mass of '{item['name']}' is not density times volume.")


def _digest(path: Path) -> str:
    return "sha256:" + hashlib.sha256(path.read_bytes()).hexdigest()
