"""Points on the surface: their order, and the tips that planes from all sides touch."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit
from mbstudio.core.imaging.fast.refine import RefineSettings
from mbstudio.core.imaging.hull import along_curve, tips_of
from mbstudio.core.imaging.preprocess import prepare
from mbstudio.core.metrics.sphere_directions import half_sphere
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import CENTER, cut_box, ellipsoid, grain_where


@pytest.fixture(scope="module")
def box_grain() -> Grain:
    """A box with two corners cut off, 60 voxels long."""
    return grain_where(cut_box, 20, VoxelSize(0.6, 0.6, 0.6, "um"), name="box")


def test_points_come_in_the_order_of_mortons_curve() -> None:
    corners = np.array([[x, y, z] for x in (0, 9) for y in (0, 9) for z in (0, 9)], dtype=float)
    # Bits of z, y, x: the curve steps along x first, then along y, then along z.
    wanted = sorted(corners.tolist(), key=lambda point: point[::-1])
    np.testing.assert_array_equal(along_curve(np.random.default_rng(0).permutation(corners)), wanted)
    # A point in the low octant comes before all of the high one, whatever its lower bits.
    near_middle, far = [1023 / 2 - 1] * 3, [1023 / 2 + 1, 0.0, 0.0]
    ends = [[0.0, 0.0, 0.0], [1023.0, 1023.0, 1023.0]]
    found = along_curve(np.array([far, ends[1], near_middle, ends[0]]))
    np.testing.assert_array_equal(found, [ends[0], near_middle, far, ends[1]])


def test_every_sixteenth_hull_point_is_still_spread_evenly() -> None:
    prepared = prepare(grain_where(ellipsoid(40, 30, 24), 42, VoxelSize(1, 1, 1, "um")))
    unit = prepared.hull * prepared.scale + prepared.center - CENTER
    octant = (unit > 0) @ np.array([1, 2, 4])
    share = np.bincount(octant, minlength=8) / len(octant)
    sparse = octant[5::16]
    expected = len(sparse) * share
    # Points drawn at random would miss by the root of their number, here about 13.
    assert np.abs(np.bincount(sparse, minlength=8) - expected).max() < 6


def test_the_tips_of_a_box_are_its_corners_however_many_points_its_faces_have() -> None:
    rng = np.random.default_rng(0)
    half = np.array([3.0, 2.0, 1.0])
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    inner = 0.999 * half * rng.uniform(-1, 1, (5000, 3))
    tips, shares = tips_of(np.vstack([inner, corners]) + 7.0)
    np.testing.assert_allclose(sorted(tips.tolist()), sorted((corners + 7.0).tolist()))
    # Each corner is touched by an eighth of all planes.
    np.testing.assert_allclose(shares, 1 / 8, atol=0.01)


def test_each_tip_of_a_grain_is_farthest_in_some_direction(box_grain: Grain) -> None:
    prepared = prepare(box_grain)
    axes = half_sphere(150)
    directions = np.vstack([axes, -axes])
    reach = (prepared.tips @ directions.T).max(axis=0)
    assert prepared.tip_shares.sum() == pytest.approx(1)
    assert ((prepared.hull @ directions.T).max(axis=0) <= reach + 0.01 * prepared.voxel).all()
    assert len(np.unique((prepared.tips @ directions.T).argmax(axis=0))) == len(prepared.tips)


def test_few_or_long_voxels_have_no_tips() -> None:
    for half, voxel in ((10, VoxelSize(1, 1, 1, "um")), (40, VoxelSize(2, 1, 1, "um"))):
        prepared = prepare(grain_where(ellipsoid(half, 0.8 * half, 0.7 * half), half + 2, voxel))
        assert prepared.tips.shape == (0, 3)
        assert prepared.tip_shares.shape == (0,)


def test_tips_bring_the_calipers_nearer_to_the_grains(box_grain: Grain) -> None:
    axes = half_sphere(100)

    def errors(tip_weight: float) -> np.ndarray:
        mesh = fit(box_grain, 24, refine=RefineSettings(tip_weight=tip_weight)).avatar.mesh(cells=64)
        return np.ptp(np.asarray(mesh.vertices) @ axes.T, axis=0) - true

    prepared = prepare(box_grain)
    true = np.ptp(prepared.tips @ axes.T, axis=0) * prepared.scale
    plain, tipped = np.abs(errors(0.0)), np.abs(errors(RefineSettings().tip_weight))
    assert tipped.mean() < 0.85 * plain.mean()
