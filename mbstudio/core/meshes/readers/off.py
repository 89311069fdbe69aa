"""OFF: vertices and polygons as text, with or without colours and normals."""

from __future__ import annotations

import re

import numpy as np

from mbstudio.core.errors import MeshError
from mbstudio.core.meshes.triangles import MeshData, numbers_from, triangulate

_HEADER = re.compile(rb"^(ST)?(C)?(N)?(4)?(n)?OFF\b")


def is_off(data: bytes) -> bool:
    """Return whether the file begins as OFF does."""
    return bool(_HEADER.match(data[:64].lstrip(b"\xef\xbb\xbf \t\r\n")))


def read_off(data: bytes, source: str) -> MeshData:
    """Return the triangles of an OFF file.

    Raises
    ------
    MeshError
        If it is binary or of another dimension, is cut off, or a number is none.
    """
    lines = [line.split(b"#", 1)[0].split() for line in data.lstrip(b"\xef\xbb\xbf").splitlines()]
    lines = [words for words in lines if words]
    head = _HEADER.match(lines[0][0]) if lines else None
    if head is None or head.end() != len(lines[0][0]):
        raise MeshError(f"{source} is not an OFF file: it does not begin with the word OFF.")
    if lines[0][1:2] == [b"BINARY"]:
        raise MeshError(f"{source} is a binary OFF file, which is not read: export it as text, or as PLY.")
    if head[4] or head[5]:
        raise MeshError(f"{source} contains points that are not three-dimensional: export it as plain OFF.")
    lines = ([lines[0][1:]] if len(lines[0]) > 1 else []) + lines[1:]
    try:
        vertex_count, face_count = int(lines[0][0]), int(lines[0][1])
    except (IndexError, ValueError):
        raise MeshError(
            f"{source} is damaged: its numbers of vertices and faces are missing: export it again."
        ) from None
    rows = lines[1:]
    if min(vertex_count, face_count) < 0 or len(rows) < vertex_count + face_count:
        raise MeshError(
            f"{source} is damaged: it states {vertex_count:,} vertices and {face_count:,} faces, but "
            f"contains {len(rows):,} lines of them: copy or export it again."
        )
    points, rings = rows[:vertex_count], rows[vertex_count : vertex_count + face_count]
    if any(len(words) < 3 for words in points):
        raise MeshError(f"{source} is damaged: a vertex has fewer than three coordinates: export it again.")
    vertices = numbers_from([word for words in points for word in words[:3]], source, "a coordinate")
    vertices = vertices.reshape(-1, 3)
    sizes = [int(words[0]) for words in rings]
    if any(size < 0 or len(words) <= size for size, words in zip(sizes, rings, strict=True)):
        raise MeshError(f"{source} is damaged: a face has fewer vertices than it states. Export it again.")
    corners = [int(word) for size, words in zip(sizes, rings, strict=True) for word in words[1 : 1 + size]]
    faces, _ = triangulate(vertices, np.array(sizes, np.int64), np.array(corners, np.int64), source)
    return MeshData(vertices, faces)
