"""Metaball files: control points and weights, as CSV for engines and as JSON with everything else.

``<name>.csv`` has the header ``x,y,z,k`` and one row a control point, in the principal frame
with the centre of mass at the origin, lengths in the unit of the export, k in that unit squared
(ComFluSoM's ``AddMetaball`` takes these numbers as they are). ``<name>.json`` holds the same with
unit, pose and scale. ``check_shapes.py`` is an example that loads the tables with NumPy alone.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from mbstudio.core.dem.body import DemBody, is_finite, is_unit_quaternion
from mbstudio.core.dem.formats.shape_checks import METABALL_SCRIPT, check_script, write_script
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import AvatarError, ExportError, UnitError
from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.plain_files import PlainFileError, read_json, read_plain_text
from mbstudio.core.units import METRES_PER_UNIT, parse_unit

FORMAT = "mbstudio-metaball"
VERSION = 1
_HEADER = "x,y,z,k"


def write(job: Job) -> Written:
    """Write ``<name>.csv`` and ``<name>.json`` for each body."""
    files, details = [], []
    for index, body in enumerate(job.bodies):
        job.progress(index / len(job.bodies), f"Writing {body.name}")
        table, record = f"{body.name}.csv", f"{body.name}.json"
        write_table(job.folder / table, body.avatar)
        text = json.dumps(_record_of(body), indent=1, allow_nan=False)
        (job.folder / record).write_text(text + "\n", encoding="utf-8")
        files.append((table, record))
        details.append({"control_points": body.avatar.n})
    return Written(files, details, (write_script(job.folder, METABALL_SCRIPT),))


def write_table(path: Path, avatar: Avatar) -> None:
    """Write the rows x, y, z, k of an avatar after a header line."""
    rows = np.column_stack([avatar.centers, avatar.weights])
    np.savetxt(path, rows, fmt="%.17g", delimiter=",", header=_HEADER, comments="")


def _record_of(body: DemBody) -> dict[str, Any]:
    mass = body.mass
    return {
        "format": FORMAT,
        "version": VERSION,
        "field": "f(x) = sum k_i / |x - x_i|**2, the solid is f >= 1",
        "unit": mass.unit,
        "scale": {
            "metres_per_unit": METRES_PER_UNIT[mass.unit],
            "nominal_diameter": nominal_diameter(mass.volume),
        },
        "pose": {"position": mass.com.tolist(), "quaternion": mass.quaternion.tolist()},
        "name": body.source.name,
        "label": body.source.label,
        "centers": body.avatar.centers.tolist(),
        "weights": body.avatar.weights.tolist(),
    }


def read_metaball(path: str | Path, *, frame: Literal["source", "principal"] = "source") -> Avatar:
    """Read an avatar back from its JSON file, or from the CSV file beside it.

    Parameters
    ----------
    path : path
    frame : {'source', 'principal'}
        'source' puts the avatar back where it was fitted (over its scan); 'principal' leaves it as
        the file has it: centre of mass at the origin, principal axes.

    Returns
    -------
    Avatar
        In the unit of the file.

    Raises
    ------
    ExportError
        If the file is missing, not readable, of another format, or its numbers make no metaball.
    """
    path = Path(path)
    record = _read_record(path.with_suffix(".json"))
    try:
        unit = parse_unit(record["unit"])
        centers = np.asarray(record["centers"], dtype=float)
        weights = np.asarray(record["weights"], dtype=float)
        position = np.asarray(record["pose"]["position"], dtype=float).reshape(3)
        w, x, y, z = (float(part) for part in record["pose"]["quaternion"])
        name, label = record["name"], record["label"]
        if not isinstance(name, str) or not (label is None or type(label) is int):
            raise ValueError("'name' or 'label'")
        if centers.ndim != 2 or centers.shape[1] != 3 or not is_finite(centers):
            raise ValueError("'centers'")
    except (KeyError, OverflowError, TypeError, UnitError, ValueError) as error:
        told = " ".join(str(error).split())[:200]
        raise ExportError(f"{path.with_suffix('.json')} has a missing or invalid entry {told}.") from error
    if not is_unit_quaternion([w, x, y, z]) or not is_finite(position):
        raise ExportError(f"{path.with_suffix('.json')} has a pose that is not a rotation and a position.")
    if path.suffix.lower() == ".csv":
        table = read_table(path)
        centers, weights = table[:, :3], table[:, 3]
    if frame == "source":
        centers = centers @ Rotation.from_quat([x, y, z, w]).as_matrix().T + position
    try:
        return Avatar(centers, weights, unit, label=label, name=name)
    except AvatarError as error:
        raise ExportError(f"{path} does not contain a metaball: {error}") from error


def _read_record(path: Path) -> dict[str, Any]:
    try:
        record = read_json(path)
    except PlainFileError as error:
        raise ExportError(f"{path} cannot be read ({error}).") from error
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        raise ExportError(f"{path} is not a metaball file of mbstudio.")
    if record.get("version") != VERSION:
        raise ExportError(f"{path} has version {record.get('version')}; this mbstudio reads {VERSION}.")
    return record


def read_table(path: Path) -> Float[np.ndarray, "n 4"]:
    """Return the rows x, y, z, k of a table of control points; ExportError if it is none."""
    try:
        header, *lines = read_plain_text(path).splitlines() or [""]
        table = np.array([[float(cell) for cell in line.split(",")] for line in lines], dtype=float)
    except PlainFileError as error:
        raise ExportError(f"{path} cannot be read ({error}).") from error
    except ValueError as error:
        told = " ".join(str(error).split())[:200]
        raise ExportError(f"{path} is no table of control points ({told}).") from error
    if header != _HEADER:
        raise ExportError(f"{path} has the header '{header}' instead of '{_HEADER}'.")
    if table.ndim != 2 or table.shape[1] != 4 or not np.isfinite(table).all() or table[:, 3].min() <= 0:
        raise ExportError(f"{path} must have rows of four finite numbers x, y, z, k with k > 0.")
    return table


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read both files of every avatar back and compare them with each other and the manifest."""
    for item in manifest["items"]:
        table, record = (folder / name for name in item["files"])
        from_table = read_metaball(table, frame="principal")
        from_record = read_metaball(record, frame="principal")
        same = from_table.n == from_record.n == item["details"]["control_points"] and np.allclose(
            np.column_stack([from_table.centers, from_table.weights]),
            np.column_stack([from_record.centers, from_record.weights]),
            rtol=1e-12,
            atol=0,
        )
        if not same:
            raise ExportError(f"{table} and {record.name} do not hold the same control points.")
        if from_record.unit != manifest["unit"]:
            raise ExportError(f"{record} is in {from_record.unit}, the manifest in {manifest['unit']}.")
        check_body(table, from_table, item)
    check_script(folder, METABALL_SCRIPT)


def check_body(path: Path, avatar: Avatar, item: Mapping[str, Any]) -> None:
    """Raise ExportError unless an avatar has the volume that the manifest says, centred on the origin."""
    from mbstudio.core.metrics.mass import mass_properties

    found = mass_properties(avatar, 1.0)
    size = item["volume"] ** (1 / 3)
    if abs(found.volume / item["volume"] - 1) > 1e-3 or np.abs(found.com).max() > 1e-3 * size:
        raise ExportError(f"{path} is not the avatar that the manifest describes (volume or centre of mass).")


TARGET = Target(
    name="metaball",
    title="Metaball control points (CSV and JSON)",
    geometry="metaball",
    needs_density=False,
    default_unit=None,
    write=write,
    validate=validate,
)
