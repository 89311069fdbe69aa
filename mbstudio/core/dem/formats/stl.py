"""STL meshes, text by default: what LIGGGHTS, Rocky, EDEM and PFC read.

STL states neither unit nor sharing of vertices: the unit stands in the manifest, and the vertices
of neighbouring triangles are written from the same numbers so that readers merge them again.
"""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from mbstudio.core.dem.formats.meshes import OPTIONS, validate_meshes, write_checked_meshes
from mbstudio.core.dem.target import Job, Option, Target, Written

if TYPE_CHECKING:
    import trimesh


def write(job: Job) -> Written:
    """Write one ``<name>.stl`` a body."""
    write_one = _write_binary if job.options["binary"] else _write_text
    return write_checked_meshes(job, "stl", write_one)


def _write_text(mesh: trimesh.Trimesh, path: Path) -> None:
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    rows = np.concatenate([normals[:, None], corners], axis=1).reshape(-1, 12)
    facet = (
        "facet normal %.9e %.9e %.9e\nouter loop\nvertex %.9e %.9e %.9e\n"
        "vertex %.9e %.9e %.9e\nvertex %.9e %.9e %.9e\nendloop\nendfacet"
    )
    np.savetxt(
        path, rows, fmt=facet, header=f"solid {path.stem}", footer=f"endsolid {path.stem}", comments=""
    )


def _write_binary(mesh: trimesh.Trimesh, path: Path) -> None:
    from trimesh.exchange.stl import export_stl

    path.write_bytes(export_stl(mesh))


TARGET = Target(
    name="stl",
    title="STL meshes",
    needs_density=False,
    default_unit="m",
    write=write,
    validate=validate_meshes,
    options=MappingProxyType(
        {**OPTIONS, "binary": Option(False, "the smaller binary form, which some engines do not read")}
    ),
)
