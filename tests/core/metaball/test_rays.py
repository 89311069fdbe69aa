"""Where rays hit spheres, necks and walls: places known from the equation of the surface."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import AvatarError
from mbstudio.core.metaball import Avatar
from mbstudio.core.metaball.rays import first_hits

SPHERE = Avatar([[10, -20, 30]], [4.0], "um")  # radius 2


def test_rays_through_a_sphere_hit_where_pythagoras_says() -> None:
    rng = np.random.default_rng(2)
    aside = rng.uniform(0, 1.999, 200)
    origins = np.stack([10 - np.full(200, 9.0), -20 + aside, np.full(200, 30.0)], axis=1)
    found = first_hits(origins, np.tile([7.0, 0, 0], (200, 1)), SPHERE.control)
    np.testing.assert_allclose(found, 9 - np.sqrt(4 - aside**2), rtol=1e-12)


def test_rays_beside_behind_and_away_miss() -> None:
    origins = np.array([[0, -17.9, 30], [0, -20, 30], [13, -20, 30.0]])
    found = first_hits(origins, np.array([[1, 0, 0], [-1, 0, 0], [1, 0, 0.0]]), SPHERE.control)
    assert np.isinf(found).all()


def test_from_inside_the_way_out_is_found() -> None:
    found = first_hits([[10, -20, 31], [10, -20, 30]], [[0, 0, 1], [0, 3, 0]], SPHERE.control)
    np.testing.assert_allclose(found, [1, 2])


@pytest.mark.parametrize("waist", [0.1, 1e-2, 1e-3, 2e-4])
def test_a_thin_neck_is_not_stepped_over(waist: float) -> None:
    # Two points at (-1, 0, 0) and (1, 0, 0): at x = 0 the neck has radius sqrt(2 k - 1).
    pair = Avatar([[-1, 0, 0], [1, 0, 0]], np.full(2, 0.5 * (1 + waist**2)), "mm")
    found = first_hits([[0.0, -50, 0]], [[0.0, 1, 0]], pair.control)
    assert found[0] == pytest.approx(50 - waist, rel=1e-9)
    # Just beside it there is nothing.
    assert np.isinf(first_hits([[0.0, -50, 1.001 * waist]], [[0.0, 1, 0]], pair.control)[0])


def test_a_tiny_island_before_the_body_is_hit_first() -> None:
    avatar = Avatar([[0, 0, 0], [3, 0, 0]], [1.0, 1e-6], "mm")
    # Near (3, 0, 0) the body adds about 1/9: the island's radius is 1e-3 / sqrt(8 / 9).
    found = first_hits([[10.0, 0, 0]], [[-1.0, 0, 0]], avatar.control)
    assert found[0] == pytest.approx(7 - 1e-3 / np.sqrt(8 / 9), abs=1e-6)


def test_hits_are_those_of_dense_sampling() -> None:
    rng = np.random.default_rng(4)
    avatar = Avatar(rng.normal(size=(15, 3)) * 0.8, rng.uniform(0.01, 0.2, 15), "mm")
    origins = rng.normal(size=(300, 3))
    origins *= 6 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = rng.normal(size=(300, 3)) * 0.8 - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = avatar.first_hits(origins, directions)
    along = np.linspace(0, 12, 6001)
    for origin, direction, t in zip(origins, directions, found, strict=True):
        inside = np.flatnonzero(avatar.contains(origin + along[:, None] * direction))
        if len(inside):
            assert t <= along[inside[0]] + 1e-12
        if np.isfinite(t):
            assert avatar.field((origin + t * direction)[None])[0] == pytest.approx(1, abs=1e-9)
            # Nothing before it.
            before = np.linspace(0, 0.999999 * t, 500)
            assert not avatar.contains(origin + before[:, None] * direction).any()
    assert 100 < np.isfinite(found).sum() < 300


def test_a_far_away_origin_costs_no_digits() -> None:
    assert first_hits([[10.0 - 1e6, -20, 30]], [[1.0, 0, 0]], SPHERE.control)[0] == pytest.approx(
        1e6 - 2, abs=1e-6
    )


def test_rays_that_are_none_are_refused() -> None:
    with pytest.raises(AvatarError, match="no length"):
        SPHERE.first_hits(np.zeros((1, 3)), np.zeros((1, 3)))
    with pytest.raises(AvatarError, match="the same number"):
        SPHERE.first_hits(np.zeros((2, 3)), np.ones((1, 3)))
    with pytest.raises(AvatarError, match="shortest_chord"):
        first_hits(np.zeros((1, 3)), np.ones((1, 3)), SPHERE.control, shortest_chord=0)
