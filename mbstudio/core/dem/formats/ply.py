"""PLY meshes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbstudio.core.dem.formats.meshes import mesh_target

if TYPE_CHECKING:
    import trimesh


def _write_one(mesh: trimesh.Trimesh, path: Path, _options: Mapping[str, Any]) -> None:
    from trimesh.exchange.ply import export_ply

    path.write_bytes(export_ply(mesh))


TARGET = mesh_target("ply", _write_one)
