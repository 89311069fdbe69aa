"""Distances to spheres and to a pair of spheres, found by hand, and bounds that must hold."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.metaball import Avatar
from mbstudio.core.metaball.signed_distance import closest_points, first_order_distance, safe_radius

SPHERE = Avatar([[10, -20, 30]], [4.0], "um")  # radius 2


def about(avatar: Avatar, count: int, seed: int = 0) -> np.ndarray:
    low, high = avatar.bounds()
    margin = 0.4 * (high - low)
    return np.random.default_rng(seed).uniform(low - margin, high + margin, (count, 3))


def lumpy(n: int = 12, seed: int = 5) -> Avatar:
    rng = np.random.default_rng(seed)
    return Avatar(rng.normal(size=(n, 3)) * 0.6, rng.uniform(0.05, 0.3, n), "mm")


@pytest.mark.parametrize("measure", [first_order_distance, lambda p, c: closest_points(p, c)[1]])
def test_distance_to_a_sphere_is_exact_near_and_far(measure) -> None:
    points = about(SPHERE, 500)
    true = np.linalg.norm(points - [10, -20, 30], axis=1) - 2
    np.testing.assert_allclose(measure(points, SPHERE.control), true, atol=1e-12)


def test_the_safe_radius_of_a_sphere_is_the_distance() -> None:
    points = about(SPHERE, 500)
    true = np.abs(np.linalg.norm(points - [10, -20, 30], axis=1) - 2)
    np.testing.assert_allclose(safe_radius(points, SPHERE.control), true, atol=1e-12)


def test_between_two_spheres_the_waist_is_nearest() -> None:
    # Near enough that the waist, hollow along x, is nearer than the shoulders beside it.
    # At (0, r, 0) both are sqrt(1 + r**2) away: f = 2 k / (1 + r**2) = 1 at r = sqrt(2 k - 1).
    pair = Avatar([[-1, 0, 0], [1, 0, 0]], [0.6, 0.6], "mm")
    waist = np.sqrt(0.2)
    closest, distance = closest_points(np.array([[0, 0.5, 0], [0, 0.1, 0], [0, 0.0, 0.3]]), pair.control)
    np.testing.assert_allclose(distance, [0.5 - waist, 0.1 - waist, 0.3 - waist], atol=1e-9)
    np.testing.assert_allclose(closest, [[0, waist, 0], [0, waist, 0], [0, 0, waist]], atol=1e-7)
    # On the axis beyond the ends: k / (x - 1)**2 + k / (x + 1)**2 = 1 gives x**4 - 3.2 x**2 - 0.2 = 0.
    tip = np.sqrt((3.2 + np.sqrt(3.2**2 + 0.8)) / 2)
    assert closest_points(np.array([[4.0, 0, 0]]), pair.control)[1][0] == pytest.approx(4 - tip, abs=1e-9)


def test_on_a_control_point_the_distance_is_finite() -> None:
    centre = np.array([[10.0, -20, 30]])
    closest, distance = closest_points(centre, SPHERE.control)
    assert distance[0] == pytest.approx(-2, abs=1e-6)
    assert np.linalg.norm(closest - centre) == pytest.approx(2, abs=1e-6)
    assert safe_radius(centre, SPHERE.control)[0] == pytest.approx(2, abs=1e-6)


def test_closest_points_lie_on_the_surface_and_straight_below() -> None:
    avatar, points = lumpy(), about(lumpy(), 2000)
    closest, distance = closest_points(points, avatar.control)
    np.testing.assert_allclose(avatar.field(closest), 1, atol=1e-8)
    np.testing.assert_allclose(np.abs(distance), np.linalg.norm(points - closest, axis=1), atol=1e-8)
    assert ((distance < 0) == avatar.contains(points)).all()
    normal = avatar.gradient(closest)
    normal /= -np.linalg.norm(normal, axis=1, keepdims=True)
    straight = np.abs(distance) > 1e-3
    cosine = ((points - closest) * normal).sum(axis=1) / distance
    assert (cosine[straight] > 1 - 1e-6).mean() > 0.995


def test_distances_are_those_to_a_fine_mesh() -> None:
    from scipy.spatial import cKDTree

    avatar, points = lumpy(), about(lumpy(), 4000)
    true, _ = cKDTree(avatar.mesh(160).vertices).query(points)
    found = np.abs(closest_points(points, avatar.control)[1])
    size = np.linalg.norm(np.ptp(avatar.bounds(), axis=0))
    assert (found - true).max() < 0.2 * size  # a nearer part may be overlooked, rarely
    assert ((found - true) > 0.003 * size).mean() < 0.01
    assert (found - true).min() > -0.003 * size
    assert (safe_radius(points, avatar.control) <= true + 0.001 * size).all()
    assert (safe_radius(points, avatar.control) <= found + 1e-9).all()


def test_the_first_order_error_is_of_second_order() -> None:
    avatar = lumpy()
    on_surface = avatar.mesh(40).vertices
    normal = -avatar.gradient(on_surface)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    errors = [
        np.median(np.abs(avatar.signed_distance(on_surface + step * normal) - step)) for step in (0.02, 0.01)
    ]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.15)


def test_the_avatars_methods_are_in_its_unit() -> None:
    point = np.array([[10.0, -20, 35]])
    assert SPHERE.signed_distance(point)[0] == pytest.approx(3)
    assert SPHERE.to("mm").signed_distance(point * 1e-3, iterated=True)[0] == pytest.approx(3e-3)
    np.testing.assert_allclose(SPHERE.closest_points(point), [[10, -20, 32]])


def test_no_points_give_no_distances() -> None:
    closest, distance = closest_points(np.empty((0, 3)), SPHERE.control)
    assert closest.shape == (0, 3)
    assert distance.shape == (0,)
