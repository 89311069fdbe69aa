"""PLY meshes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mbstudio.core.dem.formats.meshes import OPTIONS, validate_meshes, write_checked_meshes
from mbstudio.core.dem.target import Job, Target, Written

if TYPE_CHECKING:
    import trimesh


def write(job: Job) -> Written:
    """Write one ``<name>.ply`` a body."""
    return write_checked_meshes(job, "ply", _write_one)


def _write_one(mesh: trimesh.Trimesh, path: Path) -> None:
    from trimesh.exchange.ply import export_ply

    path.write_bytes(export_ply(mesh))


TARGET = Target(
    name="ply",
    title="PLY meshes",
    needs_density=False,
    default_unit="m",
    write=write,
    validate=validate_meshes,
    options=OPTIONS,
)
