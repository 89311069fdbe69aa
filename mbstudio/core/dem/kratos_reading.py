"""Reading the example case of a Kratos export back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from mbstudio.core.dem.kratos_case import CASE_FILES, MATERIALS_NAME, PARAMETERS_NAME, SCRIPT, SCRIPT_NAME
from mbstudio.core.dem.pouring import check_count
from mbstudio.core.dem.reading_back import must_agree, number_rows, read_text
from mbstudio.core.dem.settling import GRAVITY
from mbstudio.core.errors import ExportError

_CLUSTERS, _BOX = CASE_FILES[3:]


def check_case(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Raise ExportError unless materials, parameters, clusters, box and script are those of the manifest.

    Raises
    ------
    ExportError
        For another density, a material without its cluster, gravity upwards or none, a time step that is not
        positive, clusters of a kind that is not there, turns that are no rotations, a box that is not whole,
        or another script.
    """
    _check_materials(folder / MATERIALS_NAME, manifest)
    _check_parameters(folder / PARAMETERS_NAME)
    _check_clusters(folder / _CLUSTERS, manifest)
    path = folder / _BOX
    text = _balanced(path)
    corners, faces = _block(path, text, "Nodes", 4), _block(path, text, "Conditions RigidFace3D3N", 5)
    if len(corners) != 8 or len(faces) != 10:
        raise ExportError(f"{path} is no box of a floor and four walls.")
    if read_text(folder / SCRIPT_NAME) != SCRIPT:
        raise ExportError(f"{folder / SCRIPT_NAME} is not the script that mbstudio writes: export again.")


def _json(path: Path) -> Any:
    try:
        return json.loads(read_text(path))
    except ValueError as error:
        raise ExportError(f"{path} cannot be read ({error}).") from error


def _check_materials(path: Path, manifest: Mapping[str, Any]) -> None:
    content = _json(path)
    try:
        found = [
            (str(entry["Variables"]["CLUSTER_FILE_NAME"]), str(entry["Variables"]["PARTICLE_DENSITY"]))
            for entry in content["materials"]
            if "CLUSTER_FILE_NAME" in entry["Variables"]
        ]
    except (KeyError, TypeError) as error:
        raise ExportError(f"{path} lacks {error} or holds something else there.") from error
    for item in manifest["items"]:
        if item["files"][0] not in [file for file, _ in found]:
            raise ExportError(f"{path} does not name {item['files'][0]}.")
    if len(found) != len(manifest["items"]):
        raise ExportError(f"{path} has {len(found)} clusters; the manifest says {len(manifest['items'])}.")
    for _, density in found:
        must_agree(path, "'PARTICLE_DENSITY'", [density], [manifest["density"]])


def _check_parameters(path: Path) -> None:
    content = _json(path)
    try:
        gravity, step, end = (float(content[name]) for name in ("GravityZ", "MaxTimeStep", "FinalTime"))
        materials = content["solver_settings"]["material_import_settings"]["materials_filename"]
    except (KeyError, TypeError, ValueError) as error:
        raise ExportError(f"{path} lacks {error} or holds something else there.") from error
    must_agree(path, "'GravityZ'", [str(gravity)], [-GRAVITY])
    must_agree(path, "'materials_filename'", [str(materials)], [MATERIALS_NAME])
    if not 0 < step < end:
        raise ExportError(f"{path} has a time step of {step:g} s for {end:g} s.")


def _check_clusters(path: Path, manifest: Mapping[str, Any]) -> None:
    text = _balanced(path)
    places = _block(path, text, "Nodes", 4)
    elements = _block(path, text, "Elements Cluster3D", 3)
    turned = text.replace("[4] (", "").replace(")", "").replace(",", " ")
    turns = _block(path, turned, "NodalData ORIENTATION", 6)
    for rows in (places, elements, turns):
        check_count(path, len(rows), manifest)
    kinds = np.arange(len(elements)) % len(manifest["items"]) + 1
    if not np.array_equal(elements[:, 1], kinds):
        raise ExportError(f"{path} has clusters of other kinds than the manifest says.")
    if not np.allclose(np.linalg.norm(turns[:, 2:], axis=1), 1.0, atol=1e-6):
        raise ExportError(f"{path} has orientations that are not of length 1.")


def _balanced(path: Path) -> str:
    """Return the text of an mdpa in which every block that begins also ends."""
    text = read_text(path)
    waiting: list[str] = []
    for words in (line.split() for line in text.splitlines()):
        if words[:1] == ["Begin"]:
            waiting.append(words[1])
        elif words[:1] == ["End"] and (not waiting or waiting.pop() != words[1]):
            raise ExportError(f"{path} ends '{words[1]}', which has not begun.")
    if waiting:
        raise ExportError(f"{path} does not end '{waiting[-1]}'.")
    return text


def _block(path: Path, text: str, head: str, columns: int) -> Float[np.ndarray, "rows columns"]:
    _, begun, rest = text.partition(f"\nBegin {head}\n")
    if not begun:
        raise ExportError(f"{path} lacks 'Begin {head}'.")
    return number_rows(path, rest.partition("\nEnd ")[0].splitlines(), columns)
