"""Mesh files by name, folder or pattern."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from pathlib import Path

from mbstudio.core.errors import MeshError
from mbstudio.core.meshes.endings import MESH_ENDINGS
from mbstudio.core.meshes.reading import is_mesh_file

_SLICES = (".tif", ".tiff", ".png", ".bmp", ".jpg", ".jpeg", ".dcm")


def means_meshes(source: Path) -> bool:
    """Return whether a file, folder or pattern stands for meshes; slices with a stray mesh do not."""
    if source.is_dir():
        endings = [path.suffix.lower() for path in source.iterdir() if path.is_file()]
        meshes = sum(ending in MESH_ENDINGS for ending in endings)
        return meshes > sum(ending in _SLICES for ending in endings)
    return is_mesh_file(source) or (not source.exists() and glob.has_magic(str(source)))


def find_meshes(sources: str | Path | Sequence[str | Path]) -> list[Path]:
    """Return the mesh files that are meant, each once.

    Parameters
    ----------
    sources : str, Path, or sequence of them
        Files as they are; of folders their meshes, by name; patterns with ``*``, ``?`` or ``[...]``.

    Raises
    ------
    MeshError
        If a folder or pattern holds no meshes.
    """
    found: list[Path] = []
    for source in [sources] if isinstance(sources, str | Path) else sources:
        path = Path(source)
        if path.is_dir():
            found += meshes_of(path)
        elif not path.exists() and glob.has_magic(str(source)):
            matched = sorted(Path(name) for name in glob.iglob(str(source), recursive=True))  # noqa: PTH207
            matched = [name for name in matched if name.is_file() and is_mesh_file(name)]
            if not matched:
                raise MeshError(f"{source} matches no meshes ({', '.join(MESH_ENDINGS)}): check the pattern.")
            found += matched
        else:
            found.append(path)
    return list(dict.fromkeys(found))


def meshes_of(folder: Path) -> list[Path]:
    """Return the meshes of a folder, by name.

    Raises
    ------
    MeshError
        If there is no such folder, or it holds no meshes.
    """
    if not folder.is_dir():
        raise MeshError(f"{folder} is not a folder: choose one that contains meshes.")
    found = sorted(path for path in folder.iterdir() if path.is_file() and is_mesh_file(path))
    if not found:
        raise MeshError(f"{folder} contains no meshes ({', '.join(MESH_ENDINGS)}): choose another folder.")
    return found
