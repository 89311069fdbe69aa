"""PLY, text and binary of either byte order, with polygons or strips of triangles."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import MeshError
from mbstudio.core.meshes.triangles import MeshData, numbers_from, triangulate

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 1 << 16


@dataclass
class _Property:
    name: str
    kind: str
    counted_by: str = ""
    """Type of the length of a list; empty for a single number."""


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    def place(self, *names: str) -> int:
        return next((i for i, known in enumerate(self.properties) if known.name in names), -1)


@dataclass
class _Column:
    """Values of one property; for a list, the length of each row as well."""

    values: np.ndarray
    sizes: Int[np.ndarray, " n"] | None = None


_Table = list[_Column]


def read_ply(data: bytes, source: str) -> MeshData:
    """Return the triangles of a PLY file.

    Raises
    ------
    MeshError
        If its header cannot be understood, it is cut off, or a number is none.
    """
    order, elements, body = _read_header(data, source)
    tables = _read_text(body, elements, source) if not order else _read_binary(body, elements, order, source)
    if "vertex" not in tables:
        raise MeshError(f"{source} contains no vertices: export it again.")
    vertex = next(element for element in elements if element.name == "vertex")
    places = [vertex.place(axis) for axis in "xyz"]
    if min(places) < 0:
        raise MeshError(f"{source} has vertices without x, y and z: export it again.")
    vertices = np.stack([tables["vertex"][i].values.astype(np.float64) for i in places], axis=1)
    sizes, corners = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for element in elements:
        place = element.place("vertex_indices", "vertex_index")
        if element.name not in ("face", "tristrips") or place < 0:
            continue
        column = tables[element.name][place]
        if column.sizes is None:
            raise MeshError(f"{source} has faces whose vertices are not a list: export it again.")
        if element.name == "face":
            sizes.append(column.sizes)
            corners.append(_vertex_numbers(column.values, source))
        else:
            strips = _strips(_vertex_numbers(column.values, source))
            sizes.append(np.full(len(strips), 3))
            corners.append(strips.ravel())
    faces, _ = triangulate(vertices, np.concatenate(sizes), np.concatenate(corners), source)
    return MeshData(vertices, faces)


def _vertex_numbers(values: np.ndarray, source: str) -> Int[np.ndarray, " n"]:
    """Return numbers of vertices, which text holds as floats."""
    if values.dtype.kind == "f" and not (np.isfinite(values).all() and (values == np.rint(values)).all()):
        raise MeshError(f"{source} is damaged: a face names a corner by no whole number: export it again.")
    numbers: np.ndarray = np.clip(values, -1, np.iinfo(np.int32).max).astype(np.int64)
    return numbers


def _strips(row: Int[np.ndarray, " n"]) -> Int[np.ndarray, "f 3"]:
    """Return the triangles of strips that -1 ends."""
    triples = np.stack([row[:-2], row[1:-1], row[2:]], axis=1) if len(row) > 2 else np.zeros((0, 3), np.int64)
    ends = np.maximum.accumulate(np.where(row == -1, np.arange(len(row)), -1))[: len(triples)]
    odd = (np.arange(len(triples)) - ends - 1) % 2 == 1
    triples[odd] = triples[odd][:, [1, 0, 2]]
    triangles: np.ndarray = triples[(triples != -1).all(axis=1)]
    return triangles


def _read_header(data: bytes, source: str) -> tuple[str, list[_Element], bytes]:
    end = data.find(b"end_header", 0, _LONGEST_HEADER)
    if not data.startswith(b"ply") or end < 0:
        raise MeshError(
            f"{source} is not a PLY file, or is truncated: its header has no end. Copy or export it again."
        )
    body = end + len(b"end_header")
    body += 2 if data[body : body + 2] == b"\r\n" else 1
    order, elements = None, []
    for line in data[:end].decode("latin-1").splitlines():
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = _ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements.append(_Element(words[1], int(words[2])))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append(_Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(_Property(words[2], _TYPES[words[1]]))
        except (IndexError, KeyError, ValueError):
            raise MeshError(
                f"{source} has an invalid PLY header: its line '{line[:60]}' cannot be read: export it again."
            ) from None
    if order is None:
        raise MeshError(f"{source} has a header without its format: export it again.")
    held = len(data) - body
    for element in elements:
        # A value takes two characters of text, or its bytes.
        least = sum(
            2 if not order else np.dtype(known.counted_by or known.kind).itemsize
            for known in element.properties
        )
        if element.count < 0 or element.count * max(least, 1) > held + 1:
            raise MeshError(
                f"{source} is damaged: its header states {element.count:,} rows of '{element.name}', "
                f"more than its {held:,} bytes can hold: copy or export it again."
            )
    return order, elements, data[body:]


def _cut_off(source: str, element: _Element) -> MeshError:
    return MeshError(
        f"{source} is damaged: it ends before its {element.count:,} rows of '{element.name}' are complete: "
        "copy or export it again."
    )


def _read_text(body: bytes, elements: list[_Element], source: str) -> dict[str, _Table]:
    words = body.split()
    tables: dict[str, _Table] = {}
    at = 0
    for element in elements:
        properties = element.properties
        if not any(known.counted_by for known in properties):
            stop = at + element.count * len(properties)
            if stop > len(words):
                raise _cut_off(source, element)
            values = numbers_from(words[at:stop], source, f"a value of '{element.name}'")
            rows = values.reshape(element.count, len(properties))
            tables[element.name], at = [_Column(rows[:, i]) for i in range(len(properties))], stop
            continue
        taken: list[list[bytes]] = [[] for _ in properties]
        sizes: list[list[int]] = [[] for _ in properties]
        for _ in range(element.count):
            for i, known in enumerate(properties):
                if at >= len(words):
                    raise _cut_off(source, element)
                size = 1
                if known.counted_by:
                    size, at = _length(words[at], source), at + 1
                if at + size > len(words):
                    raise _cut_off(source, element)
                taken[i] += words[at : at + size]
                sizes[i].append(size)
                at += size
        tables[element.name] = [
            _Column(
                numbers_from(taken[i], source, f"a value of '{element.name}'"),
                np.array(sizes[i], np.int64) if known.counted_by else None,
            )
            for i, known in enumerate(properties)
        ]
    return tables


def _length(word: bytes, source: str) -> int:
    try:
        size = int(word)
    except ValueError:
        size = -1
    if size < 0:
        shown = word[:30].decode("latin-1")
        raise MeshError(f"{source} is damaged: '{shown}' is not a valid list length. Export it again.")
    return size


def _read_binary(body: bytes, elements: list[_Element], order: str, source: str) -> dict[str, _Table]:
    tables: dict[str, _Table] = {}
    at = 0
    for element in elements:
        rows = _even_rows(body, at, element, order)
        if rows is not None:
            tables[element.name], at = rows
        else:
            tables[element.name], at = _uneven_rows(body, at, element, order, source)
    return tables


def _even_rows(body: bytes, at: int, element: _Element, order: str) -> tuple[_Table, int] | None:
    """Read all rows at once if each list is as long as in the first row; None where they are not."""
    fields, sizes, here = [], [], at
    for i, known in enumerate(element.properties):
        kind = np.dtype(order + known.kind)
        size = 0
        if known.counted_by:
            counter = np.dtype(order + known.counted_by)
            if here + counter.itemsize > len(body):
                return None
            size = int(np.frombuffer(body, counter, 1, here)[0]) if element.count else 0
            if size < 0 or here + size * kind.itemsize > len(body):
                return None
            fields.append((f"size{i}", counter))
            here += counter.itemsize
        fields.append((f"value{i}", kind, (size,)) if known.counted_by else (f"value{i}", kind))  # type: ignore[arg-type]
        here += kind.itemsize * (size if known.counted_by else 1)
        sizes.append(size)
    row = np.dtype(fields)
    if at + row.itemsize * element.count > len(body):
        return None
    table = np.frombuffer(body, row, element.count, at) if row.itemsize else np.zeros(element.count, row)
    columns = []
    for i, known in enumerate(element.properties):
        if not known.counted_by:
            columns.append(_Column(table[f"value{i}"]))
            continue
        if (table[f"size{i}"] != sizes[i]).any():
            return None
        columns.append(_Column(table[f"value{i}"].reshape(-1), table[f"size{i}"].astype(np.int64)))
    return columns, at + row.itemsize * element.count


def _uneven_rows(body: bytes, at: int, element: _Element, order: str, source: str) -> tuple[_Table, int]:
    kinds = [np.dtype(order + known.kind) for known in element.properties]
    counters = [
        np.dtype(order + known.counted_by) if known.counted_by else None for known in element.properties
    ]
    byte_order: Literal["big", "little"] = "big" if order == ">" else "little"
    taken: list[list[bytes]] = [[] for _ in kinds]
    sizes: list[list[int]] = [[] for _ in kinds]
    for _ in range(element.count):
        for i, (kind, counter) in enumerate(zip(kinds, counters, strict=True)):
            size = 1
            if counter is not None:
                size = int.from_bytes(
                    body[at : at + counter.itemsize], byte_order, signed=counter.kind == "i"
                )
                at += counter.itemsize
            stop = at + size * kind.itemsize
            if size < 0 or stop > len(body):
                raise _cut_off(source, element)
            taken[i].append(body[at:stop])
            sizes[i].append(size)
            at = stop
    return [
        _Column(
            np.frombuffer(b"".join(taken[i]), kind),
            None if counters[i] is None else np.array(sizes[i], np.int64),
        )
        for i, kind in enumerate(kinds)
    ], at
