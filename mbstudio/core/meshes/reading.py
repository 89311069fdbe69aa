"""Mesh files of every kind: what a file holds decides how it is read, and no other file is opened."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path, PureWindowsPath
from urllib.parse import unquote

import numpy as np

from mbstudio.core.errors import MeshError
from mbstudio.core.meshes.endings import MESH_ENDINGS
from mbstudio.core.meshes.readers.gltf import read_gltf
from mbstudio.core.meshes.readers.obj import read_obj
from mbstudio.core.meshes.readers.off import is_off, read_off
from mbstudio.core.meshes.readers.ply import read_ply
from mbstudio.core.meshes.readers.stl import read_stl
from mbstudio.core.meshes.readers.three_mf import read_three_mf
from mbstudio.core.meshes.triangles import MeshData

LARGEST_FILE = 1 << 32
"""Bytes of a file that are read at all."""

_READERS: dict[str, Callable[[bytes, str], MeshData]] = {
    "STL": read_stl,
    "PLY": read_ply,
    "OBJ": read_obj,
    "OFF": read_off,
    "3MF": read_three_mf,
}
_BREACHES = (
    ValueError, IndexError, KeyError, TypeError, AttributeError, ArithmeticError, EOFError, RecursionError,
    struct.error, zlib.error, NotImplementedError,
)  # fmt: skip


def is_mesh_file(path: Path) -> bool:
    """Return whether a file is a surface mesh, by its ending."""
    return path.suffix.lower() in MESH_ENDINGS


def read_mesh_data(path: Path) -> MeshData:
    """Return the triangles of a mesh file.

    Raises
    ------
    MeshError
        If there is no such file, it is of no known format, too large, damaged, or holds no triangles.
    """
    data = _bytes_of(path)
    source = str(path)
    known = _format_of(path, data)
    try:
        with np.errstate(all="ignore"):  # what is not finite is refused by name, once it is known where
            if known == "glTF":
                found = read_gltf(data, source, lambda name: _sidecar(path, name))
            else:
                found = _READERS[known](data, source)
    except _BREACHES as error:
        raise MeshError(
            f"{path} breaks the rules of {known} ({type(error).__name__}: {error}): export it again, "
            "for example as binary STL or PLY."
        ) from error
    if not len(found.faces):
        if len(found.vertices):
            raise MeshError(
                f"{path} contains {len(found.vertices):,} points but no triangles between them: make a "
                "closed surface of them first, for example in MeshLab with Filters > Remeshing > Screened "
                "Poisson."
            )
        raise MeshError(f"{path} contains no triangles: export the grain's surface again.")
    return found


def _bytes_of(path: Path) -> bytes:
    if path.is_dir():
        raise MeshError(f"{path} is a folder: name a mesh file in it.")
    if not path.is_file():
        raise MeshError(f"{path} does not exist: check the name and the folder.")
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise MeshError(
                f"{path} has {size / 2**30:.1f} GiB, more than {LARGEST_FILE >> 30}: "
                "reduce its triangles first."
            )
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(f"{path} cannot be opened: {error.strerror or error}.") from error
    if not data:
        raise MeshError(f"{path} is empty: it has 0 bytes; copy or export it again.")
    return data


def _format_of(path: Path, data: bytes) -> str:
    """Return the format that a file is of: by its first bytes where they tell, else by its ending."""
    head = data[:64].lstrip(b"\xef\xbb\xbf \t\r\n")
    ending = path.suffix.lower()
    if data[:4] == b"glTF":
        return "glTF"
    if data[:4] == b"PK\x03\x04":
        return "3MF"
    if data[:4] in (b"ply\n", b"ply\r"):
        return "PLY"
    if is_off(data):
        return "OFF"
    if data[:2] == b"\x1f\x8b":
        raise MeshError(f"{path} is packed with gzip: unpack it first.")
    if head[:9].lower() == b"<!doctype" or head[:5].lower() == b"<html":
        raise MeshError(f"{path} is a web page, not a mesh: download the file itself.")
    if head.startswith(b"version https://git-lfs"):
        raise MeshError(f"{path} is a pointer of Git LFS, not the mesh itself: fetch it with 'git lfs pull'.")
    known = {".stl": "STL", ".obj": "OBJ", ".ply": "PLY", ".off": "OFF", ".3mf": "3MF"}
    if ending in (".glb", ".gltf"):
        return "glTF"
    if ending in known:
        return known[ending]
    raise MeshError(f"{path} is not a mesh format that mbstudio reads: use one of {', '.join(MESH_ENDINGS)}.")


def _sidecar(path: Path, name: str) -> bytes:
    """Return the bytes of the file that a mesh names beside itself; any other is refused."""
    plain = unquote(name)
    beside = PureWindowsPath(plain)  # knows drives and both slashes
    if (
        ":" in plain
        or "\0" in plain
        or beside.drive
        or beside.root
        or beside.name != plain
        or plain in ("", "..", ".")
    ):
        raise MeshError(
            f"{path} keeps its triangles in '{plain[:80]}', which is not a file in the same folder: "
            "export it as GLB, which holds everything in one file."
        )
    found = path.parent / plain
    if found.resolve().parent != path.parent.resolve():
        raise MeshError(
            f"{path} keeps its triangles in '{plain[:80]}', a link out of its folder: copy the file."
        )
    if not found.is_file():
        raise MeshError(f"{path} needs '{plain[:80]}', which is missing: copy it into the same folder.")
    return _bytes_of(found)
