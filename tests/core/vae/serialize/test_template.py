"""Symmetric templates of any number of control points."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import SerializationError
from mbstudio.core.vae.serialize.serialization import FLIPS
from mbstudio.core.vae.serialize.template import (
    exchange_table,
    learn_template,
    orbit_kinds,
    spread_orbits,
    symmetric_mean,
)
from tests.core.vae.bodies import ellipsoid_template


@pytest.mark.parametrize(
    ("n", "kinds"),
    [(1, (1,)), (5, (4, 1)), (7, (4, 2, 1)), (13, (8, 4, 1)), (40, (8,) * 5), (41, (8,) * 5 + (1,))],
)  # fmt: skip
def test_every_number_is_a_sum_of_orbits(n, kinds):
    assert orbit_kinds(n) == kinds
    assert exchange_table(kinds).shape == (8, n)


@pytest.mark.parametrize("n", [0, -3, 2.5])
def test_impossible_numbers_are_refused(n):
    with pytest.raises(SerializationError, match=f"n = {n}"):
        orbit_kinds(n)


def test_orbits_of_known_generators():
    kinds = (8, 4, 2, 1)
    points = spread_orbits(np.array([[1.0, 2, 3], [4, 5, 9], [6, 9, 9], [9, 9, 9]]), kinds)
    as_set = {tuple(point) for point in (points + 0.0).tolist()}
    assert len(as_set) == 15
    assert (-1, 2, -3) in as_set
    assert (-4, 5, 0) in as_set  # one of four lies in the plane of the long and middle axis
    assert {(6, 0, 0), (-6, 0, 0), (0, 0, 0)} <= as_set
    for row, signs in zip(exchange_table(kinds), FLIPS, strict=True):
        np.testing.assert_array_equal(points[row] * signs, points)


@pytest.mark.parametrize("n", [5, 13, 40])
def test_first_template_fills_its_body(n):
    template = ellipsoid_template(n)  # Template itself refuses what is not symmetric
    assert template.n == n
    inside = np.linalg.norm(template.centers / np.array([0.62, 0.5, 0.4]), axis=1)
    assert inside.max() < 0.95
    gaps = np.linalg.norm(template.centers[:, None] - template.centers[None], axis=2)
    assert gaps[np.triu_indices(n, 1)].min() > 0.05


def test_mean_of_an_avatar_and_its_flips_is_symmetric():
    template = ellipsoid_template(13)
    rng = np.random.default_rng(0)
    moves, changes = 0.02 * rng.normal(size=(3, 13, 3)), 0.1 * rng.normal(size=(3, 13))
    centers, weights = template.centers + moves, template.log_weights + changes
    mean = symmetric_mean(centers, weights)
    flipped = np.concatenate(
        [centers[:, row] * signs for row, signs in zip(template.exchange, FLIPS, strict=True)]
    )
    np.testing.assert_allclose(mean.centers, flipped.mean(axis=0), atol=1e-12)
    # The weight of the point in the centre, which every flip leaves in its place.
    assert mean.log_weights[12] == pytest.approx(weights[:, 12].mean())
    np.testing.assert_array_equal(mean.log_weights[:8], mean.log_weights[0])


def test_a_learned_template_is_soft_where_avatars_vary():
    template = ellipsoid_template(13)
    weights = np.tile(template.log_weights, (2, 1))
    weights[:, 12] += [0.5, -0.5]
    stiffness = learn_template(np.tile(template.centers, (2, 1, 1)), weights).stiffness
    # One of 52 changes varies, by 1 in its unit of 0.5: its share of the mean variance is 52. The inverse
    # of 52 + 0.1 there and of 0.1 elsewhere, scaled so that the mean square of the changes stays 1.
    wanted = np.full(52, 521.0)
    wanted[12] = 1.0
    np.testing.assert_allclose(stiffness, np.diag(wanted), rtol=1e-9, atol=1e-9)


def test_avatars_that_do_not_vary_leave_all_changes_alike():
    template = ellipsoid_template(5)
    mean = learn_template(template.centers[None], template.log_weights[None])
    assert mean.stiffness is None
