"""Wavefront OBJ: positions and faces; textures, normals and material files are never needed for a shape."""

from __future__ import annotations

import numpy as np

from mbstudio.core.errors import MeshError
from mbstudio.core.meshes.triangles import MeshData, numbers_from, triangulate


def read_obj(data: bytes, source: str) -> MeshData:
    """Return the triangles of an OBJ file; polygons are split, groups and materials joined.

    Raises
    ------
    MeshError
        If a face names a vertex that is not there, or a number is none.
    """
    points: list[bytes] = []
    sizes: list[int] = []
    corners: list[int] = []
    parts: list[int] = []
    count = part = 0
    if b"\\\n" in data or b"\\\r\n" in data:
        data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    for number, line in enumerate(data.splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        if words[0] == b"v":
            if len(words) < 4:
                raise MeshError(f"{source} is damaged: line {number} is a vertex without three coordinates.")
            points += words[1:4]
            count += 1
        elif words[0] == b"f":
            named = _corners(words[1:], count, number, source)
            sizes.append(len(named))
            corners += named
            parts.append(part)
        elif words[0] == b"o":
            part += 1
    vertices = numbers_from(points, source, "a coordinate").reshape(-1, 3)
    faces, polygon = triangulate(vertices, np.array(sizes, np.int64), np.array(corners, np.int64), source)
    return MeshData(vertices, faces, np.array(parts, np.int64)[polygon])


def _corners(words: list[bytes], count: int, number: int, source: str) -> list[int]:
    """Return rows of vertices of a face as in ``1/4/2 2/5/2 -1``; negative numbers count from the last."""
    found = []
    for word in words:
        if word.startswith(b"#"):
            break
        try:
            row = int(word.partition(b"/")[0])
        except ValueError:
            raise MeshError(
                f"{source} is damaged: line {number} is a face with the corner "
                f"'{word[:30].decode('latin-1')}': export it again."
            ) from None
        if row == 0:
            raise MeshError(
                f"{source} is damaged: line {number} refers to vertex 0, but OBJ counts from 1: export it "
                "again."
            )
        found.append(row - 1 if row > 0 else count + row)
    return found
