"""Shape factors of solids with known answers: as meshes, as voxel grains, as avatars."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mbstudio.core.errors import MeasureError, MeshError
from mbstudio.core.grains import Grain
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import bounding_box, measure
from mbstudio.core.metrics.surfaces import avatar_surface, pieces_and_voids
from tests.core.metrics.solids import (
    ellipse_perimeter,
    ellipsoid_area,
    ellipsoid_voxels,
    turned,
)

LENGTHS = ("dn", "ds", "shortest", "intermediate", "longest")
RATIOS = ("sphericity", "circularity", "csf", "dns")


def test_a_cube_projects_to_a_hexagon():
    cube = turned(trimesh.creation.box((2, 2, 2)), 1)
    found = measure(cube, unit="mm")
    hexagon_area, hexagon_perimeter = math.sqrt(3) * 4, 6 * 2 * math.sqrt(2 / 3)
    assert found.volume == pytest.approx(8)
    assert found.area == pytest.approx(24)
    assert found.sphericity == pytest.approx((math.pi / 6) ** (1 / 3))
    assert found.ds == pytest.approx(math.sqrt(4 * hexagon_area / math.pi), rel=1e-4)
    assert found.circularity == pytest.approx(
        math.pi * math.sqrt(4 * hexagon_area / math.pi) / hexagon_perimeter, rel=1e-3
    )
    assert found.csf == pytest.approx(1, rel=1e-3)
    assert found.dn == pytest.approx((48 / math.pi) ** (1 / 3))
    assert found.dns == pytest.approx(found.dn / found.ds)
    assert (found.unit, found.surface, found.axes) == ("mm", "mesh", "obb")


def test_a_box_has_the_lengths_of_its_edges():
    found = measure(turned(trimesh.creation.box((1, 2, 5)), 2))
    assert (found.shortest, found.intermediate, found.longest) == pytest.approx((1, 2, 5), rel=1e-3)
    assert found.csf == pytest.approx(1 / math.sqrt(10), rel=1e-3)
    # The projected area of a box along n is the sum of |n_i| times its faces: largest along them.
    assert math.pi * found.ds**2 / 4 == pytest.approx(math.sqrt(2**2 + 5**2 + 10**2), rel=1e-4)


def test_a_cylinder_is_widest_across_its_diagonal():
    radius, height = 1.0, 3.0
    found = measure(turned(trimesh.creation.cylinder(radius, height, sections=256), 3))
    # Seen at an angle t from the side, the side's rectangle and the end's ellipse add up.
    widest = math.hypot(2 * radius * height, math.pi * radius**2)
    assert math.pi * found.ds**2 / 4 == pytest.approx(widest, rel=1e-3)
    assert (found.shortest, found.longest) == pytest.approx((2, 3), rel=1e-3)


def test_a_torus_shows_its_hole():
    major, minor = 2.0, 0.5
    found = measure(turned(trimesh.creation.torus(major, minor, major_sections=192, minor_sections=64), 4))
    assert found.volume == pytest.approx(2 * math.pi**2 * major * minor**2, rel=3e-3)
    assert found.area == pytest.approx(4 * math.pi**2 * major * minor, rel=3e-3)
    ring = math.pi * ((major + minor) ** 2 - (major - minor) ** 2)
    assert math.pi * found.ds**2 / 4 == pytest.approx(ring, rel=2e-3)
    both_outlines = 2 * math.pi * (major + minor + major - minor)
    assert found.circularity == pytest.approx(math.pi * found.ds / both_outlines, rel=2e-3)
    assert found.shortest == pytest.approx(2 * minor, rel=2e-3)


def test_an_ellipsoid_mesh():
    a, b, c = 3.0, 2.0, 1.0
    mesh = trimesh.creation.icosphere(5)
    mesh.apply_scale([a, b, c])
    found = measure(turned(mesh, 5))
    assert found.volume == pytest.approx(4 / 3 * math.pi * a * b * c, rel=2e-3)
    assert found.area == pytest.approx(ellipsoid_area(a, b, c), rel=2e-3)
    assert found.ds == pytest.approx(2 * math.sqrt(a * b), rel=2e-3)
    assert found.circularity == pytest.approx(
        2 * math.pi * math.sqrt(a * b) / ellipse_perimeter(a, b), rel=2e-3
    )
    assert found.csf == pytest.approx(c / math.sqrt(a * b), rel=5e-3)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("radius", [8, 15, 25])
def test_an_ellipsoid_of_voxels(radius, seed):
    axes = radius * np.array([1.0, 0.8, 0.65])
    grain = Grain.from_mask(ellipsoid_voxels(axes, seed), "14 um")
    found = measure(grain)
    a, b, c = axes * 14
    volume, area = 4 / 3 * math.pi * a * b * c, ellipsoid_area(a, b, c)
    assert (found.unit, found.surface) == ("um", "crofton voxels")
    assert found.volume == grain.volume
    assert found.volume == pytest.approx(volume, rel=0.012 if radius < 15 else 0.005)
    assert found.area == pytest.approx(area, rel=0.012 if radius < 15 else 0.008)
    assert found.sphericity == pytest.approx((36 * math.pi * volume**2) ** (1 / 3) / area, rel=0.008)
    assert found.ds == pytest.approx(2 * math.sqrt(a * b), rel=0.008)
    assert found.circularity == pytest.approx(
        2 * math.pi * math.sqrt(a * b) / ellipse_perimeter(a, b), rel=0.006
    )


def test_one_control_point_is_a_sphere():
    found = measure(Avatar([[5.0, -6.0, 7.0]], [4.0], "mm"))
    assert found.volume == pytest.approx(4 / 3 * math.pi * 8, rel=1e-5)
    assert found.area == pytest.approx(16 * math.pi, rel=1e-5)
    for factor in RATIOS:
        assert getattr(found, factor) == pytest.approx(1, rel=1e-3)
    assert (found.ds, found.longest) == pytest.approx((4, 4), rel=1e-3)
    assert (found.unit, found.surface) == ("mm", "avatar")


def test_an_avatar_is_measured_as_finely_as_a_mesh_of_much_smaller_triangles():
    avatar = Avatar([[-0.6, 0, 0], [0.5, 0.3, 0], [0.2, -0.5, 0.4]], [0.5, 0.4, 0.3], "um")
    found, fine = measure(avatar), measure(avatar.mesh(cells=160))
    assert found.volume == pytest.approx(fine.volume, rel=1e-3)
    assert found.area == pytest.approx(fine.area, rel=1e-3)
    assert found.ds == pytest.approx(fine.ds, rel=1e-3)
    assert found.circularity == pytest.approx(fine.circularity, rel=2e-3)


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6), scale=st.floats(1e-3, 1e3))
def test_rotation_changes_nothing_and_scale_only_lengths(seed, scale):
    mesh = trimesh.creation.box((1.0, 1.6, 2.7))
    hollow = trimesh.creation.cylinder(0.7, 2.0, sections=24)
    for body in (mesh, hollow):
        still, moved = measure(body), turned(body, seed)
        moved.apply_scale(scale)
        found = measure(moved)
        assert found.volume == pytest.approx(still.volume * scale**3, rel=1e-6)
        assert found.area == pytest.approx(still.area * scale**2, rel=1e-6)
        for length in LENGTHS:
            assert getattr(found, length) == pytest.approx(getattr(still, length) * scale, rel=2e-3)
        for ratio in RATIOS:
            assert getattr(found, ratio) == pytest.approx(getattr(still, ratio), rel=3e-3)


@settings(max_examples=8)
@given(seed=st.integers(0, 10**6))
def test_bounds_hold_for_any_avatar_and_its_mirror_image(seed):
    rng = np.random.default_rng(seed)
    centers = rng.normal(size=(6, 3)) * 0.4
    avatar = Avatar(centers, rng.uniform(0.3, 0.6, 6), "mm")
    mirrored = Avatar(centers * [1, 1, -1], avatar.weights, "mm")
    found, other = measure(avatar), measure(mirrored)
    for ratio in RATIOS:
        assert 0 < getattr(found, ratio) <= 1 + 1e-3
    assert found.dns <= 1 + 1e-4
    assert found.shortest <= found.intermediate <= found.longest
    assert other.volume == pytest.approx(found.volume, rel=1e-4)
    assert other.sphericity == pytest.approx(found.sphericity, rel=1e-3)
    assert other.ds == pytest.approx(found.ds, rel=2e-3)


def test_units_are_stated_converted_or_openly_missing():
    cube = trimesh.creation.box()
    assert measure(cube).unit == "unitless"
    assert measure(cube, unit="micron").unit == "um"
    cube.units = "mm"
    assert measure(cube).unit == "mm"
    assert measure(cube, unit="um").volume == pytest.approx(1e9)
    assert measure(Avatar([[0, 0, 0]], [1.0], "mm"), unit="m").dn == pytest.approx(2e-3, rel=1e-4)


def test_a_mesh_that_is_no_closed_body_is_refused():
    cube = trimesh.creation.box()
    opened = trimesh.Trimesh(cube.vertices, cube.faces[:-1], process=False)
    with pytest.raises(MeshError, match="not closed"):
        measure(opened)
    pair = trimesh.util.concatenate([cube, cube.copy().apply_translation([5, 0, 0])])
    with pytest.raises(MeshError, match="2 separate bodies"):
        measure(pair)
    broken = cube.copy()
    broken.vertices[0, 0] = np.nan
    with pytest.raises(MeshError, match="finite"):
        measure(broken)
    with pytest.raises(MeshError, match="no faces"):
        measure(trimesh.Trimesh())


def test_a_mesh_turned_inside_out_is_turned_back():
    cube = trimesh.creation.box((1, 2, 3))
    cube.invert()
    assert measure(cube).volume == pytest.approx(6)
    assert cube.volume == pytest.approx(-6), "the caller's mesh must stay as it is"


def test_a_cavity_takes_volume_and_adds_area():
    outer, inner = trimesh.creation.box((4, 4, 4)), trimesh.creation.box((2, 2, 2))
    inner.invert()
    found = measure(trimesh.util.concatenate([outer, inner]))
    assert found.volume == pytest.approx(64 - 8)
    assert found.area == pytest.approx(96 + 24)


def test_an_avatar_in_pieces_is_refused():
    with pytest.raises(MeasureError, match="2 pieces"):
        measure(Avatar([[-5, 0, 0], [5, 0, 0]], [1.0, 1.0], "mm"))


@pytest.mark.parametrize("copies", ["a triangle turned", "a triangle twice", "all triangles twice"])
def test_a_mesh_that_is_closed_but_for_its_triangles_order_is_mended(copies):
    cube = trimesh.creation.box((1, 2, 3))
    faces = {
        "a triangle turned": np.r_[cube.faces[:1, ::-1], cube.faces[1:]],
        "a triangle twice": np.r_[cube.faces, cube.faces[:1]],
        "all triangles twice": np.r_[cube.faces, cube.faces],
    }[copies]
    found = measure(trimesh.Trimesh(cube.vertices, faces, process=False))
    assert found.volume == pytest.approx(6, rel=1e-12)
    assert found.area == pytest.approx(22, rel=1e-12)


def test_a_real_stone_with_a_fold_and_cavities_on_its_surface_is_measured(shared_data):
    """It is closed, though two equal triangles lie on each other and two cavities hang on edges."""
    stone = trimesh.load_mesh(shared_data / "stones" / "stone_A13.ply")
    assert measure(stone).volume == pytest.approx(379717.255, rel=1e-6)


def test_a_real_stone_with_a_hole_is_refused(shared_data):
    stone = trimesh.load_mesh(shared_data / "stones" / "stone_E22.ply")
    stone.update_faces(np.arange(len(stone.faces)) > 0)
    with pytest.raises(MeshError, match="not closed: 3 open edges bound 1 hole"):
        measure(stone)


@pytest.mark.real_data
def test_real_aggregates_measure_the_same_in_any_pose(shared_data):
    for path in sorted((shared_data / "aggregates").glob("*.ply"))[:3]:
        mesh = trimesh.load_mesh(path)
        still, moved = measure(mesh), measure(turned(mesh, 7))
        for factor in ("volume", "area", "sphericity", "circularity", "ds", "longest"):
            assert getattr(moved, factor) == pytest.approx(getattr(still, factor), rel=3e-3), path.name
        assert 0.5 < still.sphericity < 0.95


def test_rotation_objects_are_not_needed_to_know_the_direction():
    """The projection must be searched, not taken along an axis: a tilted slender box shows it."""
    box = trimesh.creation.box((1, 1, 6))
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", [33, 21, 70], degrees=True).as_matrix()
    box.apply_transform(pose)
    assert math.pi * measure(box).ds ** 2 / 4 == pytest.approx(math.sqrt(1 + 36 + 36), rel=1e-4)


def test_a_body_is_one_whatever_corner_its_faces_begin_with() -> None:
    ball = trimesh.creation.icosahedron()
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    rng = np.random.default_rng(0)
    for _ in range(50):
        turned = np.array(
            [np.roll(face, turn) for face, turn in zip(faces, rng.integers(0, 3, 20), strict=True)]
        )
        assert pieces_and_voids(vertices, turned) == (1, 0)
    assert pieces_and_voids(np.vstack([vertices, vertices + 5]), np.vstack([faces, faces + 12])) == (2, 0)


def test_axes_can_be_measured_along_the_box_of_another_body():
    grain = turned(trimesh.creation.box((1, 2, 5)), 2)
    box = bounding_box(grain)
    assert box.lengths == pytest.approx((1, 2, 5), rel=1e-3)
    egg = turned(trimesh.creation.icosphere(4), 3)
    along = measure(egg, along=box.directions)
    assert (along.shortest, along.longest) == pytest.approx((2, 2), rel=2e-3)
    turn = Rotation.from_rotvec(box.directions[2] * np.pi / 4).as_matrix()
    quarter = measure(grain, along=box.directions @ turn.T)
    assert (quarter.shortest, quarter.intermediate) == pytest.approx([3 / math.sqrt(2)] * 2, rel=5e-3)
    assert quarter.longest == pytest.approx(5, rel=2e-3)
    with pytest.raises(MeasureError, match="axes='obb', not to axes='feret'"):
        measure(grain, axes="feret", along=box.directions)


def test_the_box_of_an_avatar_is_extrapolated_to_no_edge_length():
    egg = Avatar(np.array([[0.0, 0, 0], [6, 1, 0], [2, 4, 2]]), np.array([25.0, 4, 9]), "um")
    box, nested = bounding_box(egg), avatar_surface(egg)
    coarse, fine = (np.ptp(points @ box.directions.T, axis=0) for points, _ in (nested.coarse, nested.fine))
    np.testing.assert_allclose(box.lengths, (4 * fine - coarse) / 3, rtol=1e-12)
    # Vertices on the surface fall short of its box, those of a very fine mesh hardly.
    true = np.ptp(np.asarray(egg.mesh(cells=300).vertices) @ box.directions.T, axis=0)
    assert np.abs(box.lengths / true - 1).mean() < 0.7 * np.abs(fine / true - 1).mean()
    found = measure(egg)
    assert (found.shortest, found.intermediate, found.longest) == tuple(box.lengths)
