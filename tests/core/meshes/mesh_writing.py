"""Writers for mesh files as other programs write them, and trimesh does not."""

from __future__ import annotations

import json
import struct
import zipfile
from pathlib import Path

import numpy as np


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray, *, seams: bool = True) -> None:
    """Write an OBJ whose every corner has a texture coordinate and a normal of its own."""
    lines = ["mtllib ../secret.mtl", "o stone"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"vt {i / 7 % 1:.4f} {i / 3 % 1:.4f}" for i in range(3 * len(faces))] + ["vn 0 0 1"]
    for number, face in enumerate(faces.tolist()):
        if number % 100 == 0:
            lines += [f"g patch{number}", f"usemtl rock{number}", "s off"]
        ends = [f"{v + 1}/{3 * number + i + 1}/1" if seams else str(v + 1) for i, v in enumerate(face)]
        lines.append("f " + " ".join(ends))
    path.write_text("\n".join(lines) + "\n")


def binary_stl(corners: np.ndarray, header: bytes = b"exported", count: int | None = None) -> bytes:
    """Return a binary STL file of triangles, shape (f, 3, 3)."""
    records = np.zeros(len(corners), [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    records["c"] = corners
    return header.ljust(80) + struct.pack("<I", len(corners) if count is None else count) + records.tobytes()


def write_3mf(
    path: Path, objects: list[tuple[np.ndarray, np.ndarray]], *, unit: str = "millimeter", items: str = "",
    more: str = "", doctype: str = "",
) -> None:  # fmt: skip
    """Write a 3MF of objects 1, 2, ...; `items` and `more` are XML of the build and of further resources."""
    text = f'<?xml version="1.0"?>{doctype}<model unit="{unit}" '
    text += 'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
    for number, (vertices, faces) in enumerate(objects, start=1):
        text += f'<object id="{number}" type="model"><mesh><vertices>'
        text += "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in vertices.tolist())
        text += "</vertices><triangles>"
        text += "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces.tolist())
        text += "</triangles></mesh></object>"
    items = items or "".join(f'<item objectid="{number + 1}"/>' for number in range(len(objects)))
    text += f"{more}</resources><build>{items}</build></model>"
    relations = (
        '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship '
        'Target="/3D/part.model" Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>'
        "</Relationships>"
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("_rels/.rels", relations)
        archive.writestr("3D/part.model", text)


def gltf_of(vertices: np.ndarray, faces: np.ndarray, uri: str, **node: object) -> tuple[str, bytes]:
    """Return a glTF of one mesh, and the bytes of its buffer."""
    points, corners = vertices.astype("<f4").tobytes(), faces.astype("<u4").tobytes()
    found = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, **node}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "../texture.png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(corners)},
        ],
        "buffers": [{"uri": uri, "byteLength": len(points + corners)}],
    }
    return json.dumps(found), points + corners


def voxel_surface(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the faces of voxels as pairs of triangles that share no corner, outward."""
    vertices: list[np.ndarray] = []
    faces: list[list[int]] = []
    mask = np.pad(mask, 1)
    for axis in range(3):
        first, second = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        for side in (1, -1):
            for place in np.argwhere(mask & ~np.roll(mask, -side, axis)):
                corner = place + np.eye(3, dtype=int)[axis] * (side > 0)
                ring = [corner, corner + first, corner + first + second, corner + second][::side]
                at = len(vertices)
                vertices += ring
                faces += [[at, at + 1, at + 2], [at, at + 2, at + 3]]
    return np.array(vertices, float), np.array(faces)
