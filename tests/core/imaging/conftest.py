"""Grains that several tests of the imaging share."""

from __future__ import annotations

import pytest

from mbstudio.core.grains import Grain
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import EGG_AXES, cut_box, ellipsoid, grain_where


@pytest.fixture(scope="session")
def ellipsoid_grain() -> Grain:
    """An ellipsoid of 1 um voxels with half axes of about 20, 15 and 12 um."""
    return grain_where(ellipsoid(*EGG_AXES), 23, VoxelSize(1, 1, 1, "um"), label=7, name="egg")


@pytest.fixture(scope="session")
def angular_grain() -> Grain:
    return grain_where(cut_box, 20, VoxelSize(1, 1, 1, "um"), name="angular")
