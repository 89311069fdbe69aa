from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mbstudio.core.vae.shaping.factor_slopes import factors_and_slopes
from mbstudio.core.vae.shaping.meaning_factors import departures, departures_back, meaning_factors
from tests.core.vae.boxes import boxes


def test_the_factors_are_those_of_the_meanings() -> None:
    bodies = boxes(3, np.random.default_rng(4))
    np.testing.assert_allclose(factors_and_slopes(bodies)[0], meaning_factors(bodies), rtol=1e-12)


def agree_with_small_changes(seed: int) -> bool:
    """Return whether the slopes of a random body are the limit of ever smaller changes.

    Where a ray nearly grazes the surface, a change of 1e-6 is still too large.
    """
    rng = np.random.default_rng(seed)
    bodies = boxes(1, rng)
    by_centers, by_weights = rng.normal(size=bodies.centers.shape), rng.normal(size=bodies.log_weights.shape)

    def changed(hair: float) -> np.ndarray:
        centers, log_weights = bodies.centers + hair * by_centers, bodies.log_weights + hair * by_weights
        return meaning_factors(replace(bodies, centers=centers, log_weights=log_weights))[0]

    told = factors_and_slopes(bodies)[1][0, :, :-1] @ np.concatenate([by_centers.ravel(), by_weights.ravel()])
    return any(
        np.allclose(told, (changed(hair) - changed(-hair)) / (2 * hair), rtol=1e-3, atol=1e-5)
        for hair in (1e-6, 1e-7, 1e-8, 1e-9)
    )


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000))
@example(6160)  # some rays meet no solid: nothing moves the radius that stands for them
@example(7442)  # one ray nearly grazes the surface, which still moves its radius
def test_slopes_are_those_of_small_changes(seed: int) -> None:
    assert agree_with_small_changes(seed)


@pytest.mark.full
def test_slopes_of_many_bodies_are_those_of_small_changes() -> None:
    assert [seed for seed in range(10_000) if not agree_with_small_changes(seed)] == []


def test_a_larger_body_is_of_the_same_form() -> None:
    """Centers grown by 1 + e and k by (1 + e)**2 grow the body by 1 + e: ln D_n by e, no ratio at all."""
    bodies = boxes(2, np.random.default_rng(8))
    slopes = factors_and_slopes(bodies)[1]
    for row in range(2):
        grown = np.concatenate([bodies.centers[row].ravel(), np.full(8, 2.0), [0.0]])
        np.testing.assert_allclose(slopes[row] @ grown, [1, 0, 0, 0, 0], atol=1e-8)
        np.testing.assert_array_equal(slopes[row, :, -1], [1, 0, 0, 0, 0])


def test_departures_pass_their_slopes_back() -> None:
    rng = np.random.default_rng(1)
    logs, weights, way = rng.normal(0.0, 0.1, (3, 2, 144))
    hair = 1e-6
    change = (departures(logs + hair * way) - departures(logs - hair * way)) / (2 * hair)
    told = (departures_back(logs, weights) * way).sum(axis=1)
    assert told == pytest.approx((weights * change).sum(axis=1), rel=1e-6)
