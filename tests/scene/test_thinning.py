"""Many bodies by fewer triangles: none vanishes, each stays where it is and as large as it was."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.scene.surfaces import Surface, merge, surface_of
from mbstudio.scene.thinning import thinned


def balls(radii, subdivisions=4):
    """Return balls side by side along x, each with its number as label, from 1."""
    parts, place = [], 0.0
    for label, radius in enumerate(radii, start=1):
        ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
        ball.apply_translation((place + radius, 0, 0))
        parts.append((surface_of(ball), label))
        place += 2.5 * radius
    return merge(parts)


def test_bodies_stay_where_they_are_and_as_large():
    before = balls([100.0, 50.0, 20.0])
    after = thinned(before, 1000)
    assert 300 < len(after.triangles) <= 1000
    for label, radius in ((1, 100.0), (2, 50.0), (3, 20.0)):
        own = np.unique(after.triangles[after.labels == label])
        old = np.unique(before.triangles[before.labels == label])
        middle = before.points[old].mean(axis=0)
        np.testing.assert_allclose(after.points[own].mean(axis=0), middle, atol=0.05 * radius)
        away = after.points[own] - middle
        np.testing.assert_allclose(np.linalg.norm(away, axis=1), radius, rtol=0.12)
        # Normals point outwards and are of unit length.
        np.testing.assert_allclose(np.linalg.norm(after.normals[own], axis=1), 1, atol=1e-5)
        assert ((after.normals[own] * away).sum(axis=1) > 0.8 * radius).all()


def test_triangles_keep_their_side():
    after = thinned(balls([100.0]), 500)
    a, b, c = (after.points[after.triangles[:, corner]] for corner in range(3))
    outward = (np.cross(b - a, c - a) * ((a + b + c) / 3 - [100.0, 0, 0])).sum(axis=1)
    assert len(outward) > 100
    assert (outward > 0).all()


def test_no_body_vanishes_however_small():
    after = thinned(balls([1000.0, 1.0, 1.0, 0.5], subdivisions=3), 200)
    assert set(after.labels.tolist()) == {1, 2, 3, 4}


def test_few_triangles_stay_as_they_are():
    before = balls([10.0, 10.0])
    assert thinned(before, len(before.triangles)) is before
    bare = Surface(before.points, before.triangles, before.normals)
    assert thinned(bare, 10) is bare


@pytest.mark.parametrize("most", [400, 2000])
def test_the_same_surface_is_thinned_alike(most):
    one, other = (thinned(balls([30.0, 20.0, 70.0]), most) for _ in range(2))
    assert np.array_equal(one.points, other.points)
    assert np.array_equal(one.triangles, other.triangles)
