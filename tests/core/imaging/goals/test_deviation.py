"""Signed distances between surfaces whose distance is known."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.imaging.goals.deviation import deviation, signed_distances


def ball(radius, subdivisions=5):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


@pytest.mark.parametrize(("radius", "expected"), [(12.0, 2.0), (9.0, -1.0)])
def test_concentric_spheres_are_a_constant_apart(radius, expected):
    found = deviation(ball(radius, 4), ball(10.0), "um")
    # The faceted ball lies up to 10 (1 - cos(0.6°)) = 0.003 inside its sphere.
    np.testing.assert_allclose(found.distances, expected, atol=0.005)
    assert found.rms == pytest.approx(abs(expected), abs=0.004)
    assert found.mean == pytest.approx(expected, abs=0.004)
    assert found.largest == pytest.approx(expected, abs=0.005)
    assert found.unit == "um"


def test_a_shifted_sphere_stands_out_on_one_side_and_back_on_the_other():
    vertices, faces = ball(10.0)
    shifted = vertices + np.array([0.0, 0.0, 1.0])
    found = deviation((shifted, faces), (vertices, faces), "mm")
    # |p + e_z| - 10 for |p| = 10.
    np.testing.assert_allclose(found.distances, np.linalg.norm(shifted, axis=1) - 10, atol=0.01)
    assert found.distances[np.argmax(shifted[:, 2])] == pytest.approx(1.0, abs=0.01)
    # Over a sphere cos² has the mean 1/3.
    assert found.rms == pytest.approx(np.sqrt(1 / 3), rel=0.02)


def test_grains_in_metres_deviate_as_they_do_in_millimetres():
    first, second = ball(1.0, 4), ball(1.2, 4)
    expected = deviation(second, first, "mm")
    found = deviation((1e-3 * second[0], second[1]), (1e-3 * first[0], first[1]), "m")
    np.testing.assert_allclose(1e3 * found.distances, expected.distances, rtol=1e-9)


def test_sides_are_told_apart_at_corners_and_edges():
    box = trimesh.creation.box((2.0, 2.0, 2.0)).subdivide().subdivide().subdivide()
    points = np.array([[1.2, 1.2, 1.2], [0.9, 0.9, 0.9], [1.3, 1.4, 0.0], [0.0, 0.0, 0.7], [-2.0, 0.0, 0.0]])
    expected = [np.sqrt(0.12), -0.1, 0.5, -0.3, 1.0]
    found = signed_distances(points, (np.asarray(box.vertices), np.asarray(box.faces)))
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_rms_weighs_by_area_and_not_by_the_density_of_vertices():
    """Two flat parts, 1 and 3 from the plane; the nearer one has a hundred times the triangles."""

    def plate(cells, x, height):
        u, v = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
        points = np.column_stack([u.ravel() + x, v.ravel(), np.full(u.size, height)])
        i, j = (index.ravel() for index in np.mgrid[:cells, :cells])
        a, b = i * (cells + 1) + j, (i + 1) * (cells + 1) + j
        return points, np.concatenate([np.column_stack([a, b, b + 1]), np.column_stack([a, b + 1, a + 1])])

    (near, first), (far, second) = plate(20, 0, 1.0), plate(2, 1, 3.0)
    both = np.concatenate([near, far]), np.concatenate([first, second + len(near)])
    ground, faces = plate(30, 0, 0.0)
    ground = ground * [4, 3, 1] - [1, 1, 0]
    found = deviation(both, (ground, faces), "um")
    assert found.rms == pytest.approx(np.sqrt((1 + 9) / 2), rel=1e-6)
    assert found.largest == pytest.approx(3.0)


def test_nothing_has_no_deviation():
    nothing = np.zeros((0, 3)), np.zeros((0, 3), dtype=int)
    with pytest.raises(ValueError, match="triangle"):
        deviation(nothing, ball(1.0, 1), "um")
