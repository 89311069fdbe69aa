"""STL meshes, text by default: what LIGGGHTS, Rocky, EDEM and PFC read.

STL states neither unit nor sharing of vertices: the unit stands in the manifest, and the vertices
of neighbouring triangles are written from the same numbers so that readers merge them again.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.dem.formats.meshes import mesh_target
from mbstudio.core.options import Option

if TYPE_CHECKING:
    import trimesh


def _write_one(mesh: trimesh.Trimesh, path: Path, options: Mapping[str, Any]) -> None:
    (_write_binary if options["binary"] else _write_text)(mesh, path)


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


_BINARY = Option(False, "the smaller binary form, which some engines do not read")
TARGET = mesh_target("stl", _write_one, {"binary": _BINARY})
