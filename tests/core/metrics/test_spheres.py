"""Smallest sphere around and largest sphere in bodies with known ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from benchmarks.roundness import rounded_box
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


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), exponent=st.integers(-16, -4))
def test_nearly_cospherical_corners_are_held(seed, exponent):
    """Corners of a cube moved by rounding errors, or by a little more."""
    rng = np.random.default_rng(seed)
    noise = 10.0**exponent
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    corners = corners @ Rotation.random(rng=rng).as_matrix().T + rng.uniform(-3, 3, 3)
    corners += noise * rng.normal(size=corners.shape)
    found = enclosing_sphere(corners)
    assert np.linalg.norm(corners - found.centre, axis=1).max() <= found.radius * (1 + 1e-12)
    assert found.radius == pytest.approx(math.sqrt(3), abs=5 * noise + 1e-8)


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), count=st.integers(12, 120), flat=st.floats(0.1, 1))
def test_in_a_convex_body_it_is_what_linear_programming_says(seed, count, flat):
    """Largest ball in an intersection of half spaces (Boyd and Vandenberghe 2004, section 8.5.1)."""
    points = np.random.default_rng(seed).normal(size=(count, 3)) * [1, 1, flat]
    hull = trimesh.convex.convex_hull(points)
    offsets = np.einsum("ij,ij->i", hull.face_normals, hull.triangles_center)
    rows = np.column_stack([hull.face_normals, np.ones(len(offsets))])
    centre = linprog([0, 0, 0, -1], A_ub=rows, b_ub=offsets, bounds=[(None, None)] * 3 + [(0, None)])
    assert inner(hull).radius == pytest.approx(centre.x[3], rel=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_a_sphere_off_the_grid_is_filled(seed):
    ball = turned(trimesh.creation.icosphere(5), seed)
    nearest_face = np.einsum("ij,ij->i", ball.face_normals, ball.triangles_center - ball.center_mass).min()
    assert inner(ball).radius == pytest.approx(nearest_face, rel=1e-5)


@pytest.mark.parametrize("radius", [0.1, 0.3, 0.5, 0.7, 0.9])
@pytest.mark.parametrize("edges", [(2, 2, 2), (6, 6, 2), (20, 20, 2), (20, 2, 2)])
def test_rounding_its_edges_leaves_the_sphere_in_a_box(edges, radius):
    found = inner(turned(rounded_box(edges, radius), 4))
    assert found.radius == pytest.approx(1.0, rel=1e-5)


def test_spheres_in_a_box_a_tetrahedron_and_a_torus():
    assert inner(turned(trimesh.creation.box((1, 2, 3)), 1)).radius == pytest.approx(0.5, rel=1e-9)
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    tetrahedron = turned(trimesh.convex.convex_hull(corners), 2)
    found = inner(tetrahedron)
    assert found.radius == pytest.approx(math.sqrt(8) / math.sqrt(24), rel=1e-9)
    assert found.centre == pytest.approx(tetrahedron.center_mass, abs=1e-6)
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
