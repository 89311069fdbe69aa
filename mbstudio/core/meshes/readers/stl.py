"""STL, text and binary, told apart by what the file holds rather than by its first word."""

from __future__ import annotations

import re
import struct

import numpy as np

from mbstudio.core.errors import MeshError
from mbstudio.core.meshes.triangles import MeshData, numbers_from, require_few_triangles

_HEADER = 84
_RECORD = 50
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_SOLID = re.compile(rb"^[ \t]*solid\b", re.IGNORECASE | re.MULTILINE)


def read_stl(data: bytes, source: str) -> MeshData:
    """Return the triangles of an STL file.

    Raises
    ------
    MeshError
        If it is cut off, or a number of its text is none.
    """
    if is_text(data):
        return _read_text(data, source)
    return _read_binary(data, source)


def is_text(data: bytes) -> bool:
    """Return whether STL is text; many writers begin binary files with the word "solid" as well."""
    head = data[:4096].lstrip(b"\xef\xbb\xbf \t\r\n")
    if head[:5].lower() != b"solid":
        return False
    if len(data) >= _HEADER and len(data) == _HEADER + _RECORD * struct.unpack_from("<I", data, 80)[0]:
        return False
    facet = head.lower().find(b"facet")
    if facet < 0:
        return len(data) < _HEADER or head.lower().find(b"endsolid") >= 0
    corner, zero = head.lower().find(b"vertex"), head.find(b"\0")
    return zero < 0 or 0 <= corner < zero


def _read_text(data: bytes, source: str) -> MeshData:
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    found = list(_VERTEX.finditer(data))
    named = len(re.findall(rb"\bfacet\s+normal\b", data, re.IGNORECASE))
    if len(found) % 3 or len(found) // 3 != named:
        raise MeshError(
            f"{source} is damaged: it states {named} triangles but has {len(found)} vertices, "
            "not three for each: copy or export it again."
        )
    require_few_triangles(named, source)
    words = [word for match in found for word in match.groups()]
    vertices = numbers_from(words, source, "a coordinate").reshape(-1, 3)
    solids = np.array([match.start() for match in _SOLID.finditer(data)], dtype=np.int64)
    starts = np.array([match.start() for match in found[::3]], dtype=np.int64)
    notes = (
        [] if re.search(rb"\bendsolid\b", data, re.IGNORECASE) else ["ends without its last line, 'endsolid'"]
    )
    parts = np.searchsorted(solids, starts)
    return MeshData(vertices, np.arange(len(vertices)).reshape(-1, 3), parts, notes=notes)


def _read_binary(data: bytes, source: str) -> MeshData:
    if len(data) < _HEADER:
        raise MeshError(
            f"{source} is not an STL file: it has {len(data)} bytes, and the header of a binary STL file "
            f"alone takes {_HEADER}: copy or export it again."
        )
    promised = int(struct.unpack_from("<I", data, 80)[0])
    held, rest = divmod(len(data) - _HEADER, _RECORD)
    notes = []
    count = promised
    if promised > held:
        if rest or not held or not _are_triangles(data, 0, held):
            raise MeshError(
                f"{source} is not an STL file, or is damaged: its header states {promised:,} triangles in "
                f"{_HEADER + _RECORD * promised:,} bytes, but the file has {len(data):,}: "
                "copy or export it again."
            )
        count = held
        notes.append(f"states {promised:,} triangles in its header but contains {held:,}, which were read")
    elif promised < held and not rest and _are_triangles(data, promised, held):
        count = held
        notes.append(f"states {promised:,} triangles in its header but contains {held:,}, which were read")
    elif len(data) > _HEADER + _RECORD * promised:
        more = len(data) - _HEADER - _RECORD * promised
        notes.append(f"has {more:,} bytes after its last triangle, which were left out")
    require_few_triangles(count, source)
    triangles = np.frombuffer(data, _TRIANGLE, count, _HEADER)
    vertices = triangles["corners"].astype(np.float64).reshape(-1, 3)
    return MeshData(vertices, np.arange(len(vertices)).reshape(-1, 3), notes=notes)


def _are_triangles(data: bytes, first: int, last: int) -> bool:
    """Return whether the records from `first` to `last` hold triangles rather than padding or text."""
    records = np.frombuffer(data, _TRIANGLE, last - first, _HEADER + _RECORD * first)
    corners = records["corners"]
    size = np.abs(corners)
    return bool(
        np.isfinite(corners).all()
        and (corners != corners[:, :1]).any(axis=(1, 2)).all()
        and ((size == 0) | ((size > 1e-20) & (size < 1e20))).all()
    )
