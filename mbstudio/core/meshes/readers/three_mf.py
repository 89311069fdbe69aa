"""3MF: a zip of XML models, their objects placed by components and build items."""

from __future__ import annotations

import io
import posixpath
import zipfile
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import MeshError
from mbstudio.core.meshes.triangles import MeshData, require_few_triangles, require_known_corners

_LARGEST_MODEL = 1 << 29
_DEEPEST = 32
_MOST_PLACED = 100_000
_UNITS = {
    "micron": (1.0, "um"), "millimeter": (1.0, "mm"), "centimeter": (1.0, "cm"), "meter": (1.0, "m"),
    "inch": (25.4, "mm"), "foot": (304.8, "mm"),
}  # fmt: skip
_MODEL_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
_ENCRYPTED = 0x1


def read_three_mf(data: bytes, source: str) -> MeshData:
    """Return the triangles of all objects that a 3MF file builds, each where it is placed.

    Raises
    ------
    MeshError
        If it is no 3MF, is damaged, or would unpack to more than memory holds.
    """
    return _Package(data, source).read()


class _Package:
    def __init__(self, data: bytes, source: str) -> None:
        self._source = source
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(data))
        except zipfile.BadZipFile as error:
            raise MeshError(
                f"{source} is not a 3MF file, or is damaged: it is not a ZIP archive ({error}). Copy or "
                "export it again."
            ) from error
        self._models: dict[str, _Model] = {}
        self._vertices: list[np.ndarray] = []
        self._faces: list[np.ndarray] = []
        self._parts: list[np.ndarray] = []
        self._unpacked = self._points = self._triangles = self._placed = 0

    def read(self) -> MeshData:
        path = self._main_model()
        model = self._model(path)
        scale, unit = _UNITS.get(model.unit, (0.0, ""))
        if not unit:
            raise MeshError(f"{self._source} is in '{model.unit}', which 3MF does not know: export it again.")
        for item in model.items:
            self._place(item.path or path, item.object, item.matrix, 0)
        if not model.items:
            for number in model.objects:
                self._place(path, number, np.eye(4), 0)
        if not self._faces:
            return MeshData(np.zeros((0, 3)), np.zeros((0, 3), np.int64), unit=unit)
        vertices = np.concatenate(self._vertices) * scale
        return MeshData(vertices, np.concatenate(self._faces), np.concatenate(self._parts), unit)

    def _main_model(self) -> str:
        names = set(self._zip.namelist())
        if "_rels/.rels" in names:
            for relation in self._xml("_rels/.rels").iter():
                if relation.get("Type", "") == _MODEL_TYPE:
                    return relation.get("Target", "").lstrip("/")
        found = sorted(name for name in names if name.lower().endswith(".model"))
        if not found:
            raise MeshError(f"{self._source} is not a 3MF file: it contains no model. Export it again.")
        return next((name for name in found if name.lower() == "3d/3dmodel.model"), found[0])

    def _xml(self, name: str) -> ElementTree.Element:
        source = self._source
        try:
            entry = self._zip.getinfo(name)
        except KeyError:
            raise MeshError(f"{source} is damaged: it names '{name[:80]}', which it does not hold.") from None
        if entry.flag_bits & _ENCRYPTED:
            raise MeshError(f"{source} is locked with a password: save it without one.")
        self._unpacked += entry.file_size
        if self._unpacked > _LARGEST_MODEL:
            raise MeshError(
                f"{source} unpacks to more than {_LARGEST_MODEL >> 20} MiB: reduce its triangles first."
            )
        try:
            with self._zip.open(entry) as file:
                text = file.read(entry.file_size + 1)
            return _parse_without_entities(text, source)
        except (
            expat.ExpatError,
            AssertionError,
            zipfile.BadZipFile,
            NotImplementedError,
            EOFError,
            OSError,
        ) as error:
            raise MeshError(
                f"{source} is damaged: its '{name[:80]}' cannot be read ({error}): copy or export it again."
            ) from error

    def _model(self, path: str) -> _Model:
        if path not in self._models:
            self._models[path] = _Model(self._xml(path))
        return self._models[path]

    def _place(self, path: str, number: str, matrix: Float[np.ndarray, "4 4"], depth: int) -> None:
        found = self._model(path).objects.get(number)
        if found is None:
            raise MeshError(f"{self._source} is damaged: it builds object {number}, which it does not hold.")
        self._placed += 1
        if depth > _DEEPEST or self._placed > _MOST_PLACED:
            raise MeshError(f"{self._source} is damaged: its objects hold each other without end.")
        for part in _children(found, "components"):
            for component in _children(part, "component"):
                placed = _Placement(component)
                self._place(placed.path or path, placed.object, matrix @ placed.matrix, depth + 1)
        for mesh in _children(found, "mesh"):
            if found.get("type", "model") in ("model", "solidsupport", "surface"):
                self._add(mesh, matrix)

    def _add(self, mesh: ElementTree.Element, matrix: Float[np.ndarray, "4 4"]) -> None:
        vertices = np.array(
            [
                [float(point.get(axis, "")) for axis in "xyz"]
                for point in _grandchildren(mesh, "vertices", "vertex")
            ]
        ).reshape(-1, 3)
        faces = np.array(
            [
                [int(face.get(corner, "")) for corner in ("v1", "v2", "v3")]
                for face in _grandchildren(mesh, "triangles", "triangle")
            ],
            dtype=np.int64,
        ).reshape(-1, 3)
        require_known_corners(faces, len(vertices), self._source)
        self._triangles += len(faces)
        require_few_triangles(self._triangles, self._source)
        if np.linalg.det(matrix[:3, :3]) < 0:
            faces = faces[:, ::-1]
        self._vertices.append(vertices @ matrix[:3, :3].T + matrix[:3, 3])
        self._faces.append(faces + self._points)
        self._parts.append(np.full(len(faces), len(self._parts)))
        self._points += len(vertices)


class _Placement:
    """Which object a build item or component places, and where."""

    def __init__(self, element: ElementTree.Element) -> None:
        self.object = element.get("objectid", "")
        self.path = (
            posixpath.normpath(_attribute(element, "path")).lstrip("/") if _attribute(element, "path") else ""
        )
        self.matrix = np.eye(4)
        words = element.get("transform", "").split()
        if words:
            self.matrix[:3] = np.array([float(word) for word in words]).reshape(4, 3).T


class _Model:
    def __init__(self, root: ElementTree.Element) -> None:
        self.unit = root.get("unit", "millimeter")
        self.objects = {found.get("id", ""): found for found in _grandchildren(root, "resources", "object")}
        self.items = [_Placement(item) for item in _grandchildren(root, "build", "item")]


def _parse_without_entities(text: bytes, source: str) -> ElementTree.Element:
    """Return the root of XML that declares no entities: a few of them could unpack to any size."""

    def refuse(*_: Any) -> None:
        raise MeshError(f"{source} declares XML entities, which no 3MF file does: do not trust it.")

    parser = expat.ParserCreate(namespace_separator="}")
    builder = ElementTree.TreeBuilder()
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.EntityDeclHandler = refuse
    parser.StartDoctypeDeclHandler = refuse
    parser.Parse(text, True)
    return builder.close()


def _local(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _attribute(element: ElementTree.Element, name: str) -> str:
    return next((value for key, value in element.attrib.items() if key.rpartition("}")[2] == name), "")


def _children(element: ElementTree.Element, name: str) -> list[ElementTree.Element]:
    return [child for child in element if _local(child) == name]


def _grandchildren(element: ElementTree.Element, name: str, inner: str) -> list[ElementTree.Element]:
    return [found for child in _children(element, name) for found in _children(child, inner)]
