"""Caliper diameters of bodies that can be worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from mbstudio.core.metrics.axes import convex_hull
from mbstudio.core.metrics.feret import feret_diameters
from tests.core.metrics.solids import turned


def lengths_of(points):
    return feret_diameters(convex_hull(np.asarray(points))).lengths


def test_a_box():
    a, b, c = 1.0, 2.0, 5.0
    found = lengths_of(turned(trimesh.creation.box((a, b, c)), 3).vertices)
    assert found[0] == pytest.approx(a, rel=1e-4)
    assert found[2] == pytest.approx(math.sqrt(a * a + b * b + c * c))
    # Across the diagonal from corner to corner: the longest of the other three, seen along the first.
    diagonal = np.array([a, b, c]) / found[2]
    others = [np.array([-a, b, c]), np.array([a, -b, c]), np.array([a, b, -c])]
    assert found[1] == pytest.approx(max(np.linalg.norm(o - (o @ diagonal) * diagonal) for o in others))


def test_the_least_width_of_a_tetrahedron_lies_between_two_edges():
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    found = lengths_of(corners @ Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix().T)
    edge = math.sqrt(8)
    # Its height is 0.816 edges, the distance of opposite edges only 0.707.
    assert found == pytest.approx([edge / math.sqrt(2), edge, edge], rel=1e-4)


def test_a_disc_and_an_ellipsoid():
    disc = turned(trimesh.creation.cylinder(3.0, 1.0, sections=200), 4)
    # Across the diagonal, a direction turned by t out of the disc's plane: disc and rim together.
    t = np.linspace(0, np.pi / 2, 2001)
    middle = (6 * np.hypot(np.cos(t), np.sin(t) / math.sqrt(37)) + np.sin(t) * 6 / math.sqrt(37)).max()
    assert lengths_of(disc.vertices) == pytest.approx([1, middle, math.hypot(6, 1)], rel=2e-3)
    ellipsoid = trimesh.creation.icosphere(5)
    ellipsoid.apply_scale([3, 2, 1])
    assert lengths_of(turned(ellipsoid, 5).vertices) == pytest.approx([2, 4, 6], rel=2e-3)


def test_the_largest_is_that_of_all_pairs():
    points = np.random.default_rng(6).normal(size=(400, 3)) * [1, 1.2, 1.1]
    brute = np.linalg.norm(points[:, None] - points[None], axis=2).max()
    assert lengths_of(points)[2] == pytest.approx(brute, rel=1e-12)


def test_no_direction_of_many_is_narrower():
    points = np.random.default_rng(7).normal(size=(60, 3)) * [1, 1.4, 1.2]
    directions = np.random.default_rng(8).normal(size=(40_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    brute = np.ptp(directions @ points.T, axis=1).min()
    assert lengths_of(points)[0] <= brute * (1 + 1e-4)
