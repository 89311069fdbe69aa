"""The mesh of an avatar, its volume and area, against spheres."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import AvatarError
from mbstudio.core.metaball import Avatar
from mbstudio.core.metaball.surface import project_to_surface, volume_and_area

SPHERE = Avatar([[10, -20, 30]], [4.0], "um")  # radius 2
BALL = 4 / 3 * np.pi * 8


def test_mesh_of_a_sphere_is_closed_outward_and_in_place() -> None:
    mesh = SPHERE.mesh(cells=64)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(BALL, rel=1e-3)
    assert mesh.area == pytest.approx(4 * np.pi * 4, rel=1e-3)
    assert mesh.units == "um"
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - [10, -20, 30], axis=1), 2, rtol=1e-9)


def test_vertices_lie_on_the_surface() -> None:
    rng = np.random.default_rng(1)
    avatar = Avatar(rng.normal(size=(20, 3)) * 0.5, rng.uniform(0.01, 0.1, 20), "mm")
    mesh = avatar.mesh(48)
    np.testing.assert_allclose(avatar.field(mesh.vertices), 1, atol=1e-6)
    assert mesh.is_watertight
    outward = np.einsum("ij,ij->i", mesh.vertex_normals, avatar.gradient(mesh.vertices))
    assert (outward < 0).mean() > 0.999  # f falls outward


def test_mesh_of_two_separate_spheres_has_two_bodies() -> None:
    mesh = Avatar([[0, 0, 0], [100, 0, 0]], [1.0, 1.0], "mm").mesh(300)
    assert mesh.body_count == 2
    assert mesh.is_watertight


def test_a_mesh_needs_some_cells() -> None:
    with pytest.raises(AvatarError, match="at least 4"):
        SPHERE.mesh(cells=2)


@pytest.mark.parametrize(("cells", "tolerance"), [(16, 2e-3), (40, 2e-4), (64, 5e-5)])
def test_quadrature_of_a_sphere(cells: int, tolerance: float) -> None:
    volume, area = volume_and_area(SPHERE.control, cells)
    assert volume == pytest.approx(BALL, rel=tolerance)
    assert area == pytest.approx(16 * np.pi, rel=5e-3)


def test_quadrature_agrees_with_a_fine_mesh_where_the_field_is_not_a_sphere() -> None:
    rng = np.random.default_rng(5)
    avatar = Avatar(rng.normal(size=(30, 3)) * 0.4, rng.uniform(0.01, 0.05, 30), "mm")
    mesh = avatar.mesh(160)
    volume, area = volume_and_area(avatar.control, 64)
    assert volume == pytest.approx(mesh.volume, rel=1e-3)
    assert area == pytest.approx(mesh.area, rel=1e-2)


def test_projection_ends_on_the_surface() -> None:
    points = np.array([[13.0, -20, 30], [10, -21, 30], [11, -19, 31]])
    moved = project_to_surface(points, SPHERE.control)
    np.testing.assert_allclose(np.linalg.norm(moved - [10, -20, 30], axis=1), 2, rtol=1e-12)
