"""OBJ meshes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbstudio.core.dem.formats.meshes import mesh_target

if TYPE_CHECKING:
    import trimesh


def _write_one(mesh: trimesh.Trimesh, path: Path, _options: Mapping[str, Any]) -> None:
    lines = [f"o {path.stem}"]
    lines += [f"v {x:.9e} {y:.9e} {z:.9e}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


TARGET = mesh_target("obj", _write_one)
