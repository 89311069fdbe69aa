"""Folders of meshes as parents of a style."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mbstudio.core.errors import SerializationError

if TYPE_CHECKING:
    import trimesh

MESH_SUFFIXES = (".stl", ".ply", ".obj", ".off")


def mesh_files(folder: Path) -> list[Path]:
    """Return the meshes of a folder, by name.

    Raises
    ------
    SerializationError
        If there is no such folder, or it holds no meshes.
    """
    if not folder.is_dir():
        raise SerializationError(f"{folder} is no folder: choose one that holds meshes.")
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in MESH_SUFFIXES)
    if not found:
        raise SerializationError(
            f"{folder} holds no meshes ({', '.join(MESH_SUFFIXES)}): choose another folder."
        )
    return found


def read_mesh(path: Path) -> trimesh.Trimesh:
    """Return the mesh of a file.

    Raises
    ------
    SerializationError
        If it cannot be read.
    """
    import trimesh

    try:
        return trimesh.load(path, force="mesh")  # type: ignore[return-value]
    except (ValueError, IndexError, KeyError, TypeError, OSError) as error:  # trimesh lets these through
        raise SerializationError(
            f"{path} cannot be read as a mesh ({error}): export it again, or move it away."
        ) from error
