"""From triangles to closed bodies: volumes of known bodies at every scale, whatever disorder they come in."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from mbstudio.core.errors import GrainWarning, MeshError
from mbstudio.core.grains import Grain
from mbstudio.core.meshes.bodies import read_bodies, separate_bodies
from mbstudio.core.meshes.closing import closed_shells
from mbstudio.core.meshes.reading import read_mesh_data
from mbstudio.core.metrics import measure
from tests.core.meshes.mesh_writing import voxel_surface

EXACT = 1e-12
SCALES = (1e-9, 1e-3, 1.0, 1e6)


def bodies(vertices, faces, **options):
    return separate_bodies(np.asarray(vertices, float), np.asarray(faces), "a.stl", **options)


def volumes(vertices, faces, **options):
    return [body.volume for body in bodies(vertices, faces, **options)]


def joined(*meshes):
    both = trimesh.util.concatenate(list(meshes))
    return np.asarray(both.vertices), np.asarray(both.faces)


def moved(mesh, *shift, factor=1.0, inverted=False):
    other = mesh.copy()
    other.apply_scale(factor)
    other.apply_translation(shift or (0, 0, 0))
    if inverted:
        other.invert()
    return other


def flat_volume(mesh):
    a, b, c = (np.asarray(mesh.vertices)[mesh.faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


# ---- known volumes at every scale -------------------------------------------------------------------


@pytest.mark.parametrize("scale", SCALES)
def test_a_box_has_its_volume_at_every_scale(scale):
    box = trimesh.creation.box((1, 2, 3))
    assert volumes(box.vertices * scale, box.faces) == pytest.approx([6 * scale**3], rel=EXACT)
    soup = (box.vertices * scale)[box.faces].reshape(-1, 3)
    assert volumes(soup, np.arange(36).reshape(-1, 3)) == pytest.approx([6 * scale**3], rel=EXACT)


@pytest.mark.parametrize("scale", SCALES)
def test_an_ellipsoid_a_hollow_ball_and_two_balls_at_every_scale(scale):
    ball = trimesh.creation.icosphere(subdivisions=3)
    whole = flat_volume(ball)
    half_axes = np.array([3.0, 2.0, 1.0])
    ellipsoid = ball.vertices * half_axes
    assert volumes(ellipsoid * scale, ball.faces) == pytest.approx([6 * whole * scale**3], rel=EXACT)
    vertices, faces = joined(ball, moved(ball, factor=0.5, inverted=True))
    kept = volumes(vertices * scale, faces, cavities="keep")
    assert kept == pytest.approx([whole * 0.875 * scale**3], rel=EXACT)
    assert volumes(vertices * scale, faces) == pytest.approx([whole * scale**3], rel=EXACT)
    vertices, faces = joined(ball, moved(ball, 5, 0, 0, factor=2))
    assert volumes(vertices * scale, faces) == pytest.approx(
        [whole * scale**3, 8 * whole * scale**3], rel=EXACT
    )


@pytest.mark.filterwarnings("ignore:.*too short or too long")
@pytest.mark.parametrize("scale", SCALES)
def test_grains_and_factors_are_the_same_at_every_scale(scale):
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.vertices *= (1.0, 1.3, 0.8)
    scaled = trimesh.Trimesh(ball.vertices * scale, ball.faces, process=False)
    grain, other = Grain.from_mesh(ball, 30, unit="m"), Grain.from_mesh(scaled, 30, unit="m")
    np.testing.assert_array_equal(grain.mask, other.mask)
    assert other.volume == pytest.approx(grain.volume * scale**3, rel=EXACT)
    one, two = measure(ball), measure(scaled)
    assert two.volume == pytest.approx(one.volume * scale**3, rel=EXACT)
    for name in ("sphericity", "circularity", "csf", "ei", "fi"):
        if hasattr(one, name):
            assert getattr(two, name) == pytest.approx(getattr(one, name), rel=1e-9)


def test_far_from_the_origin():
    """Coordinates of a mine: the volume keeps what the coordinates keep."""
    box = trimesh.creation.box((1, 2, 3))
    assert volumes(box.vertices + 2.0**22, box.faces) == pytest.approx([6], rel=EXACT)


# ---- laws -------------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), subdivisions=st.integers(0, 2), scale=st.integers(-30, 30))
def test_renumbering_and_turning_changes_nothing(seed, subdivisions, scale):
    """Vertices renumbered, unused ones added, faces shuffled, rolled and turned; powers of two are exact."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    points = ball.vertices * rng.uniform(0.5, 2, 3)
    expected = volumes(points, ball.faces)[0]
    order = rng.permutation(len(points) + 5)
    padded = np.concatenate([points, rng.normal(size=(5, 3)) * 100])
    renumbered = np.empty(len(order), int)
    renumbered[order] = np.arange(len(order))
    faces = renumbered[ball.faces][rng.permutation(len(ball.faces))]
    faces = np.stack([np.roll(face, rng.integers(3)) for face in faces])
    turned = rng.random(len(faces)) < 0.5
    faces[turned] = faces[turned, ::-1]
    found = volumes(padded[order] * 2.0**scale, faces)
    assert found == pytest.approx([expected * 8.0**scale], rel=EXACT)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_copies_and_degenerate_faces_change_nothing(seed):
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=2)
    copies = ball.faces[rng.integers(0, len(ball.faces), 20)]
    copies[::2] = copies[::2, ::-1]
    lines = np.stack([ball.faces[:7, 0], ball.faces[:7, 1], ball.faces[:7, 0]], axis=1)
    faces = np.concatenate([ball.faces, copies, lines])[rng.permutation(len(ball.faces) + 27)]
    assert volumes(ball.vertices, faces) == pytest.approx([flat_volume(ball)], rel=EXACT)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_voxels_that_touch_in_edges_and_corners_keep_their_volume(seed):
    """Random voxels: their surface meets itself in edges of four triangles and in corners."""
    rng = np.random.default_rng(seed)
    mask = rng.random((5, 5, 5)) < rng.uniform(0.05, 0.95)
    mask[2, 2, 2] = True
    vertices, faces = voxel_surface(mask)
    faces = faces[rng.permutation(len(faces))]
    assert sum(volumes(vertices, faces, cavities="keep")) == pytest.approx(mask.sum(), rel=1e-9)


# ---- bodies that touch ------------------------------------------------------------------------------


@pytest.mark.parametrize("shift", [(1, 1, 0), (1, 1, 1), (0, 1, -1)])
@pytest.mark.parametrize("inverted", [False, True])
def test_cells_that_touch_are_one_body(shift, inverted):
    box = trimesh.creation.box()
    vertices, faces = joined(box, moved(box, *shift, inverted=inverted))
    assert volumes(vertices, faces) == pytest.approx([2], rel=EXACT)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert measure(mesh).volume == pytest.approx(2, rel=EXACT)
    assert Grain.from_mesh(mesh, 40, unit="mm").volume == pytest.approx(2, rel=0.02)


@pytest.mark.parametrize("same_triangles", [True, False])
def test_walls_between_cells_go(same_triangles):
    """Two cells with a common wall, exported each with its own: the area is that of both together."""
    box = trimesh.creation.box()
    other = moved(box, 1, 0, 0)
    if same_triangles:
        other = trimesh.Trimesh(box.vertices * (-1, 1, 1) + (1, 0, 0), box.faces[:, ::-1], process=False)
    (body,) = bodies(*joined(box, other))
    assert body.volume == pytest.approx(2, rel=EXACT)
    assert body.area == pytest.approx(10, rel=EXACT)


def test_two_bodies_are_two_and_specks_are_told():
    ball = trimesh.creation.icosphere(subdivisions=2)
    notes: list[str] = []
    found = bodies(*joined(ball, moved(ball, 4, 0, 0), moved(ball, 0, 9, 0, factor=1e-3)), notes=notes)
    assert len(found) == 2
    assert notes == [
        "contains 1 specks of less than a millionth of its largest body's volume, which were left out"
    ]
    both = trimesh.util.concatenate([ball, moved(ball, 4, 0, 0)])
    for take in (measure, lambda mesh: Grain.from_mesh(mesh, unit="mm")):
        with pytest.raises(MeshError, match="contains 2 separate bodies"):
            take(both)


def test_an_inverted_body_beside_another_is_no_cavity():
    box = trimesh.creation.box((4, 4, 4))
    assert volumes(*joined(box, moved(box, 9, 0, 0, factor=0.5, inverted=True))) == pytest.approx([64, 8])
    with pytest.raises(MeshError, match="2 separate bodies"):
        measure(trimesh.util.concatenate([box, moved(box, 9, 0, 0, factor=0.5, inverted=True)]))


def test_bodies_that_overlap_are_refused():
    ball = trimesh.creation.icosphere(subdivisions=3)
    for shift in ((1, 0, 0), (0.7, 0.3, 0.2), (1.5, 0.1, 0)):
        with pytest.raises(MeshError, match="overlap"):
            bodies(*joined(ball, moved(ball, *shift)))


# ---- hollow bodies ----------------------------------------------------------------------------------


@pytest.mark.parametrize("inverted", [True, False])
def test_cavities_are_filled_with_a_warning_or_kept(inverted):
    """Whichever way the inner shell is wound; a body within the cavity goes or stays with it."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    whole = flat_volume(ball)
    hollow = trimesh.util.concatenate([ball, moved(ball, 0.1, 0, 0, factor=0.5, inverted=inverted)])
    notes: list[str] = []
    assert volumes(hollow.vertices, hollow.faces, notes=notes) == pytest.approx([whole], rel=EXACT)
    assert "1 enclosed cavity (12.50% of its volume), which was filled" in notes[0]
    with pytest.warns(GrainWarning, match="12.50% of its volume"):
        filled = Grain.from_mesh(hollow, 50, unit="mm")
    kept = Grain.from_mesh(hollow, 50, unit="mm", cavities="keep")
    assert filled.filled_voxels == pytest.approx(filled.voxel_count - kept.voxel_count, rel=0.02)
    assert kept.volume == pytest.approx(0.875 * whole, rel=0.01)
    assert measure(hollow).volume == pytest.approx(0.875 * whole, rel=EXACT)
    nested = joined(hollow, moved(ball, 0.1, 0, 0, factor=0.2))
    assert volumes(*nested) == pytest.approx([whole], rel=EXACT)
    assert volumes(*nested, cavities="keep") == pytest.approx([0.875 * whole, 0.008 * whole], rel=1e-9)


def test_two_cavities_of_a_box_and_one_that_hangs_on_a_corner():
    box = trimesh.creation.box((4, 4, 4))
    inner = [moved(box, *shift, factor=0.25, inverted=True) for shift in ((1, 1, 1), (-1, -1, -1))]
    vertices, faces = joined(box, *inner)
    assert volumes(vertices, faces, cavities="keep") == pytest.approx([62], rel=EXACT)
    mask = np.ones((4, 4, 4), bool)
    mask[1, 1, 1] = mask[2, 2, 2] = False  # they touch in a corner
    assert volumes(*voxel_surface(mask), cavities="keep") == pytest.approx([62], rel=EXACT)
    assert volumes(*voxel_surface(mask)) == pytest.approx([64], rel=EXACT)


# ---- what is not closed -----------------------------------------------------------------------------


def test_where_and_how_large_the_hole_is():
    box = trimesh.creation.box((2, 2, 2))
    split = box.subdivide().subdivide()
    centres = split.triangles_center
    gone = int(np.linalg.norm(centres - (1, 0.3, -0.6), axis=1).argmin())
    with pytest.raises(MeshError) as caught:
        bodies(split.vertices, np.delete(split.faces, gone, axis=0))
    words = str(caught.value)
    assert (
        "a.stl is not closed: 3 open edges bound 1 hole, the largest 0.707 wide (35 % of its length)" in words
    )
    place = [float(word) for word in words.split("near (")[1].split(")")[0].split(", ")]
    np.testing.assert_allclose(place, centres[gone], atol=0.2)
    with pytest.raises(MeshError, match="6 open edges bound 2 holes"):
        bodies(split.vertices, np.delete(split.faces, [0, 100], axis=0))


@pytest.mark.parametrize("scale", SCALES)
def test_seams_of_rounding_are_sewn_and_wide_ones_are_not(scale):
    """Corners named with six digits, or moved by single precision: as wide as rounding at any scale."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    rng = np.random.default_rng(1)
    soup = np.asarray(ball.triangles).reshape(-1, 3) + np.array([20, 0, 0])
    faces = np.arange(len(soup)).reshape(-1, 3)
    shaken = (soup + rng.uniform(-1e-6, 1e-6, soup.shape)) * scale
    notes: list[str] = []
    assert volumes(shaken, faces, notes=notes) == pytest.approx([ball.volume * scale**3], rel=1e-5)
    assert "seams open by up to" in notes[0]
    with pytest.raises(MeshError, match="not closed"):
        bodies((soup + rng.uniform(-1e-3, 1e-3, soup.shape)) * scale, faces)


def test_other_surfaces_that_are_no_body():
    box = trimesh.creation.box()
    wall = np.array([[0, 1, 2]])
    strip = np.array([[i, (i + 1) % 5, (i + 2) % 5] for i in range(5)])
    angles = np.arange(5) * 2 * np.pi / 5
    ring = np.stack([np.cos(angles), np.sin(angles), np.sin(2 * angles)], axis=1)
    for vertices, faces, words in (
        (box.vertices, box.faces[:0], "no faces"),
        (np.where(np.arange(8)[:, None] == 3, np.nan, box.vertices), box.faces, "not finite"),
        (box.vertices * 1e120, box.faces, "not lengths"),
        (box.vertices * (1, 1, 0), box.faces, "no volume"),
        (box.vertices, np.array([[0, 0, 1], [2, 2, 2]]), "no volume"),
        (box.vertices, np.concatenate([wall, wall[:, ::-1]]), "not closed"),
        (ring, strip, "not closed"),
    ):
        with pytest.raises(MeshError, match=words):
            bodies(vertices, faces)
    inner = np.concatenate([box.faces, [[0, 3, 7]]])
    with pytest.raises(MeshError, match=r"not closed|inner wall"):
        bodies(box.vertices, inner)


def test_vertices_that_no_face_uses_may_be_anything():
    box = trimesh.creation.box()
    vertices = np.concatenate([box.vertices, [[np.nan, 0, 0], [1e30, 0, 0]]])
    (body,) = bodies(vertices, box.faces)
    assert len(body.vertices) == 8
    mesh = trimesh.Trimesh(vertices, box.faces, process=False)
    assert measure(mesh).volume == pytest.approx(1, rel=EXACT)
    assert Grain.from_mesh(mesh, 8, unit="mm").volume == pytest.approx(1, rel=EXACT)


def test_scenes_are_joined_and_other_things_refused():
    box = trimesh.creation.box((1, 2, 3))
    scene = trimesh.Scene([box])
    assert Grain.from_mesh(scene, 12, unit="mm").volume == pytest.approx(6, rel=EXACT)
    assert measure(scene).volume == pytest.approx(6, rel=EXACT)
    for nothing in (None, 5, trimesh.PointCloud(box.vertices)):
        with pytest.raises(MeshError, match="not a triangle mesh"):
            Grain.from_mesh(nothing, 12, unit="mm")


def box_with_a_void_at_its_surface():
    """A cube of edge 4 with a void, a tetrahedron of 4/3, that touches the upper face along an edge."""
    vertices = np.array(
        [(0, 0, 4), (4, 0, 4), (4, 4, 4), (0, 4, 4), (1, 2, 4), (3, 2, 4),
         (0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0), (2, 1, 2), (2, 3, 2)], float,
    )  # fmt: skip
    upper = [(0, 1, 5), (0, 5, 4), (1, 2, 5), (2, 4, 5), (2, 3, 4), (3, 0, 4)]
    others = [
        (6, 8, 7), (6, 9, 8), (0, 6, 7), (0, 7, 1), (1, 7, 8), (1, 8, 2), (2, 8, 9), (2, 9, 3), (3, 9, 6),
        (3, 6, 0),
    ]  # fmt: skip
    void = [(4, 5, 10), (4, 11, 5), (4, 10, 11), (5, 11, 10)]
    return vertices, np.array(upper + others + void)


def test_a_void_that_touches_the_surface_along_an_edge_is_a_cavity():
    """As public scans of stones have it: that edge is one of four triangles, and nothing is open."""
    vertices, faces = box_with_a_void_at_its_surface()
    notes = []
    (filled,) = separate_bodies(vertices, faces, "stone", notes=notes)
    assert filled.volume == pytest.approx(64)
    assert "1 enclosed cavity (2.08% of its volume)" in notes[0]
    (kept,) = separate_bodies(vertices, faces, "stone", cavities="keep")
    assert kept.volume == pytest.approx(64 - 4 / 3)


def winding_number(place, points, faces):
    """How often a surface goes around a place, by the solid angles of its triangles."""
    a, b, c = (points[faces[:, corner]] - place for corner in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    up = np.einsum("ij,ij->i", a, np.cross(b, c))
    down = la * lb * lc + sum(
        np.einsum("ij,ij->i", *pair) * length for pair, length in (((a, b), lc), ((b, c), la), ((c, a), lb))
    )
    return 2 * np.arctan2(up, down).sum() / (4 * np.pi)


def test_cavities_of_a_scanned_stone_are_there(shared_data):
    """Where shells lie within the stone, its file goes around nothing: they are cavities, as is told."""
    data = read_mesh_data(shared_data / "stones" / "stone_A13.ply")
    shells = closed_shells(data.vertices, data.faces, data.parts, "A13", [])
    for void in shells[1:]:
        middle = void.points.mean(axis=0)  # of convex ones, as these are
        assert abs(winding_number(middle, void.points, void.faces)) == pytest.approx(1, abs=1e-6)
        assert winding_number(middle, shells[0].points, shells[0].faces) == pytest.approx(1, abs=1e-6)
        assert winding_number(middle, data.vertices, data.faces) == pytest.approx(0, abs=1e-6)
    with pytest.warns(GrainWarning, match=r"2 enclosed cavities \(0\.09% of its volume\)"):
        read_bodies(shared_data / "stones" / "stone_A13.ply", "mm")
