"""OBJ meshes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mbstudio.core.dem.formats.meshes import OPTIONS, validate_meshes, write_checked_meshes
from mbstudio.core.dem.target import Job, Target, Written

if TYPE_CHECKING:
    import trimesh


def write(job: Job) -> Written:
    """Write one ``<name>.obj`` a body."""
    return write_checked_meshes(job, "obj", _write_one)


def _write_one(mesh: trimesh.Trimesh, path: Path) -> None:
    lines = [f"o {path.stem}"]
    lines += [f"v {x:.9e} {y:.9e} {z:.9e}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


TARGET = Target(
    name="obj",
    title="OBJ meshes",
    needs_density=False,
    default_unit="m",
    write=write,
    validate=validate_meshes,
    options=OPTIONS,
)
