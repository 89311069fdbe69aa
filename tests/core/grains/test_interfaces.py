"""Levels, curvature and noise at interfaces against what the scans were made of."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from mbstudio.core.grains.interfaces import find_interfaces
from tests.core.grains.degraded import CONTRAST, packed, scanned


def ball(radius: float, edge: int = 60) -> np.ndarray:
    z, y, x = np.indices((edge, edge, edge)) - (edge - 1) / 2
    inside = (x * x + y * y + z * z <= radius * radius).astype(np.float32)
    return ndimage.gaussian_filter(inside, 0.7)


def everywhere(image: np.ndarray) -> np.ndarray:
    return np.ones(image.shape, np.bool_)


@pytest.mark.parametrize("noise", [0.0, 1.0, 5.0])
def test_both_levels_and_the_noise_are_found(noise: float) -> None:
    image = 50 + 40 * ball(18)
    image += noise * np.random.default_rng(1).standard_normal(image.shape).astype(np.float32)
    found = find_interfaces(image, everywhere(image))
    assert np.median(found.lows) == pytest.approx(50, abs=2.5)
    assert np.median(found.highs) == pytest.approx(90, abs=2.5)
    assert np.median(found.middles) == pytest.approx(70, abs=1)
    if noise:
        assert found.noise == pytest.approx(noise, rel=0.25)


def test_interfaces_lie_on_the_surface_and_know_its_curvature() -> None:
    image = 50 + 40 * ball(18)
    found = find_interfaces(image, everywhere(image))
    radii = np.linalg.norm(found.places - 29.5, axis=1)
    assert np.abs(radii - 18).max() < 1.5
    assert np.median(found.curvatures) == pytest.approx(2 / 18, rel=0.25)
    hole = find_interfaces(140 - image, everywhere(image))
    assert np.median(hole.curvatures) == pytest.approx(-2 / 18, rel=0.25)


def test_noise_alone_has_next_to_no_interfaces() -> None:
    image = np.random.default_rng(2).normal(100, 8, (80, 80, 80)).astype(np.float32)
    assert len(find_interfaces(image, everywhere(image))) < 10


def test_the_noise_of_a_fine_packing_is_not_taken_from_its_surfaces() -> None:
    truth = packed(3, 72, 0.4)
    grey = scanned(truth, noise=0.05).astype(np.float32)
    found = find_interfaces(grey, np.ones(grey.shape, np.bool_)).noise
    assert found < 2.0 * 0.05 * CONTRAST


def test_the_rim_of_the_field_of_view_is_no_interface() -> None:
    image = np.full((40, 60, 60), 100, np.float32)
    y, x = np.indices((60, 60)) - 29.5
    seen = np.broadcast_to(y * y + x * x <= 26**2, image.shape)
    image[~seen] = 0
    assert len(find_interfaces(image, seen)) == 0
