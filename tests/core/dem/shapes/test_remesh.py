"""Meshes that engines take: closed, outward, well-shaped, true to the avatar."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.dem.shapes.remesh import angles_of, well_shaped_mesh
from mbstudio.core.dem.shapes.remesh_passes import collapse_edges, edges_of, flip_edges, split_edges
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import mass_properties

TETRAHEDRON = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])


@pytest.mark.parametrize("cells", [16, 32])
@pytest.mark.parametrize("kind", ["avatar", "ring", "neck"])
def test_no_thin_triangle_whatever_the_shape(kind, cells, request):
    if kind == "neck":
        body = Avatar([[-0.99, 0, 0], [0.99, 0, 0]], [0.5, 0.5], "mm")
    else:
        body = request.getfixturevalue(kind)
    volume = mass_properties(body, 1).volume
    mesh = well_shaped_mesh(body, cells, volume)
    angles = np.degrees(angles_of(np.asarray(mesh.vertices), np.asarray(mesh.faces)))
    assert angles.sum(axis=1) == pytest.approx(180)
    assert angles.min() > 22
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == (0 if kind == "ring" else 2)
    assert mesh.volume == pytest.approx(volume, rel=1e-4)
    edge = np.ptp(mesh.vertices, axis=0).max() / cells
    # u = f**(-1/2) is close to the distance over the radius: no vertex leaves the surface by much.
    shift = np.abs(body.field(np.asarray(mesh.vertices)) ** -0.5 - 1).max()
    assert shift < 0.25 * edge / np.ptp(mesh.vertices, axis=0).min()
    assert 0.7 * edge < mesh.edges_unique_length.mean() < 1.3 * edge


def _circle(points: int, radius: float, middle: float) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
    return np.stack([radius * np.cos(angle) + middle, radius * np.sin(angle), 0 * angle], axis=1)


def _kinds() -> dict[str, tuple[Avatar, int]]:
    """Avatars of different kinds, and the genus of each."""
    plate = np.stack(np.meshgrid(np.linspace(-3, 3, 13), np.linspace(-2, 2, 9), [0.0]), axis=-1).reshape(
        -1, 3
    )
    rod = np.stack([np.linspace(-5, 5, 21), np.zeros(21), np.zeros(21)], axis=1)
    eight = np.concatenate([_circle(14, 3, -3.0), _circle(14, 3, 3.0)])
    rough = np.random.default_rng(5).normal(size=(120, 3)) * [0.45, 0.3, 0.2]
    return {
        "one point": (Avatar([[1, 2, 3.0]], [2.0], "mm"), 0),
        "flake": (Avatar(plate, np.full(len(plate), 0.02), "mm"), 0),
        "rod": (Avatar(rod, np.full(21, 0.06), "mm"), 0),
        "eight": (Avatar(eight, np.full(28, 0.2), "mm"), 2),
        "many points": (Avatar(rough, np.full(120, 0.01), "mm"), 0),
    }


@pytest.mark.parametrize("cells", [8, 24])
@pytest.mark.parametrize("kind", ["one point", "flake", "rod", "eight", "many points"])
def test_all_kinds_of_avatars_get_one_closed_piece_of_their_genus(kind, cells):
    body, genus = _kinds()[kind]
    volume = mass_properties(body, 1).volume
    mesh = well_shaped_mesh(body, cells, volume)
    angles = np.degrees(angles_of(np.asarray(mesh.vertices), np.asarray(mesh.faces)))
    assert angles.min() > 22
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert mesh.euler_number == 2 - 2 * genus
    assert mesh.volume == pytest.approx(volume, rel=1e-3)


@pytest.mark.parametrize("seed", [53, 88])
def test_few_edges_are_made_shorter_rather_than_thin(seed):
    """Slabs with horns: meshes of edges as long as asked have angles of 11 and 14 degrees there."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (30, 3)) * [3, 2, 0.25]
    points[:6] += rng.uniform(-1, 1, (6, 3)) * [1, 1, 1.2]
    body = Avatar(points, rng.uniform(0.05, 0.2, 30), "mm")
    volume = mass_properties(body, 1).volume
    mesh = well_shaped_mesh(body, 8, volume)
    assert np.degrees(angles_of(np.asarray(mesh.vertices), np.asarray(mesh.faces))).min() > 15
    assert mesh.volume == pytest.approx(volume, rel=1e-3)
    assert mesh.is_watertight


def test_a_horn_thinner_than_an_edge_is_not_cut_off():
    """A ball with a horn: edges as long as asked would leave all of it out."""
    along = np.linspace(2.0, 3.2, 13)
    horn = np.stack([along, 0 * along, 0 * along], axis=1)
    body = Avatar(np.concatenate([[[0, 0, 0]], horn]), np.r_[3.0, np.full(13, 0.01)], "mm")
    mesh = well_shaped_mesh(body, 8, mass_properties(body, 1).volume)
    fine = body.mesh(96)
    left_out = fine.vertices[:, 0].max() - mesh.vertices[:, 0].max()
    assert left_out < 0.52 * fine.extents.max() / 8
    assert np.degrees(angles_of(np.asarray(mesh.vertices), np.asarray(mesh.faces))).min() > 15


def test_the_number_of_triangles_is_that_of_the_edges_asked_for():
    ball = Avatar([[0, 0, 0.0]], [1.0], "mm")
    for cells in (8, 16, 40):
        edge = 2.0 / cells
        equilateral = 4 * np.pi / (np.sqrt(3) / 4 * edge**2)
        mesh = well_shaped_mesh(ball, cells)
        assert len(mesh.faces) == pytest.approx(equilateral, rel=0.15)
        assert mesh.edges_unique_length.mean() == pytest.approx(edge, rel=0.1)


def test_without_a_volume_every_vertex_lies_on_the_surface(avatar):
    mesh = well_shaped_mesh(avatar, 20)
    assert avatar.field(np.asarray(mesh.vertices)) == pytest.approx(1, abs=1e-4)


def test_edges_of_a_tetrahedron():
    edges, pairs = edges_of(TETRAHEDRON)
    assert edges.tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]
    for (a, b), (first, second) in zip(edges, pairs, strict=True):
        assert [a, b] in [np.roll(TETRAHEDRON[first], -k)[:2].tolist() for k in range(3)]
        assert [b, a] in [np.roll(TETRAHEDRON[second], -k)[:2].tolist() for k in range(3)]


def test_a_tetrahedron_is_never_collapsed_flat():
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]])
    _, faces = collapse_edges(corners, TETRAHEDRON, 100.0, 100.0)
    assert len(faces) == 4


def test_a_split_halves_the_longest_edge_and_keeps_the_solid():
    import trimesh

    box = trimesh.creation.box((1, 1, 8))
    vertices, faces = split_edges(np.asarray(box.vertices), np.asarray(box.faces, dtype=np.int64), 5.0)
    split = trimesh.Trimesh(vertices, faces, process=False)
    assert split.is_watertight
    assert split.volume == pytest.approx(8)
    assert len(vertices) > 8


def test_a_flip_raises_the_smallest_angle():
    import trimesh

    ball = trimesh.creation.icosphere(2)
    rng = np.random.default_rng(0)
    vertices = np.asarray(ball.vertices) + rng.normal(size=ball.vertices.shape) * 0.05
    before = angles_of(vertices, np.asarray(ball.faces)).min(axis=1)
    faces = np.asarray(ball.faces, dtype=np.int64)
    for _ in range(5):
        faces = flip_edges(vertices, faces)
    flipped = trimesh.Trimesh(vertices, faces, process=False)
    assert flipped.is_watertight
    assert flipped.is_winding_consistent
    assert np.sort(angles_of(vertices, faces).min(axis=1))[:20].mean() > np.sort(before)[:20].mean()
