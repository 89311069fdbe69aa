"""MechSys polyhedra: vertices, edges and faces of a coarse closed mesh of each avatar, as JSON.

``<name>.json`` has ``verts`` (each ``{"c": [x, y, z]}``), ``edges`` (each ``{"verts": [i, j]}``) and
``faces`` (each ``{"verts": [i, j, k]}``), faces turning outwards. MechSys works through every pair of
edges that meet, so the mesh is kept coarse. ``settle.cpp`` loads them and lets some of each fall into a box.

References
----------
MechSys, lib/dem/domain.h: ``AddFromJson(tag, file, R, rho, scale)``, which rounds every edge by R and weighs
the polyhedron itself.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.dem.formats.clump_files import POURED
from mbstudio.core.dem.formats.mechsys.deck import DECK_NAME, check_deck, settling_deck
from mbstudio.core.dem.formats.meshes import ERROR, check_mesh, write_meshes
from mbstudio.core.dem.reading_back import read_text
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import ExportError
from mbstudio.core.options import Option

if TYPE_CHECKING:
    import trimesh


def write(job: Job) -> Written:
    """Write one ``<name>.json`` a body, and a program for all."""
    written = write_meshes(job, "json", _write_polyhedron)
    reach = max(_reach_of(job.folder / files[0]) for files in written.item_files)
    (job.folder / DECK_NAME).write_text(settling_deck(job, reach), encoding="ascii")
    return Written(written.item_files, written.item_details, (DECK_NAME,))


def _reach_of(path: Path) -> float:
    record = json.loads(path.read_text(encoding="ascii"))
    return float(np.linalg.norm([entry["c"] for entry in record["verts"]], axis=1).max())


def _write_polyhedron(mesh: trimesh.Trimesh, path: Path, _options: Mapping[str, Any]) -> None:
    record = {
        "verts": [{"c": [float(value) for value in vertex]} for vertex in np.asarray(mesh.vertices)],
        "edges": [{"verts": [int(i), int(j)]} for i, j in np.asarray(mesh.edges_unique)],
        "faces": [{"verts": [int(i) for i in face]} for face in np.asarray(mesh.faces)],
    }
    path.write_text(json.dumps(record, allow_nan=False) + "\n", encoding="ascii")


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read every polyhedron back: closed, outward, of the avatar's volume, centred, each edge once.

    Raises
    ------
    ExportError
        Naming the file and what is wrong with it.
    """
    for item in manifest["items"]:
        _check_polyhedron(folder / item["files"][0], item)
    check_deck(folder / DECK_NAME, manifest)


def _check_polyhedron(path: Path, item: Mapping[str, Any]) -> None:
    import trimesh

    try:
        record = json.loads(read_text(path))
        vertices = np.array([entry["c"] for entry in record["verts"]], dtype=float).reshape(-1, 3)
        edges = np.array([entry["verts"] for entry in record["edges"]], dtype=int).reshape(-1, 2)
        faces = np.array([entry["verts"] for entry in record["faces"]], dtype=int).reshape(-1, 3)
    except (ValueError, KeyError, TypeError) as error:
        raise ExportError(f"{path} does not contain a polyhedron ({error!r}).") from error
    numbers = np.concatenate([edges.ravel(), faces.ravel()])
    if not len(numbers) or numbers.min() < 0 or numbers.max() >= len(vertices):
        raise ExportError(f"{path} has edges or faces that refer to missing vertices.")
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    check_mesh(path, mesh, item)
    listed = {tuple(sorted(edge)) for edge in edges.tolist()}
    real = {tuple(edge) for edge in np.sort(mesh.edges_unique, axis=1).tolist()}
    if len(listed) != len(edges) or listed != real:
        raise ExportError(f"{path} does not list every edge of its faces once.")


TARGET = Target(
    name="mechsys",
    title="MechSys polyhedra",
    geometry="mesh",
    needs_density=False,
    default_unit=None,
    write=write,
    validate=validate,
    options=MappingProxyType(
        {
            "cells": Option(10, "edges along the longest side of each grain: MechSys wants few", 6, 60),
            "error": ERROR,
            "poured": POURED,
        }
    ),
)
