"""Smallest sphere around and largest sphere in bodies with known ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from mbstudio.core.metrics.curvature import smooth_body
from mbstudio.core.metrics.spheres import enclosing_sphere, inscribed_sphere
from tests.core.metrics.solids import turned


def inner(mesh):
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    grid = smooth_body(vertices, faces, (6 * mesh.volume / math.pi) ** (1 / 3))
    return inscribed_sphere(vertices, faces, grid.inside, grid.edge, grid.origin)


def test_two_three_or_four_points_hold_the_sphere():
    pair = np.array([[0, 0, 0], [2, 0, 0], [1, 0.3, 0], [1, 0, -0.9]], dtype=float)
    assert enclosing_sphere(pair).radius == pytest.approx(1)
    assert enclosing_sphere(pair).centre == pytest.approx([1, 0, 0])
    triangle = np.array([[1, 0, 0], [-0.5, math.sqrt(3) / 2, 0], [-0.5, -math.sqrt(3) / 2, 0], [0, 0, 0.5]])
    assert enclosing_sphere(triangle).radius == pytest.approx(1)
    four = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    assert enclosing_sphere(four).radius == pytest.approx(math.sqrt(3))


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), count=st.integers(2, 60))
def test_it_holds_all_points_and_cannot_shrink(seed, count):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    found = enclosing_sphere(points)
    distances = np.linalg.norm(points - found.centre, axis=1)
    assert distances.max() <= found.radius * (1 + 1e-9)
    # The smallest: its centre is in the hull of the points that it touches, so that every half space
    # through the centre holds one of them.
    touching = points[distances > found.radius * (1 - 1e-7)] - found.centre
    directions = np.random.default_rng(0).normal(size=(500, 3))
    assert (touching @ directions.T).max(axis=0).min() >= -1e-6 * np.linalg.norm(directions, axis=1).max()


def test_spheres_in_a_box_a_tetrahedron_and_a_torus():
    assert inner(turned(trimesh.creation.box((1, 2, 3)), 1)).radius == pytest.approx(0.5, rel=1e-3)
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    tetrahedron = turned(trimesh.convex.convex_hull(corners), 2)
    found = inner(tetrahedron)
    assert found.radius == pytest.approx(math.sqrt(8) / math.sqrt(24), rel=1e-3)
    assert found.centre == pytest.approx(tetrahedron.center_mass, abs=2e-3)
    torus = turned(trimesh.creation.torus(2, 0.6, major_sections=96, minor_sections=48), 3)
    assert inner(torus).radius == pytest.approx(0.6, rel=5e-3)


def test_the_larger_of_two_rooms_is_chosen():
    balls = [
        trimesh.creation.icosphere(4, 1.0),
        trimesh.creation.icosphere(4, 1.04).apply_translation([3, 0, 0]),
    ]
    neck = trimesh.creation.cylinder(0.3, segment=[[0, 0, 0], [3, 0, 0]])
    found = inner(trimesh.boolean.union([*balls, neck], engine="manifold"))
    assert found.radius == pytest.approx(1.04, rel=5e-3)
    assert found.centre == pytest.approx([3, 0, 0], abs=0.02)
