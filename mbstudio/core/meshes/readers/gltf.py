"""glTF 2.0 and GLB: the triangles of a scene, each node where it is placed; always in metres."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.errors import MeshError
from mbstudio.core.meshes.triangles import MeshData, require_few_triangles, require_known_corners

Sidecar = Callable[[str], bytes]
"""Returns the bytes of a file beside the one that is read, by its relative name."""

_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_SIZES = {"SCALAR": 1, "VEC3": 3}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_PACKED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
_DEEPEST = 64
_MOST_PLACED = 100_000


def read_gltf(data: bytes, source: str, sidecar: Sidecar) -> MeshData:
    """Return the triangles of a glTF scene in metres.

    Raises
    ------
    MeshError
        If it is damaged, packed by an extension, or names a file that is not beside it.
    """
    return _Scene(data, source, sidecar).read()


class _Scene:
    def __init__(self, data: bytes, source: str, sidecar: Sidecar) -> None:
        self._source, self._sidecar = source, sidecar
        self._binary: bytes | None = None
        text = self._unwrapped(data) if data[:4] == b"glTF" else data
        try:
            self._json: dict[str, Any] = json.loads(text.decode("utf-8-sig"))
        except (ValueError, RecursionError) as error:
            raise MeshError(
                f"{source} is damaged or no glTF file: its JSON cannot be read ({error}): export it again."
            ) from error
        if not isinstance(self._json, dict):
            raise MeshError(f"{source} is not a glTF file: its JSON is not an object. Export it again.")
        version = str(self._json.get("asset", {}).get("version", "2.0"))
        if version.partition(".")[0] != "2":
            raise MeshError(f"{source} is glTF {version}: export it as glTF 2.0.")
        self._buffers: dict[int, bytes] = {}
        self._vertices: list[np.ndarray] = []
        self._faces: list[np.ndarray] = []
        self._parts: list[np.ndarray] = []
        self._points = self._triangles = self._placed = 0

    def _unwrapped(self, data: bytes) -> bytes:
        if len(data) < 20:
            raise self._damaged("it ends within its header")
        version, length = struct.unpack_from("<II", data, 4)
        if version != 2:
            raise MeshError(f"{self._source} is GLB {version}: export it as glTF 2.0.")
        if length > len(data):
            raise self._damaged(f"its header states {length:,} bytes, but it has {len(data):,}")
        at, text = 12, None
        while at + 8 <= length:
            size, kind = struct.unpack_from("<II", data, at)
            if at + 8 + size > length:
                raise self._damaged("one of its chunks is cut off")
            chunk, at = data[at + 8 : at + 8 + size], at + 8 + size + (-size) % 4
            if kind == _JSON and text is None:
                text = chunk
            elif kind == _BINARY and self._binary is None:
                self._binary = chunk
        if text is None:
            raise self._damaged("it contains no JSON")
        return text

    def _damaged(self, why: str) -> MeshError:
        return MeshError(f"{self._source} is damaged: {why}: copy or export it again.")

    def read(self) -> MeshData:
        nodes = self._json.get("nodes", [])
        scenes = self._json.get("scenes", [])
        if scenes:
            roots = scenes[self._json.get("scene", 0)].get("nodes", [])
        else:
            inner = {child for node in nodes for child in node.get("children", [])}
            roots = [number for number in range(len(nodes)) if number not in inner]
        if not nodes:
            for number in range(len(self._json.get("meshes", []))):
                self._add_mesh(number, np.eye(4))
        for root in roots:
            self._place(root, np.eye(4), 0)
        if not self._faces:
            return MeshData(np.zeros((0, 3)), np.zeros((0, 3), np.int64), unit="m")
        vertices = np.concatenate(self._vertices)
        return MeshData(vertices, np.concatenate(self._faces), np.concatenate(self._parts), "m")

    def _place(self, number: int, matrix: Float[np.ndarray, "4 4"], depth: int) -> None:
        node = self._json["nodes"][number]
        self._placed += 1
        if depth > _DEEPEST or self._placed > _MOST_PLACED:
            raise self._damaged("its nodes contain each other in a circle")
        here = matrix @ _matrix_of(node)
        if "mesh" in node:
            self._add_mesh(node["mesh"], here)
        for child in node.get("children", []):
            self._place(child, here, depth + 1)

    def _add_mesh(self, number: int, matrix: Float[np.ndarray, "4 4"]) -> None:
        part = len(self._parts)
        for primitive in self._json["meshes"][number]["primitives"]:
            packed = [name for name in _PACKED if name in primitive.get("extensions", {})]
            if packed:
                raise MeshError(
                    f"{self._source} is packed with {packed[0]}, which is not read: "
                    "export it without compression."
                )
            mode = primitive.get("mode", _TRIANGLES)
            if mode not in (_TRIANGLES, _STRIP, _FAN) or "POSITION" not in primitive.get("attributes", {}):
                continue
            vertices = self._accessor(primitive["attributes"]["POSITION"], "VEC3").astype(np.float64)
            if "indices" in primitive:
                row = self._accessor(primitive["indices"], "SCALAR").ravel().astype(np.int64)
            else:
                row = np.arange(len(vertices))
            faces = _triangles(row, mode)
            require_known_corners(faces, len(vertices), self._source)
            self._triangles += len(faces)
            require_few_triangles(self._triangles, self._source)
            if np.linalg.det(matrix[:3, :3]) < 0:
                faces = faces[:, ::-1]
            self._vertices.append(vertices @ matrix[:3, :3].T + matrix[:3, 3])
            self._faces.append(faces + self._points)
            self._parts.append(np.full(len(faces), part))
            self._points += len(vertices)

    def _accessor(self, number: int, shape: str) -> np.ndarray:
        accessor = self._json["accessors"][number]
        if accessor["type"] != shape:
            raise self._damaged(f"accessor {number} is {accessor['type']} instead of {shape}")
        kind, count, width = (
            np.dtype(_KINDS[accessor["componentType"]]),
            int(accessor["count"]),
            _SIZES[shape],
        )
        if "bufferView" in accessor:
            view = accessor["bufferView"]
            values = self._view(view, int(accessor.get("byteOffset", 0)), kind, count, width)
        else:
            require_few_triangles(count // 3, self._source)
            values = np.zeros((count, width), kind)
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            changed, where, what = int(sparse["count"]), sparse["indices"], sparse["values"]
            index_kind = np.dtype(_KINDS[where["componentType"]])
            rows = self._view(
                where["bufferView"], int(where.get("byteOffset", 0)), index_kind, changed, 1
            ).ravel()
            require_known_corners(rows, count, self._source)
            values = values.copy()
            values[rows] = self._view(
                what["bufferView"], int(what.get("byteOffset", 0)), kind, changed, width
            )
        if accessor.get("normalized") and kind.kind in "iu":
            return np.maximum(values / float(np.iinfo(kind).max), -1.0)
        return values

    def _view(self, number: int, offset: int, kind: np.dtype[Any], count: int, width: int) -> np.ndarray:
        view = self._json["bufferViews"][number]
        start = int(view.get("byteOffset", 0)) + offset
        row = kind.itemsize * width
        stride = int(view.get("byteStride", row))
        data = self._buffer(view["buffer"])
        if min(start, count, stride - row) < 0 or (count and start + stride * (count - 1) + row > len(data)):
            raise self._damaged(f"{count:,} values of it lie beyond the {len(data):,} bytes of their buffer")
        return np.ndarray((count, width), kind, data, start, (stride, kind.itemsize))

    def _buffer(self, number: int) -> bytes:
        if number not in self._buffers:
            uri = self._json["buffers"][number].get("uri")
            if uri is None:
                if self._binary is None:
                    raise self._damaged("its binary chunk is missing")
                self._buffers[number] = self._binary
            elif str(uri).startswith("data:"):
                try:
                    self._buffers[number] = base64.b64decode(str(uri).partition(",")[2], validate=True)
                except ValueError as error:
                    raise self._damaged("an embedded buffer is not valid base64") from error
            else:
                self._buffers[number] = self._sidecar(str(uri))
        return self._buffers[number]


def _triangles(row: Int[np.ndarray, " n"], mode: int) -> Int[np.ndarray, "f 3"]:
    if mode == _TRIANGLES:
        return row[: len(row) // 3 * 3].reshape(-1, 3)
    if len(row) < 3:
        return np.zeros((0, 3), np.int64)
    if mode == _FAN:
        return np.stack([np.full(len(row) - 2, row[0]), row[1:-1], row[2:]], axis=1)
    strip = np.stack([row[:-2], row[1:-1], row[2:]], axis=1)
    strip[1::2] = strip[1::2][:, [1, 0, 2]]
    return strip


def _matrix_of(node: dict[str, Any]) -> Float[np.ndarray, "4 4"]:
    """Return where a node lies: its matrix (by columns), or its shift, quaternion and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = (float(value) for value in node.get("rotation", (0, 0, 0, 1)))
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), dtype=float)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix
