"""Preparation: distances, hull points and scale against the formula of the shape."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import FitError
from mbstudio.core.grains import Grain
from mbstudio.core.imaging.preprocess import prepare
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import CENTER, EGG_AXES, ellipsoid, grain_where


def in_grain(prepared, points: np.ndarray) -> np.ndarray:
    return points * prepared.scale + prepared.center


@pytest.mark.parametrize(
    "voxel", [VoxelSize(1, 1, 1, "um"), VoxelSize(2, 1, 1, "um"), VoxelSize(1, 1.5, 0.75, "um")]
)
def test_hull_points_lie_on_the_sphere_they_come_from(voxel: VoxelSize) -> None:
    prepared = prepare(grain_where(ellipsoid(16, 16, 16), 18, voxel))
    radius = np.linalg.norm(in_grain(prepared, prepared.hull) - CENTER, axis=1)
    assert radius.mean() == pytest.approx(16, abs=0.25)
    assert np.abs(radius - 16).max() < 1.0
    np.testing.assert_allclose(in_grain(prepared, prepared.hull).mean(axis=0), CENTER, atol=0.1)


def test_working_frame_is_centred_and_scaled(ellipsoid_grain: Grain) -> None:
    prepared = prepare(ellipsoid_grain)
    np.testing.assert_allclose(prepared.hull.mean(axis=0), 0, atol=1e-12)
    assert np.sqrt((prepared.hull**2).sum(axis=1).mean()) == pytest.approx(1)
    assert prepared.volume * prepared.scale**3 == pytest.approx(ellipsoid_grain.volume)


def test_signed_distance_of_a_sphere() -> None:
    prepared = prepare(grain_where(ellipsoid(16, 16, 16), 18, VoxelSize(1, 1, 1, "um")))
    index = np.argwhere(np.ones(prepared.mask.shape, dtype=bool))
    place = in_grain(prepared, index[:, ::-1] * prepared.spacing + prepared.origin)
    true = 16 - np.linalg.norm(place - CENTER, axis=1)
    assert np.abs(prepared.distance.ravel() * prepared.scale - true).max() < 1.0


def test_large_grains_are_averaged_in_blocks_and_keep_their_place() -> None:
    grain = grain_where(ellipsoid(40, 30, 24), 42, VoxelSize(0.5, 0.5, 0.5, "um"))
    fine, coarse = prepare(grain, working_side=400), prepare(grain, working_side=60)
    assert max(coarse.mask.shape) < 80 < max(fine.mask.shape)
    np.testing.assert_allclose(coarse.center, fine.center, atol=0.5)  # the scatter of the points
    assert coarse.scale == pytest.approx(fine.scale, rel=5e-3)
    assert coarse.volume * coarse.scale**3 == pytest.approx(grain.volume)


def test_averaged_blocks_tell_the_surface_as_well_as_the_scan_but_not_beyond_half_a_block() -> None:
    grain = grain_where(ellipsoid(40, 30, 24), 42, VoxelSize(0.5, 0.5, 0.5, "um"))
    for working_side, block, known in ((400, 1, 0.5), (80, 2, 0.5), (30, 6, 1.5)):
        prepared = prepare(grain, working_side=working_side)
        assert prepared.voxel * prepared.scale == pytest.approx(0.5 * block)
        assert prepared.fineness * prepared.scale == pytest.approx(known)


def test_interior_points_are_as_deep_as_they_say(ellipsoid_grain: Grain) -> None:
    prepared = prepare(ellipsoid_grain)
    place = in_grain(prepared, prepared.interior)
    assert (np.linalg.norm((place - CENTER) / EGG_AXES, axis=1) < 1).all()
    assert (prepared.interior_depth * prepared.scale > 2).all()


def test_a_cavity_is_filled() -> None:
    solid = grain_where(ellipsoid(12, 12, 12), 14, VoxelSize(1, 1, 1, "um"))
    mask = solid.mask.copy()
    mask[11:14, 11:14, 11:14] = False
    prepared = prepare(Grain(mask, solid.voxel_size, solid.origin))
    assert prepared.filled == 27
    assert prepared.volume * prepared.scale**3 == pytest.approx(solid.volume)


def test_the_seed_decides_the_points(ellipsoid_grain: Grain) -> None:
    one, same, other = prepare(ellipsoid_grain, 1), prepare(ellipsoid_grain, 1), prepare(ellipsoid_grain, 2)
    np.testing.assert_array_equal(one.hull, same.hull)
    assert not np.array_equal(one.hull, other.hull)


def test_an_empty_mask_is_refused() -> None:
    with pytest.raises(FitError, match="no voxels"):
        prepare(Grain(np.zeros((3, 3, 3), dtype=bool), VoxelSize(1, 1, 1, "um")))


@pytest.mark.parametrize(("depth", "square"), [(1.0, 1.25 + 0.25 + 0.25), (2.0, 1.25 + 0.25 + 1.0)])
def test_centring_and_scale_of_a_small_mask_by_hand(depth: float, square: float) -> None:
    # 2 x 2 x 4 voxels (z, y, x), all of them outermost: H is their centres, and the mean of the
    # squared distances from the middle is the sum of (0.5, 0.5, 1.5, 1.5), (0.5, 0.5) and half a depth.
    grain = Grain(np.ones((2, 2, 4), dtype=bool), VoxelSize(depth, 1, 1, "um"), (10.0, 20.0, 30.0))
    prepared = prepare(grain, hull="voxels")
    np.testing.assert_allclose(prepared.center, [11.5, 20.5, 30.0 + 0.5 * depth])
    assert prepared.scale == pytest.approx(np.sqrt(square))
    places = [[x, y, z] for z in (30.0, 30.0 + depth) for y in (20.0, 21.0) for x in (10.0, 11.0, 12.0, 13.0)]
    np.testing.assert_allclose(in_grain(prepared, prepared.hull), places)
    np.testing.assert_allclose(prepared.hull[0], [-1.5, -0.5, -0.5 * depth] / np.sqrt(square))
    assert prepared.mask.sum() == 16
    # The voxel of the mask that stands for a scan voxel stands at that voxel's place.
    z, y, x = np.argwhere(prepared.mask)[-1]
    np.testing.assert_allclose(
        in_grain(prepared, np.array([x, y, z]) * prepared.spacing + prepared.origin),
        [13.0, 21.0, 30.0 + depth],
    )
    assert prepared.volume * prepared.scale**3 == pytest.approx(16 * depth)


def test_the_middle_voxel_of_a_cube_is_not_in_its_hull() -> None:
    prepared = prepare(Grain(np.ones((3, 3, 3), dtype=bool), VoxelSize(2, 2, 2, "um")), hull="voxels")
    assert len(prepared.hull) == 26
    # 6 face, 12 edge and 8 corner voxels at squared distances 1, 2 and 3 voxels.
    assert prepared.scale == pytest.approx(2 * np.sqrt((6 + 24 + 24) / 26))
    assert len(prepare(prepared.grain, hull="voxels", hull_points=11).hull) == 11


def test_a_plate_thinner_than_half_a_block_keeps_a_surface() -> None:
    prepared = prepare(Grain(np.ones((1, 90, 90), dtype=bool), VoxelSize(1, 1, 1, "um")), working_side=30)
    assert prepared.mask.any()
    assert prepared.volume * prepared.scale**3 == pytest.approx(8100)
    np.testing.assert_allclose(prepared.center[:2], 44.5, atol=0.5)
