"""Crofton's area of voxel ellipsoids and the weights of its directions."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.metrics.crofton import _directions, crofton_area
from mbstudio.core.units import VoxelSize
from tests.core.metrics.solids import ellipsoid_area, ellipsoid_voxels


@pytest.mark.parametrize("radius", [15, 30])
def test_area_of_a_rotated_ellipsoid(radius):
    axes = radius * np.array([1.0, 0.8, 0.65])
    found = [crofton_area(ellipsoid_voxels(axes, seed), VoxelSize(1, 1, 1, "um")) for seed in range(4)]
    assert np.mean(found) == pytest.approx(ellipsoid_area(*axes), rel=0.004)


def test_an_ellipsoid_sampled_on_flat_voxels_keeps_its_area():
    size = VoxelSize(z=2.0, y=1.0, x=1.0, unit="um")
    z, y, x = np.meshgrid(np.arange(-16, 17) * 2.0, np.arange(-32, 33), np.arange(-32, 33), indexing="ij")
    mask = (x / 30) ** 2 + (y / 24) ** 2 + (z / 20) ** 2 <= 1
    assert crofton_area(mask, size) == pytest.approx(ellipsoid_area(30, 24, 20), rel=0.015)


def test_weights_are_those_of_the_literature_and_sum_to_one():
    weights = {int(np.abs(shift).sum()): weight for shift, _, weight in _directions((1.0, 1.0, 1.0))}
    # Legland et al. 2007, table 2: the three kinds of direction, each counted with its opposite.
    assert weights[1] == pytest.approx(2 * 0.04577789120476, rel=1e-6)
    assert weights[2] == pytest.approx(2 * 0.03698062787608, rel=1e-6)
    assert weights[3] == pytest.approx(2 * 0.03519563978232, rel=1e-6)
    assert sum(weight for *_, weight in _directions((2.0, 1.0, 1.0))) == pytest.approx(1)
