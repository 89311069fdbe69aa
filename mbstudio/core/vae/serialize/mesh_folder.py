"""Folders and files of meshes as parents of a style."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mbstudio.core.errors import SerializationError
from mbstudio.core.meshes.bodies import OnFailure, bodies_of
from mbstudio.core.meshes.listing import find_meshes

if TYPE_CHECKING:
    import trimesh


def read_parents(
    sources: str | Path | Sequence[str | Path],
    unit: str | None = None,
    limit: int | None = None,
    on_failure: OnFailure | None = None,
) -> tuple[list[trimesh.Trimesh], list[str]]:
    """Return the bodies of mesh files and their names, cavities filled.

    Parameters
    ----------
    sources : str, Path, or sequence of them
        Files, folders of meshes, and patterns.
    unit : str, optional
        Of the coordinates, where the files do not know it.
    limit : int, optional
        At most this many bodies.
    on_failure : callable, optional
        As for `bodies_of`.

    Raises
    ------
    MeshError
        If a folder holds no meshes, or a file cannot be read.
    """
    bodies = bodies_of(find_meshes(sources), unit, on_failure=on_failure, most=limit)
    return bodies, [str(body.metadata["name"]) for body in bodies]


def read_one_body(path: Path, unit: str | None = None) -> trimesh.Trimesh:
    """Return the one body of a mesh file.

    Raises
    ------
    MeshError
        If it cannot be read.
    SerializationError
        If it holds several bodies.
    """
    bodies, _ = read_parents(path, unit)
    if len(bodies) > 1:
        raise SerializationError(f"{path} contains {len(bodies)} bodies: save the right one as its own file.")
    return bodies[0]
