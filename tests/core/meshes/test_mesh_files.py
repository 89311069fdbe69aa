"""Mesh files of every format and writer's variant: read as they are meant, or refused with the true cause."""

from __future__ import annotations

import base64
import builtins
import json
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mbstudio.core.errors import GrainWarning, MeshError, UnitError
from mbstudio.core.meshes.bodies import read_bodies
from tests.core.meshes.mesh_writing import binary_stl, gltf_of, voxel_surface, write_3mf, write_obj

SINGLE = 1e-6  # what single precision leaves of a volume


def volumes(path: Path, **options: object) -> list[float]:
    return [body.volume for body in read_bodies(path, **options)]


# ---- OBJ --------------------------------------------------------------------------------------------


def test_obj_with_seams_groups_and_materials(tmp_path, ball):
    write_obj(tmp_path / "a.obj", ball.vertices, ball.faces)
    assert volumes(tmp_path / "a.obj") == pytest.approx([ball.volume], rel=1e-12)


@pytest.mark.parametrize("variant", ["repeated corners", "negative", "quads", "colours", "continued", "crlf"])
def test_obj_as_other_writers_write_it(tmp_path, variant):
    box = trimesh.creation.box((1, 2, 3))
    points = [f"v {x} {y} {z}" for x, y, z in box.vertices.tolist()]
    faces = [" ".join(str(v + 1) for v in face) for face in box.faces.tolist()]
    if variant == "repeated corners":
        points = [points[v] for face in box.faces.tolist() for v in face]
        faces = [f"{3 * i + 1}//1 {3 * i + 2}//2 {3 * i + 3}//3" for i in range(12)]
    elif variant == "negative":
        faces = [" ".join(str(v - 8) for v in face) for face in box.faces.tolist()]
    elif variant == "quads":
        points = [f"v {i} {2 * j} {3 * k}" for i in (0, 1) for j in (0, 1) for k in (0, 1)]
        faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    elif variant == "colours":
        points = [f"{point} 0.5 0.5 0.5" for point in points]
    elif variant == "continued":
        faces = [face.replace(" ", " \\\n", 1) for face in faces]
    text = "# a box\n" + "\n".join([*points, *(f"f {face}" for face in faces)]) + "\n"
    (tmp_path / "a.obj").write_bytes(text.replace("\n", "\r\n" if variant == "crlf" else "\n").encode())
    assert volumes(tmp_path / "a.obj") == pytest.approx([6], rel=1e-12)


# ---- STL --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("more", [b"\0" * 37, b"\0" * 50, b"\0" * 500, b"made by a scanner\n", b"\xff"])
def test_stl_with_bytes_after_its_last_triangle(tmp_path, ball, more):
    (tmp_path / "a.stl").write_bytes(binary_stl(ball.triangles) + more)
    with pytest.warns(GrainWarning, match=f"has {len(more)} bytes after its last triangle"):
        assert volumes(tmp_path / "a.stl") == pytest.approx([ball.volume], rel=SINGLE)


@pytest.mark.parametrize(
    "header", [b"solid stone", b"solid facet normal", b"  SOLID", b"\0", b"solid\nfacet"]
)
def test_binary_stl_whatever_its_header_says(tmp_path, ball, header):
    (tmp_path / "a.stl").write_bytes(binary_stl(ball.triangles, header))
    assert volumes(tmp_path / "a.stl") == pytest.approx([ball.volume], rel=SINGLE)
    (tmp_path / "b.stl").write_bytes(binary_stl(ball.triangles, header) + b"\0\0\0")
    with pytest.warns(GrainWarning, match="3 bytes after"):
        assert volumes(tmp_path / "b.stl") == pytest.approx([ball.volume], rel=SINGLE)


@pytest.mark.parametrize("count", [0, 100, 1281, 0xFFFFFFFF])
def test_a_wrong_number_of_triangles_is_told(tmp_path, ball, count):
    (tmp_path / "a.stl").write_bytes(binary_stl(ball.triangles, count=count))
    with pytest.warns(GrainWarning, match=f"states {count:,} triangles in its header but contains 1,280"):
        assert volumes(tmp_path / "a.stl") == pytest.approx([ball.volume], rel=SINGLE)


@pytest.mark.parametrize("lost", [7, 50, 5000, 63_000])
def test_an_stl_that_is_cut_off_is_refused(tmp_path, ball, lost):
    (tmp_path / "a.stl").write_bytes(binary_stl(ball.triangles)[:-lost])
    with pytest.raises(MeshError, match=r"a\.stl .*states 1,280 triangles"):
        read_bodies(tmp_path / "a.stl")


def text_stl(triangles: np.ndarray, name: str = "a") -> str:
    body = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in corners.tolist())
        + "endloop\nendfacet\n"
        for corners in triangles
    )
    return f"solid {name}\n{body}endsolid {name}\n"


@pytest.mark.parametrize("variant", ["plain", "crlf", "capitals", "zeros", "text", "mark", "old mac"])
def test_text_stl_as_other_writers_write_it(tmp_path, ball, variant):
    data = text_stl(ball.triangles).encode()
    if variant in ("crlf", "old mac"):
        data = data.replace(b"\n", b"\r\n" if variant == "crlf" else b"\r")
    elif variant == "capitals":
        data = data.upper()
    elif variant == "zeros":
        data += b"\0" * 11
    elif variant == "text":
        data += b"\n; written by a scanner\n"
    elif variant == "mark":
        data = b"\xef\xbb\xbf" + data
    (tmp_path / "a.stl").write_bytes(data)
    assert volumes(tmp_path / "a.stl") == pytest.approx([ball.volume], rel=1e-12)


def test_text_stl_of_several_solids(tmp_path, ball):
    """Solids are bodies where each is closed, and patches of one surface where they are not."""
    shifted = ball.triangles + np.array([5, 0, 0])
    (tmp_path / "two.stl").write_text(text_stl(ball.triangles, "a") + text_stl(shifted, "b"))
    found = read_bodies(tmp_path / "two.stl", "mm")
    assert [body.metadata["name"] for body in found] == ["two#1", "two#2"]
    assert [body.volume for body in found] == pytest.approx([ball.volume] * 2, rel=1e-12)
    (tmp_path / "one.stl").write_text(
        text_stl(ball.triangles[:500], "a") + text_stl(ball.triangles[500:], "b")
    )
    assert volumes(tmp_path / "one.stl") == pytest.approx([ball.volume], rel=1e-12)


def test_damaged_text_stl(tmp_path, ball):
    text = text_stl(ball.triangles)
    for broken, words in (
        (text.replace("vertex", "vertex oops", 1), "'oops' where a coordinate should be a number"),
        (text.replace(".", ","), "decimal points are needed"),
        (text[: len(text) // 2 // 100 * 100], "damaged|not closed"),
        ("solid nothing", "no triangles"),
    ):
        (tmp_path / "a.stl").write_text(broken)
        with pytest.raises(MeshError, match=words):
            read_bodies(tmp_path / "a.stl")


# ---- PLY --------------------------------------------------------------------------------------------


def ply_of(vertices: np.ndarray, rings: list[list[int]], order: str, *, extra: bool = False) -> bytes:
    head = [f"format {order} 1.0", "comment made here", f"element vertex {len(vertices)}"]
    head += ["property double x", "property double y", "property double z"]
    if extra:
        head += ["property uchar red", "property list uchar float weights"]
    head += [f"element face {len(rings)}", "property list uchar int vertex_indices"]
    if extra:
        head += ["property float quality"]
    header = "ply\n" + "\n".join(head) + "\nend_header\n"
    if order == "ascii":
        rows = [" ".join(map(repr, row)) + (" 7 1 0.5" if extra else "") for row in vertices.tolist()]
        rows += [f"{len(ring)} {' '.join(map(str, ring))}" + (" 0.1" if extra else "") for ring in rings]
        return (header + "\n".join(rows) + "\n").encode()
    sign = "<" if "little" in order else ">"
    data = b""
    for row in vertices.tolist():
        data += struct.pack(f"{sign}3d", *row) + (struct.pack(f"{sign}BBf", 7, 1, 0.5) if extra else b"")
    for ring in rings:
        data += struct.pack(f"{sign}B{len(ring)}i", len(ring), *ring)
        data += struct.pack(f"{sign}f", 0.1) if extra else b""
    return header.encode() + data


PLY_ORDERS = ["ascii", "binary_little_endian", "binary_big_endian"]


@pytest.mark.parametrize("extra", [False, True])
@pytest.mark.parametrize("rings", ["triangles", "quads", "both"])
@pytest.mark.parametrize("order", PLY_ORDERS)
def test_ply_of_every_kind(tmp_path, order, rings, extra):
    corners = np.array([(i, 2 * j, 3 * k) for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    halves = [half for a, b, c, d in quads for half in ([a, b, c], [a, c, d])]
    chosen = {"triangles": halves, "quads": quads, "both": [*halves[:6], *quads[3:]]}[rings]
    (tmp_path / "a.ply").write_bytes(ply_of(corners, chosen, order, extra=extra))
    assert volumes(tmp_path / "a.ply") == pytest.approx([6], rel=1e-12)


@pytest.mark.parametrize("order", PLY_ORDERS)
def test_a_ply_that_is_cut_off_is_refused(tmp_path, ball, order):
    data = ply_of(ball.vertices, ball.faces.tolist(), order)
    for length in (40, len(data) // 3, len(data) - 6):
        (tmp_path / "a.ply").write_bytes(data[:length])
        with pytest.raises(MeshError, match=r"a\.ply .*(damaged|truncated)"):
            read_bodies(tmp_path / "a.ply")


def test_a_ply_that_states_more_than_it_holds_takes_no_memory(tmp_path):
    for count in (10**12, 10**18):
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty float x\nend_header\n"
        (tmp_path / "a.ply").write_bytes(head.encode() + b"\0" * 100)
        with pytest.raises(MeshError, match="states"):
            read_bodies(tmp_path / "a.ply")


def test_a_cloud_of_points_is_called_so(tmp_path, ball):
    (tmp_path / "a.ply").write_bytes(ply_of(ball.vertices, [], "binary_little_endian"))
    (tmp_path / "a.obj").write_text("\n".join(f"v {x} {y} {z}" for x, y, z in ball.vertices.tolist()))
    for name in ("a.ply", "a.obj"):
        with pytest.raises(MeshError, match="642 points but no triangles between them"):
            read_bodies(tmp_path / name)


@pytest.mark.parametrize("order", PLY_ORDERS)
def test_ply_of_strips(tmp_path, order):
    """Two strips around a tetrahedron, an end between them."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    row = [0, 1, 2, 3, -1, 2, 0, 3, 1, -1]
    data = ply_of(corners, [row], order).replace(b"element face", b"element tristrips")
    (tmp_path / "a.ply").write_bytes(data)
    assert volumes(tmp_path / "a.ply") == pytest.approx([1 / 6], rel=1e-12)


# ---- OFF --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("variant", ["plain", "one line", "comments", "colours", "coff", "quads"])
def test_off_of_every_kind(tmp_path, variant):
    box = trimesh.creation.box((1, 2, 3))
    points = [f"{x} {y} {z}" for x, y, z in box.vertices.tolist()]
    faces = [f"3 {a} {b} {c}" for a, b, c in box.faces.tolist()]
    head = ["OFF", f"{len(points)} {len(faces)} 0"]
    if variant == "one line":
        head = [" ".join(head)]
    elif variant == "comments":
        head = ["# a box", "OFF", "", "# numbers", head[1]]
        points[3] += " # here"
    elif variant == "colours":
        faces = [f"{face} 255 0 0" for face in faces]
    elif variant == "coff":
        head[0] = "COFF"
        points = [f"{point} 1 0 0 1" for point in points]
    elif variant == "quads":
        points = [f"{i} {2 * j} {3 * k}" for i in (0, 1) for j in (0, 1) for k in (0, 1)]
        faces = ["4 0 1 3 2", "4 4 6 7 5", "4 0 4 5 1", "4 2 3 7 6", "4 0 2 6 4", "4 1 5 7 3"]
        head[1] = "8 6 12"
    (tmp_path / "a.off").write_text("\n".join([*head, *points, *faces]) + "\n")
    assert volumes(tmp_path / "a.off") == pytest.approx([6], rel=1e-12)


def test_damaged_off(tmp_path):
    for text, words in (
        ("OFF\n4 4 0\n0 0 0\n", "states 4 vertices and 4 faces"),
        ("OFF\n", "numbers of vertices and faces are missing"),
        ("OFF BINARY\n\0\0", "binary OFF"),
        ("4OFF\n1 0 0\n", "not three-dimensional"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n", "names vertex 9"),
    ):
        (tmp_path / "a.off").write_text(text)
        with pytest.raises(MeshError, match=words):
            read_bodies(tmp_path / "a.off")


# ---- polygons ---------------------------------------------------------------------------------------


def test_concave_polygons_are_split_within_themselves(tmp_path):
    """A prism over an L and one over an arrow: a fan would fold, and its area be too large."""
    for outline, area in (
        ([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 3.0),
        ([(2, 2), (0, 1), (2, 0), (1, 1)], 1.0),
    ):
        count = len(outline)
        points = [f"v {x} {y} {z}" for z in (0, 1) for x, y in outline]
        rings = [list(range(count, 0, -1)), list(range(count + 1, 2 * count + 1))]
        rings += [
            [i + 1, (i + 1) % count + 1, (i + 1) % count + 1 + count, i + 1 + count] for i in range(count)
        ]
        text = "\n".join([*points, *("f " + " ".join(map(str, ring)) for ring in rings)])
        (tmp_path / "a.obj").write_text(text)
        (body,) = read_bodies(tmp_path / "a.obj")
        lengths = np.linalg.norm(np.roll(outline, -1, axis=0) - np.array(outline), axis=1).sum()
        assert body.volume == pytest.approx(area, rel=1e-12)
        assert body.area == pytest.approx(2 * area + lengths, rel=1e-12)


# ---- 3MF --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "length", "stated"), [
    ("millimeter", 2.0, "mm"), ("micron", 2.0, "um"), ("meter", 2.0, "m"), ("centimeter", 2.0, "cm"),
    ("inch", 50.8, "mm"),
])  # fmt: skip
def test_3mf_knows_its_unit(tmp_path, ball, unit, length, stated):
    write_3mf(tmp_path / "a.3mf", [(ball.vertices, ball.faces)], unit=unit)
    (body,) = read_bodies(tmp_path / "a.3mf")
    assert body.units == stated
    assert np.ptp(body.vertices[:, 2]) == pytest.approx(length, rel=1e-3)


def test_3mf_builds_components_where_they_are_placed(tmp_path, ball):
    pair = '<object id="9"><components><component objectid="1"/>'
    pair += '<component objectid="1" transform="-2 0 0 0 2 0 0 0 2 9 0 0"/></components></object>'
    write_3mf(tmp_path / "a.3mf", [(ball.vertices, ball.faces)], more=pair, items='<item objectid="9"/>')
    one, two = read_bodies(tmp_path / "a.3mf")
    assert one.volume == pytest.approx(ball.volume, rel=1e-12)
    assert two.volume == pytest.approx(8 * ball.volume, rel=1e-12)
    assert two.center_mass == pytest.approx((9 - 0.6, -0.4, 0.2), abs=1e-9)


def test_3mf_objects_that_touch_are_bodies_of_their_own(tmp_path):
    box = trimesh.creation.box((1, 1, 1))
    write_3mf(
        tmp_path / "a.3mf", [(box.vertices, box.faces), (box.vertices + np.array([1, 0, 0]), box.faces)]
    )
    assert volumes(tmp_path / "a.3mf") == pytest.approx([1, 1], rel=1e-12)


def test_3mf_that_is_none(tmp_path, ball):
    path = tmp_path / "a.3mf"
    bomb = '<!DOCTYPE m [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>'
    write_3mf(path, [(ball.vertices, ball.faces)], doctype=bomb)
    with pytest.raises(MeshError, match="declares XML entities"):
        read_bodies(path)
    whole = (write_3mf(path, [(ball.vertices, ball.faces)]), path.read_bytes())[1]
    for data in (whole[: len(whole) // 2], b"PK\x03\x04nothing"):
        path.write_bytes(data)
        with pytest.raises(MeshError, match="not a 3MF file, or is damaged"):
            read_bodies(path)
    write_3mf(path, [(ball.vertices, ball.faces)], items='<item objectid="77"/>')
    with pytest.raises(MeshError, match="builds object 77"):
        read_bodies(path)
    loop = '<object id="5"><components><component objectid="5"/></components></object>'
    write_3mf(path, [(ball.vertices, ball.faces)], more=loop, items='<item objectid="5"/>')
    with pytest.raises(MeshError, match="hold each other without end"):
        read_bodies(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("notes.txt", "nothing")
    with pytest.raises(MeshError, match="contains no model"):
        read_bodies(path)


def test_3mf_that_would_unpack_to_any_size(tmp_path):
    with (
        zipfile.ZipFile(tmp_path / "a.3mf", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("3D/3dmodel.model", "w", force_zip64=True) as file,
    ):
        for _ in range(600):
            file.write(b" " * (1 << 20))
    with pytest.raises(MeshError, match="unpacks to more than"):
        read_bodies(tmp_path / "a.3mf")


# ---- glTF -------------------------------------------------------------------------------------------


def test_glb_is_in_metres(tmp_path, ball):
    ball.export(tmp_path / "a.glb")
    (body,) = read_bodies(tmp_path / "a.glb")
    assert body.units == "m"
    assert body.volume == pytest.approx(ball.volume, rel=SINGLE)
    with pytest.warns(GrainWarning, match="is in m by its format, but was read in mm as asked"):
        (body,) = read_bodies(tmp_path / "a.glb", "mm")
    assert body.units == "mm"


@pytest.mark.parametrize("node", [
    {}, {"scale": [2, 2, 2]}, {"translation": [1, 2, 3], "scale": [-2, 2, 2]},
    {"rotation": [0.5, 0.5, 0.5, 0.5], "scale": [2, 2, 2]},
    {"matrix": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 4, 5, 6, 1]},
])  # fmt: skip
def test_gltf_with_its_buffer_within_or_beside_it(tmp_path, ball, node):
    text, data = gltf_of(ball.vertices, ball.faces, "the%20mesh.bin", **node)
    (tmp_path / "the mesh.bin").write_bytes(data)
    (tmp_path / "a.gltf").write_text(text)
    packed = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    (tmp_path / "b.gltf").write_text(gltf_of(ball.vertices, ball.faces, packed, **node)[0])
    for name in ("a.gltf", "b.gltf"):
        assert volumes(tmp_path / name) == pytest.approx([ball.volume * (8 if node else 1)], rel=SINGLE)


@pytest.mark.parametrize("mode", ["strip", "fan and triangle"])
def test_gltf_of_strips_and_fans_in_sparse_whole_numbers(tmp_path, mode):
    """A tetrahedron, its corners in 16 bits that mean -1 to 1, one of them put in by itself."""
    corners = np.array([[0, 0, 0], [32767, 0, 0], [0, 32767, 0], [0, 0, 7]], "<i2")
    rows = np.array([0, 1, 2, 3, 0, 1] if mode == "strip" else [3, 0, 1, 2, 0, 0, 2, 1], "<u4")
    parts = [corners, rows, np.array([3], "<u4"), np.array([0, 0, 32767], "<i2")]
    starts = np.cumsum([0, *(part.nbytes for part in parts)]).tolist()
    found = json.loads(gltf_of(corners, np.zeros((2, 3), int), "")[0])
    found["bufferViews"] = [{"buffer": 0, "byteOffset": start} for start in starts[:4]]
    packed = base64.b64encode(b"".join(part.tobytes() for part in parts)).decode()
    found["buffers"] = [{"uri": f"data:;base64,{packed}"}]
    sparse = {"count": 1, "indices": {"bufferView": 2, "componentType": 5125}, "values": {"bufferView": 3}}
    point = {"bufferView": 0, "componentType": 5122, "count": 4, "type": "VEC3", "normalized": True}
    row = {"bufferView": 1, "componentType": 5125, "type": "SCALAR"}
    faces = {"attributes": {"POSITION": 0}, "indices": 1}
    if mode == "strip":
        found["accessors"] = [{**point, "sparse": sparse}, {**row, "count": 6}]
        found["meshes"] = [{"primitives": [{**faces, "mode": 5}, {**faces, "mode": 0}]}]
    else:
        fan, triangle = {**row, "count": 5}, {**row, "byteOffset": 20, "count": 3}
        found["accessors"] = [{**point, "sparse": sparse}, fan, triangle]
        found["meshes"] = [{"primitives": [{**faces, "mode": 6}, {**faces, "indices": 2}]}]
    (tmp_path / "a.gltf").write_text(json.dumps(found))
    assert volumes(tmp_path / "a.gltf") == pytest.approx([1 / 6], rel=1e-12)


@pytest.mark.parametrize("uri", [
    "../mesh.bin", "/etc/passwd", "..\\mesh.bin", "C:\\mesh.bin", "sub/mesh.bin", "file:///etc/passwd",
    "https://example.org/mesh.bin", "%2e%2e/mesh.bin", "..", "",
])  # fmt: skip
def test_no_other_file_is_opened(tmp_path, ball, uri):
    inner = tmp_path / "inner"
    (inner / "sub").mkdir(parents=True)
    text, data = gltf_of(ball.vertices, ball.faces, uri)
    for place in (tmp_path, inner / "sub"):
        (place / "mesh.bin").write_bytes(data)
    (inner / "a.gltf").write_text(text)
    with pytest.raises(MeshError, match="not a file in the same folder"):
        read_bodies(inner / "a.gltf")


def test_a_side_car_that_is_a_link_out_of_the_folder_is_refused(tmp_path, ball):
    inner = tmp_path / "inner"
    inner.mkdir()
    text, data = gltf_of(ball.vertices, ball.faces, "mesh.bin")
    (tmp_path / "mesh.bin").write_bytes(data)
    (inner / "mesh.bin").symlink_to(tmp_path / "mesh.bin")
    (inner / "a.gltf").write_text(text)
    with pytest.raises(MeshError, match="link out of its folder"):
        read_bodies(inner / "a.gltf")
    (inner / "mesh.bin").unlink()
    with pytest.raises(MeshError, match=r"needs 'mesh\.bin', which is missing"):
        read_bodies(inner / "a.gltf")


def test_obj_opens_nothing_beside_itself(tmp_path, ball, monkeypatch):
    write_obj(tmp_path / "a.obj", ball.vertices, ball.faces)
    read = []
    real = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read.append(path) or real(path))
    monkeypatch.setattr(builtins, "open", None)
    read_bodies(tmp_path / "a.obj")
    monkeypatch.undo()
    assert read == [tmp_path / "a.obj"]


def test_damaged_gltf(tmp_path, ball):
    text, data = gltf_of(ball.vertices, ball.faces, "mesh.bin")
    (tmp_path / "mesh.bin").write_bytes(data[: len(data) // 2])
    ball.export(tmp_path / "whole.glb")
    whole = (tmp_path / "whole.glb").read_bytes()
    draco = '"extensions": {"KHR_draco_mesh_compression": {}}'
    for name, content, words in (
        ("a.gltf", text.encode(), "lie beyond"),
        ("b.gltf", b"{", "JSON cannot be read"),
        ("c.glb", whole[: len(whole) // 2], "states"),
        ("d.glb", whole[:10], "ends within its header"),
        ("e.gltf", text.replace('"VEC3"', '"VEC2"').encode(), "VEC2 instead of VEC3"),
        ("f.gltf", text.replace('"indices": 1', draco).encode(), "export it without compression"),
        ("g.gltf", text.replace('"version": "2.0"', '"version": "1.0"').encode(), "glTF 1.0"),
        ("h.gltf", text.replace('"mesh": 0', '"mesh": 5').encode(), "breaks the rules of glTF"),
        ("i.gltf", text.replace('"mesh": 0', '"children": [0]').encode(), "in a circle"),
    ):  # fmt: skip
        (tmp_path / name).write_bytes(content)
        with pytest.raises(MeshError, match=words):
            read_bodies(tmp_path / name)


# ---- any file ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["stl", "ply", "obj", "off", "3mf", "glb", "gltf"])
def test_whatever_is_in_a_file_it_is_a_mesh_error(tmp_path, ending):
    path = tmp_path / f"a.{ending}"
    rng = np.random.default_rng(3)
    for content, words in (
        (b"", "0 bytes"),
        (rng.bytes(1000), r"a\."),
        (b"<!DOCTYPE html><html></html>", "web page"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "Git LFS"),
        (b"\x1f\x8b" + rng.bytes(100), "gzip"),
        (b"\0" * 500, r"a\."),
    ):
        path.write_bytes(content)
        with pytest.raises(MeshError, match=words) as caught:
            read_bodies(path, "mm")
        assert "\n" not in str(caught.value)
    with pytest.raises(MeshError, match="does not exist"):
        read_bodies(tmp_path / f"none.{ending}")
    with pytest.raises(MeshError, match="is a folder"):
        read_bodies(tmp_path)


def test_what_a_file_holds_decides_how_it_is_read(tmp_path, ball):
    ball.export(tmp_path / "a.ply")
    (tmp_path / "a.ply").rename(tmp_path / "a.stl")
    assert volumes(tmp_path / "a.stl") == pytest.approx([ball.volume], rel=SINGLE)


def test_sizes_that_no_grain_has_are_asked_about(tmp_path, ball):
    ball.export(tmp_path / "a.stl")
    read_bodies(tmp_path / "a.stl", "mm")
    tiny = ball.copy()
    tiny.vertices *= 2
    tiny.export(tmp_path / "b.stl")
    with pytest.warns(GrainWarning, match="4 nm long, too short or too long"):
        read_bodies(tmp_path / "b.stl", "nm")
    tiny.vertices *= 4
    tiny.export(tmp_path / "c.stl")
    with pytest.warns(GrainWarning, match="16 m long, too short or too long"):
        read_bodies(tmp_path / "c.stl", "m")
    with pytest.raises(UnitError, match="parsec"):
        read_bodies(tmp_path / "a.stl", "parsec")


def test_voxel_surfaces_read_back_as_their_voxels(tmp_path, rng):
    mask = rng.random((6, 6, 6)) < 0.6
    mask[2:4, 2:4, :] = mask[2:4, :, 2:4] = mask[:, 2:4, 2:4] = True
    vertices, faces = voxel_surface(mask)
    (tmp_path / "a.stl").write_bytes(binary_stl(vertices[faces]))
    found = read_bodies(tmp_path / "a.stl", cavities="keep")
    assert sum(body.volume for body in found) == pytest.approx(mask.sum(), rel=1e-12)
