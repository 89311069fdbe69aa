from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.vae.models.radii import (
    direction_exchange,
    directions,
    log_radii,
    novelty_distances,
    outermost_radii,
    surface_rms,
)
from mbstudio.core.vae.serialize.serialization import FLIPS
from tests.core.vae.populations import population


def test_directions_are_unit_and_even() -> None:
    along = directions()
    assert along.shape == (144, 3)
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), 1.0)
    # Even over the sphere: the mean of x x' is a third of the unit matrix.
    np.testing.assert_allclose(along.T @ along / 144, np.eye(3) / 3, atol=0.02)


def test_radii_of_spheres() -> None:
    radii = outermost_radii(np.zeros((2, 1, 3)), np.log([[0.25], [4.0]]))
    np.testing.assert_allclose(radii, [[0.5] * 144, [2.0] * 144], rtol=1e-9)


def test_radius_is_the_outermost() -> None:
    # Two small spheres on the x axis, apart: 0.4 is the far side of the outer one, give or take.
    radii = outermost_radii(
        np.array([[[0.1, 0, 0], [0.8, 0, 0]]]), np.log([[1e-4, 1e-4]]), np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    )
    np.testing.assert_allclose(radii[0, 0], 0.81, atol=1e-3)
    np.testing.assert_allclose(radii[0, 1], 0.02)  # nothing there: the floor


@pytest.mark.parametrize("flip", range(8))
def test_flips_exchange_directions(flip: int) -> None:
    along = directions()
    np.testing.assert_allclose(along[direction_exchange()[flip]] * FLIPS[flip], along, atol=1e-15)
    parents = population(3)
    flipped = parents.flipped(np.full(3, flip))
    np.testing.assert_allclose(
        log_radii(flipped), log_radii(parents)[:, direction_exchange()[flip]], atol=1e-9
    )


def test_surface_rms_of_concentric_spheres_and_a_shift() -> None:
    parents = population(2)
    sphere = replace(
        parents, centers=np.zeros_like(parents.centers), log_weights=np.full((2, 16), np.log(0.25 / 16))
    )
    larger = replace(sphere, log_weights=np.full((2, 16), np.log(0.3025 / 16)))
    np.testing.assert_allclose(surface_rms(sphere, larger), 0.05, rtol=1e-6)
    moved = replace(sphere, centers=sphere.centers + np.array([0.001, 0.0, 0.0]))
    # Of a shift d only its normal part counts: d sqrt(mean cos^2) = d / sqrt(3).
    np.testing.assert_allclose(surface_rms(sphere, moved), 0.001 / np.sqrt(3), rtol=2e-2)


def test_novelty_is_the_smallest_over_flips() -> None:
    parents = population(4)
    radii = log_radii(parents)
    mirrored = log_radii(parents.flipped(np.array([1, 2, 4, 7])))
    distances = novelty_distances(mirrored, radii)
    np.testing.assert_allclose(np.diag(distances), 0.0, atol=1e-6)
    larger = novelty_distances(radii + 0.1, radii)
    np.testing.assert_allclose(np.diag(larger), 0.1, atol=1e-3)
