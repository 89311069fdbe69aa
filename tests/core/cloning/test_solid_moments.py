"""Moments of closed surfaces against analytic solids."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from mbstudio.core.cloning.solid_moments import make_isotropic, principal_form, solid_moments


def test_a_box_has_its_moments() -> None:
    box = trimesh.creation.box((1.0, 2.0, 4.0))
    shifted = np.add(box.vertices, [10.0, -20.0, 5.0])
    moments = solid_moments(shifted, np.asarray(box.faces))
    assert moments.volume == pytest.approx(8.0)
    assert moments.centre == pytest.approx([10.0, -20.0, 5.0])
    assert moments.second == pytest.approx(np.diag([1.0, 4.0, 16.0]) / 12, abs=1e-12)


def test_a_body_wound_inwards_has_a_negative_volume() -> None:
    box = trimesh.creation.box()
    assert solid_moments(np.asarray(box.vertices), np.asarray(box.faces)[:, ::-1]).volume == pytest.approx(
        -1.0
    )


def test_an_ellipsoid_has_its_own_semi_axes() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5)
    turn = trimesh.transformations.random_rotation_matrix(np.array([0.1, 0.5, 0.8]))[:3, :3]
    vertices = np.asarray(ball.vertices) * [1.0, 3.0, 2.0] @ turn.T
    semi_axes, axes = principal_form(solid_moments(vertices, np.asarray(ball.faces)))
    assert semi_axes == pytest.approx([3.0, 2.0, 1.0], rel=2e-3)
    assert abs(axes.T @ turn[:, [1, 2, 0]]) == pytest.approx(np.eye(3), abs=1e-6)
    assert np.linalg.det(axes) == pytest.approx(1.0)


@given(st.integers(0, 10_000))
def test_the_isotropic_frame_has_no_direction_of_its_own(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=2)
    matrix = rng.normal(size=(3, 3)) + 2 * np.eye(3)
    if np.linalg.det(matrix) < 0.1:
        matrix = np.eye(3)
    vertices = np.asarray(ball.vertices) * (1 + 0.1 * rng.random((162, 1))) @ matrix.T + rng.normal(size=3)
    isotropic, _ = make_isotropic(vertices, np.asarray(ball.faces))
    moments = solid_moments(isotropic, np.asarray(ball.faces))
    assert moments.centre == pytest.approx(np.zeros(3), abs=1e-9)
    assert moments.second == pytest.approx(np.eye(3) / 5, abs=1e-9)
