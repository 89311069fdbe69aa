"""Grains from surface meshes: exact voxels in the mesh's own frame, and clear refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from mbstudio.core.errors import GrainError, GrainWarning, MeshError, UnitError
from mbstudio.core.grains import Grain
from mbstudio.core.grains.voxelisation import voxelise


def test_a_box_on_round_numbers_is_exact() -> None:
    """Rays through edges and corners: a box whose faces lie on voxel borders fills whole voxels."""
    box = trimesh.creation.box(extents=(8, 6, 4))
    grain = Grain.from_mesh(box, resolution=8, unit="mm")
    assert grain.mask.shape == (4, 6, 8)
    assert grain.mask.all()
    assert grain.voxel_size.zyx == (1, 1, 1)
    assert grain.origin == (-3.5, -2.5, -1.5)
    assert grain.volume == box.volume


def test_rays_through_corners_and_edges() -> None:
    """Voxel centres exactly on the mesh's edges: an octahedron, known by |x| + |y| + |z| < r."""
    radius = 6.0
    corners = radius * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    inside = voxelise(corners, np.array(faces), np.full(3, -8.0), 1.0, (17, 17, 17))
    z, y, x = np.ogrid[-8:9, -8:9, -8:9]
    norm = np.abs(z) + np.abs(y) + np.abs(x)
    assert inside[norm < radius].all()
    assert not inside[norm > radius].any()


def test_winding_agrees_with_a_ray_caster(rng: np.random.Generator) -> None:
    """Against trimesh's own test, on a concave body in an odd position."""
    body = trimesh.creation.annulus(r_min=3, r_max=7, height=5)
    body.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
    low, high = body.bounds
    shape = tuple(int(count) for count in np.ceil((high - low) / 0.7).astype(int)[::-1] + 2)
    inside = voxelise(body.vertices, body.faces, low - 0.7, 0.7, shape)
    places = np.argwhere(np.ones(shape, bool))[:, ::-1] * 0.7 + low - 0.7
    np.testing.assert_array_equal(inside.ravel(), body.contains(places))


@pytest.mark.parametrize("ending", ["stl", "obj", "ply"])
def test_files_of_every_kind_in_the_meshs_frame(tmp_path: Path, ending: str) -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=3.0)
    ball.apply_translation((10, 20, -30))
    path = tmp_path / f"pebble.{ending}"
    ball.export(path)
    grain = Grain.from_mesh(str(path), resolution=60, unit="mm")
    assert max(grain.mask.shape) == 60
    assert grain.volume == pytest.approx(ball.volume, rel=2e-3)
    np.testing.assert_allclose(grain.centroid, (10, 20, -30), atol=0.01)
    assert grain.name == "pebble"
    surface = grain.surface_mesh()
    assert surface.volume == pytest.approx(ball.volume, rel=3e-3)
    assert np.abs(np.linalg.norm(surface.vertices - [10, 20, -30], axis=1) - 3).max() < 0.1


def test_an_inverted_or_mixed_orientation_is_repaired() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    inverted = ball.copy()
    inverted.invert()
    mixed = trimesh.Trimesh(
        ball.vertices, np.where(np.arange(len(ball.faces))[:, None] % 3 == 0, ball.faces[:, ::-1], ball.faces)
    )
    expected = Grain.from_mesh(ball, 30, unit="m").mask
    for turned in (inverted, mixed):
        np.testing.assert_array_equal(Grain.from_mesh(turned, 30, unit="m").mask, expected)


def test_the_unit_is_asked_for() -> None:
    ball = trimesh.creation.icosphere()
    with pytest.raises(UnitError, match="unit='mm'"):
        Grain.from_mesh(ball)
    with pytest.raises(UnitError, match="parsec"):
        Grain.from_mesh(ball, unit="parsec")
    ball.units = "mm"
    assert Grain.from_mesh(ball, 20).unit == "mm"


def test_open_meshes_are_refused(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    ball.update_faces(np.arange(len(ball.faces)) != 7)
    path = tmp_path / "open.ply"
    ball.export(path)
    with pytest.raises(MeshError, match=r"open\.ply is not closed: 3 open edges"):
        Grain.from_mesh(path, unit="mm")


def test_other_meshes_that_are_no_grain(tmp_path: Path) -> None:
    one, two = trimesh.creation.icosphere(), trimesh.creation.icosphere()
    two.apply_translation((5, 0, 0))
    with pytest.raises(MeshError, match="2 separate bodies"):
        Grain.from_mesh(trimesh.util.concatenate([one, two]), unit="mm")
    with pytest.raises(MeshError, match="does not exist"):
        Grain.from_mesh(tmp_path / "nothing.ply", unit="mm")
    broken = tmp_path / "broken.ply"
    for content in (b"", b"ply\nformat ascii 1.0\nelement vertex 3\n"):
        broken.write_bytes(content)
        with pytest.raises(MeshError, match=r"broken\.ply"):
            Grain.from_mesh(broken, unit="mm")
    with pytest.raises(GrainError, match="resolution"):
        Grain.from_mesh(one, resolution=1, unit="mm")


def test_two_balls_on_a_thread_fall_apart() -> None:
    """A bridge thinner than a voxel is lost, and that is said."""
    one = trimesh.creation.icosphere(subdivisions=3)
    thread = trimesh.creation.cylinder(radius=0.004, segment=((0.5, 0.003, 0.002), (3.2, 0.003, 0.002)))
    two = trimesh.creation.icosphere(subdivisions=3, radius=0.7)
    two.apply_translation((3, 0, 0))
    body = trimesh.boolean.union([one, thread, two], engine="manifold")
    with pytest.warns(GrainWarning, match="2 pieces"):
        grain = Grain.from_mesh(body, resolution=40, unit="mm")
    assert grain.volume == pytest.approx(one.volume, rel=0.03)


@pytest.mark.real_data
def test_real_stones(shared_data: Path) -> None:
    """Stone A13 is closed: a fold of two equal triangles, two tiny cavities that hang on to its surface."""
    with pytest.warns(GrainWarning, match=r"stone_A13\.ply has 2 enclosed cavities \(0\.09% of its volume\)"):
        grain = Grain.from_mesh(shared_data / "stones" / "stone_A13.ply", 60, unit="mm")
    assert grain.volume == pytest.approx(380062.1, rel=0.005)
    for path in (
        sorted((shared_data / "aggregates").glob("*.ply"))[:4]
        + sorted((shared_data / "cement").glob("*.ply"))[:4]
    ):
        mesh = trimesh.load(path)
        grain = Grain.from_mesh(path, resolution=60, unit="mm")
        assert grain.volume == pytest.approx(mesh.volume, rel=0.005)
        np.testing.assert_allclose(grain.centroid, mesh.center_mass, atol=0.005 * mesh.extents.max())
