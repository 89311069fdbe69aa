"""Surfaces of grains that came from meshes: the meshes themselves, and coarser only where they must be."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.grains.mesh_set import grain_set_from_meshes
from mbstudio.core.metaball import Avatar
from mbstudio.scene.grain_surfaces import mesh_surface, overview_of_grains, surface_of_grain
from mbstudio.scene.layers.deviation_map import deviation_surface
from mbstudio.scene.surfaces import label_surface


@pytest.fixture
def stones(tmp_path):
    trimesh.creation.box((2, 2, 2)).export(tmp_path / "a.stl")
    trimesh.creation.icosphere(subdivisions=4).export(tmp_path / "b.stl")
    return grain_set_from_meshes(tmp_path, 24, "mm")


def volume(surface):
    return trimesh.Trimesh(surface.points, surface.triangles, process=False).volume


def test_a_mesh_is_drawn_as_it_is(stones):
    cube, ball = surface_of_grain(stones, 1), surface_of_grain(stones, 2)
    assert len(cube.triangles) == 12
    assert volume(cube) == pytest.approx(8)
    # Flat faces, not corners rounded off by shading.
    assert np.abs(cube.normals).max(axis=1) == pytest.approx(1)
    np.testing.assert_array_equal(ball.triangles, stones.meshes[2].faces)
    np.testing.assert_allclose(ball.points, stones.meshes[2].vertices, atol=1e-6)


def test_a_mesh_of_too_many_triangles_is_drawn_coarser(stones):
    ball = mesh_surface(stones.meshes[2], 1500)
    assert 700 < len(ball.triangles) < 1900
    assert volume(ball) == pytest.approx(stones.meshes[2].to_trimesh("mm").volume, rel=0.02)


def test_the_overview_knows_whose_each_triangle_is(stones):
    shown = overview_of_grains(stones, 100, 10_000)
    assert np.bincount(shown.labels).tolist() == [0, 12, len(stones.meshes[2].faces)]
    only = overview_of_grains(stones, 100, 10_000, {2})
    assert set(only.labels) == {2}
    few = overview_of_grains(stones, 100, 1000)
    assert len(few.triangles) < 1400


def test_without_meshes_the_voxels_are_drawn(stones):
    plain = type(stones)(stones.labels, stones.table, stones.voxel_size, stones.origin)
    a, b = overview_of_grains(plain, 60, 10_000), label_surface(plain, 60)
    np.testing.assert_array_equal(a.triangles, b.triangles)


def test_the_deviation_from_large_triangles_is_right(stones):
    """A ball in a cube: each of its points lies inside by what is left to the nearest face."""
    cube = stones.body(1)
    centre = np.asarray(cube.center_mass)
    found = deviation_surface(Avatar(centre[None], np.array([0.64]), "mm"), cube)
    points = np.asarray(found.surface.points, dtype=float) - centre
    expected = -(1 - np.abs(points).max(axis=1))
    np.testing.assert_allclose(found.deviation.distances, expected, atol=1e-3)
    assert found.deviation.unit == "mm"
