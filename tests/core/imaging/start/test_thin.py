"""Sheets and rods: where control points start, how many it takes, and that volumes are true."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit
from mbstudio.core.imaging.preprocess import prepare
from mbstudio.core.imaging.start.thin import middle, number_needed, spread
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import Inside, ellipsoid, grain_where

UM = VoxelSize(1, 1, 1, "um")
# A direction across the voxels, so that no face lies along them.
ACROSS = np.array([0.36, 0.48, 0.8])


def sheet(radius: float, half: float) -> Inside:
    """A disc whose axis is ACROSS."""

    def inside(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        along = ACROSS[0] * x + ACROSS[1] * y + ACROSS[2] * z
        return (np.abs(along) <= half) & (x * x + y * y + z * z - along**2 <= radius**2)

    return inside


def rod(half_length: float, radius: float) -> Inside:
    """A cylinder along ACROSS."""

    def inside(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        along = ACROSS[0] * x + ACROSS[1] * y + ACROSS[2] * z
        return (np.abs(along) <= half_length) & (x * x + y * y + z * z - along**2 <= radius**2)

    return inside


def test_thickness_of_a_sheet() -> None:
    prepared = prepare(grain_where(sheet(24, 3), 26, UM))
    # 2 V / A of a cylinder of radius r and height h is r h / (r + h).
    assert prepared.thickness * prepared.scale == pytest.approx(24 * 6 / 30, rel=0.03)
    assert prepared.slenderness > 1
    assert prepare(grain_where(ellipsoid(12, 10, 9), 14, UM)).slenderness == 1


def test_the_middle_of_a_sheet_keeps_off_its_faces_and_rim() -> None:
    prepared = prepare(grain_where(sheet(24, 4), 26, UM))
    places, radii = middle(prepared)
    place = places * prepared.scale + prepared.center
    along = place @ ACROSS
    from_axis = np.sqrt((place**2).sum(axis=1) - along**2)
    assert np.abs(along).max() < 2
    assert from_axis.max() < 22.5
    np.testing.assert_allclose(np.median(radii) * prepared.scale, 4, atol=0.7)


def test_spread_points_lie_evenly_in_the_sheet() -> None:
    prepared = prepare(grain_where(sheet(24, 3), 26, UM))
    control = spread(prepared, 30)
    assert control is not None
    place = control[:3].T * prepared.scale + prepared.center
    assert np.abs(place @ ACROSS).max() < 1.5
    apart = np.linalg.norm(place[:, None] - place[None], axis=2) + 1e9 * np.eye(30)
    # 30 points share pi 24**2 = 1810: in a hexagonal grid they would be 8.3 apart.
    assert apart.min(axis=1).min() > 4
    assert apart.min(axis=1).max() < 11
    assert spread(prepared, 100_000) is None


def test_the_number_needed_goes_with_area_over_thickness_squared() -> None:
    thin, thick = (number_needed(prepare(grain_where(sheet(27, half), 29, UM))) for half in (2, 4))
    assert 2.5 < thin / thick < 6
    short, long = (number_needed(prepare(grain_where(rod(half, 3), 31, UM))) for half in (12, 29))
    assert 1.6 < long / short < 3.6
    assert number_needed(prepare(grain_where(ellipsoid(14, 14, 14), 16, UM))) <= 2


def test_a_sheet_of_three_voxels_is_fitted_with_few_control_points() -> None:
    half, radius = 1.5, 16
    result = fit(grain_where(sheet(radius, half), 18, UM), 40)
    assert result.verdict.valid, result.verdict.reasons
    mesh = result.avatar.mesh(200)
    assert mesh.volume == pytest.approx(np.pi * radius**2 * 2 * half, rel=0.03)
    assert np.abs(mesh.vertices @ ACROSS).max() < 2 * half


def test_a_needle_of_four_voxels() -> None:
    result = fit(grain_where(rod(28, 2), 30, UM), 20)
    assert result.verdict.valid, result.verdict.reasons
    assert result.avatar.mesh(200).volume == pytest.approx(np.pi * 4 * 56, rel=0.03)


def test_the_verdict_measures_a_thin_avatar_right() -> None:
    result = fit(grain_where(sheet(22, 1.5), 26, UM), 30)
    grain = grain_where(sheet(22, 1.5), 26, UM)
    true = result.avatar.mesh(200).volume / grain.volume - 1
    assert result.verdict.volume_error == pytest.approx(true, abs=0.02)


def test_a_sheet_of_one_voxel_says_that_its_voxels_are_too_few() -> None:
    result = fit(Grain(np.ones((1, 10, 10), dtype=bool), UM), 8)
    assert not result.verdict.valid
    assert "100 voxels are too few" in result.verdict.reasons[-1]
