"""Warps: derivatives against differences, flips against flipped points."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.cloning.kernel_warp import FLIPS, displacement, gradient, lattice
from mbstudio.core.cloning.registration import flip_coefficients


@pytest.fixture
def coefficients(rng: np.random.Generator) -> np.ndarray:
    return 0.1 * rng.normal(size=(len(lattice()), 3))


def test_derivatives_are_those_of_differences(coefficients: np.ndarray, rng: np.random.Generator) -> None:
    points, step = rng.normal(size=(7, 3)), 1e-5
    slopes = gradient(points, coefficients)
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        ahead, behind = (displacement(points + sign * shift, coefficients) for sign in (1, -1))
        wanted = np.eye(3)[axis] + (ahead - behind) / (2 * step)
        assert slopes[:, :, axis] == pytest.approx(wanted, abs=1e-8)


@pytest.mark.parametrize("flip", range(8))
def test_a_flipped_warp_does_to_flipped_points_what_it_did(
    flip: int, coefficients: np.ndarray, rng: np.random.Generator
) -> None:
    points = rng.normal(size=(9, 3))
    flipped = flip_coefficients(coefficients, flip)
    wanted = displacement(points, coefficients) * FLIPS[flip]
    assert displacement(points * FLIPS[flip], flipped) == pytest.approx(wanted)
