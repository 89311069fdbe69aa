"""Overlap and distance of bodies for which both follow from a formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.grains import Grain
from mbstudio.core.imaging.goals.likeness import Likeness, voxel_iou
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import measure
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import CENTER, ellipsoid, grain_where

VOXEL = VoxelSize(1, 1, 1, "um")
RADIUS = 15.3


def ball(radius: float, centre: np.ndarray = CENTER, unit: str = "um") -> Avatar:
    """One control point of weight R**2 is the ball of radius R."""
    return Avatar(np.array([centre]), np.array([radius**2]), unit)


@pytest.fixture(scope="module")
def grain() -> Grain:
    return grain_where(ellipsoid(RADIUS, RADIUS, RADIUS), 20, VOXEL)


def test_a_body_covers_its_own_voxels(grain: Grain) -> None:
    assert voxel_iou(ball(RADIUS), grain) == 1.0
    assert voxel_iou(ball(RADIUS).to("mm"), grain) == 1.0


@pytest.mark.parametrize("most_nodes", [10**7, 20_000, 3_000])
def test_two_balls_that_overlap(grain: Grain, most_nodes: int) -> None:
    d = 9.0
    lens = np.pi * (4 * RADIUS + d) * (2 * RADIUS - d) ** 2 / 12
    volume = 4 / 3 * np.pi * RADIUS**3
    tolerance = 0.004 if most_nodes > 10**6 else 0.04
    for axis in np.vstack([np.eye(3), -np.eye(3)]):
        found = voxel_iou(ball(RADIUS, CENTER + d * axis), grain, most_nodes)
        assert found == pytest.approx(lens / (2 * volume - lens), abs=tolerance)


@pytest.mark.parametrize("most_nodes", [2_000, 200])
def test_a_coarser_lattice_asks_voxels_of_the_grain(grain: Grain, most_nodes: int) -> None:
    """A lattice beside the voxels' centres would not find the body's own voxels exactly."""
    assert voxel_iou(ball(RADIUS), grain, most_nodes) == 1.0


def test_a_box_in_a_ball_counted_by_hand() -> None:
    box = Grain(np.ones((4, 6, 8), bool), VoxelSize(2, 1, 1, "um"), (10.0, 20.0, 30.0))
    middle = np.array([13.5, 22.5, 33.0])
    # Voxel centres lie at multiples of half a voxel from the middle.
    z, y, x = (np.arange(-30, 30) + 0.5 for _ in range(3))
    inside = (2 * z[:, None, None]) ** 2 + y[None, :, None] ** 2 + x[None, None, :] ** 2 <= 9.7**2
    assert voxel_iou(ball(9.7, middle), box) == pytest.approx(192 / np.count_nonzero(inside), rel=1e-12)


def test_what_does_not_touch_shares_nothing(grain: Grain) -> None:
    assert voxel_iou(ball(3.0, np.array([100.0, 0, 0])), grain) == 0.0


def test_hausdorff_of_an_avatar_over_the_nominal_diameter(grain: Grain) -> None:
    likeness = Likeness(grain)
    # The smoothed surface of the voxels still lies up to half a voxel off the ball.
    for other, distance in ((ball(1.1 * RADIUS), 0.05), (ball(RADIUS, CENTER + np.array([0, 3.06, 0])), 0.1)):
        for avatar in (other, other.to("mm")):
            assert distance - 0.003 < likeness.hausdorff(avatar) < distance + 0.5 / (2 * RADIUS)


def test_factor_errors(grain: Grain) -> None:
    likeness = Likeness(grain)
    errors = likeness.factor_errors(ball(1.1 * RADIUS).to("mm"))
    assert errors["dn"] == pytest.approx(0.1, abs=0.005)
    assert errors["volume"] == pytest.approx(1.1**3 - 1, abs=0.01)
    assert errors["sphericity"] == pytest.approx(0, abs=0.01)


def test_axes_are_compared_along_the_box_of_the_grain() -> None:
    grain = grain_where(lambda x, y, z: (abs(x) <= 12) & (abs(y) <= 12) & (abs(z) <= 20), 22, VOXEL)
    likeness = Likeness(grain)
    assert np.sort(np.abs(likeness.box_directions).max(axis=1)) == pytest.approx([1, 1, 1], abs=2e-3)
    # Two overlapping balls across the bar's diagonal: their own smallest box is turned by 45 degrees.
    avatar = Avatar(np.array([[5.0, 5.0, 0.0], [-5.0, -5.0, 0.0]]), np.full(2, 49.0), "um")
    extents = np.sort(np.ptp(np.asarray(avatar.mesh(96).vertices), axis=0))
    errors = likeness.factor_errors(avatar)
    found = [errors[name] for name in ("shortest", "intermediate", "longest")]
    assert found == pytest.approx(extents / [24.5, 24.5, 40.5] - 1, abs=0.03)
    assert measure(avatar).longest > 1.1 * extents[2]


def test_cavities_are_compared_as_they_were_fitted(grain: Grain) -> None:
    z, y, x = np.indices(grain.mask.shape)
    middle = np.array(grain.mask.shape) / 2
    hole = (z - middle[0]) ** 2 + (y - middle[1]) ** 2 + (x - middle[2]) ** 2 < 64
    hollow = replace(grain, mask=grain.mask & ~hole)
    share = np.count_nonzero(hole) / grain.voxel_count
    assert Likeness(hollow).iou(ball(RADIUS)) == 1.0
    assert Likeness(hollow, "keep").iou(ball(RADIUS)) == pytest.approx(1 - share, rel=1e-12)
