from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbstudio.core.metaball.topology import topology
from mbstudio.core.vae.models.joining import hold_together
from mbstudio.core.vae.serialize.serialization import FLIPS, Serialization, Template
from tests.core.vae.populations import population

# Eight points about the origin that are one ball from afar, and eight that can stand anywhere.
HEAVY, LIGHT = 0.02, 0.005


def avatar_of(centers: np.ndarray, weights: np.ndarray) -> Serialization:
    n = len(weights)
    places = np.concatenate([1e-3 * FLIPS, 0.2 * FLIPS])[:n]
    exchange = np.array([8 * (np.arange(n) // 8) + (np.arange(n) % 8 ^ flip) for flip in range(8)])
    template = Template(places, np.full(n, -4.0), exchange)
    return Serialization(
        template,
        centers[None],
        np.log(weights)[None],
        np.ones(1),
        "mm",
        ("a",),
        np.full(1, np.nan),
        np.ones(1, bool),
    )


def ball_and_drop(distance: float) -> Serialization:
    """A ball of weight 8 HEAVY at the origin and a drop of weight 8 LIGHT at a distance along x."""
    centers = np.concatenate([1e-4 * FLIPS, 1e-4 * FLIPS + [distance, 0.0, 0.0]])
    return avatar_of(centers, np.repeat([HEAVY, LIGHT], 8))


def reach(enough: float) -> float:
    """How far two balls may stand apart for f >= enough between: the least of a/r^2 + b/(d - r)^2 over r is
    (a^(1/3) + b^(1/3))^3 / d^2."""
    return float(np.sqrt((np.cbrt(8 * HEAVY) + np.cbrt(8 * LIGHT)) ** 3 / enough))


def test_bodies_in_one_piece_come_back_as_they_are() -> None:
    parents = population(12)
    assert hold_together(parents) is parents
    near = ball_and_drop(0.999 * reach(1.0))
    assert hold_together(near) is near


def test_a_body_whose_ways_are_bent_comes_back_as_it_is() -> None:
    """Eight corners of a cube are joined in its middle, not along its edges."""
    corners = avatar_of(
        0.5 * FLIPS, np.full(8, 0.1)
    )  # half a diagonal: 0.866; f in the middle: 8 * 0.1 / 0.75
    assert topology(control_of(corners)).pieces == 1
    assert hold_together(corners) is corners


@pytest.mark.parametrize("distance", [1.01, 1.3, 3.0])
def test_a_drop_is_drawn_in_just_as_far_as_joins_it(distance: float) -> None:
    apart = ball_and_drop(distance * reach(1.0))
    assert topology(control_of(apart)).pieces == 2
    near = hold_together(apart)
    assert topology(control_of(near)).pieces == 1
    moved = near.centers[0, 8:].mean(axis=0)
    # Twelve halvings of the way find the place to a 4,000th of it; 64 samples see the neck.
    assert moved[0] == pytest.approx(reach(1.02), abs=4e-3 * distance)
    np.testing.assert_allclose(moved[1:], 0.0, atol=1e-3)
    np.testing.assert_array_equal(near.centers[0, :8], apart.centers[0, :8])
    np.testing.assert_array_equal(near.log_weights, apart.log_weights)


def test_a_drop_of_many_control_points_keeps_its_form() -> None:
    apart = ball_and_drop(1.4 * reach(1.0))
    near = hold_together(apart)
    step = near.centers[0, 8:] - apart.centers[0, 8:]
    np.testing.assert_allclose(step, np.tile(step[:1], (8, 1)), atol=1e-12)


def test_flipped_avatars_are_joined_as_their_flips() -> None:
    rng = np.random.default_rng(4)
    wild = scattered(rng, 0.55)
    flips = np.array([5])
    there = hold_together(wild.flipped(flips))
    back = hold_together(wild).flipped(flips)
    np.testing.assert_allclose(there.centers, back.centers, atol=1e-9)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**16), spread=st.floats(0.2, 0.8))
def test_whatever_is_joined_is_one_piece(seed: int, spread: float) -> None:
    near = hold_together(scattered(np.random.default_rng(seed), spread))
    assert topology(control_of(near)).pieces == 1


def scattered(rng: np.random.Generator, spread: float) -> Serialization:
    centers = spread * rng.normal(size=(16, 3))
    return avatar_of(centers, np.exp(rng.normal(-4.0, 0.5, 16)))


def control_of(avatar: Serialization) -> np.ndarray:
    return np.concatenate([avatar.centers[0].T, np.exp(avatar.log_weights[0])[None]])
