"""The field of view is found in regions of a scan that cut through it."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.scan.excerpt import read_crop
from mbstudio.core.scan.field_of_view import find_field_of_view

CROPS = ["40:,:,:", ":,45:,:", ":,:,:30", ":,10:50,44:", ":,5:55,:", ":,:30,:30", ":,20:40,20:40"]


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("outside", [0, np.nan])
@pytest.mark.parametrize("crop", CROPS)
def test_a_region_sees_what_the_scan_has_seen_of_it(
    axis: int, outside: float, crop: str, rng: np.random.Generator
) -> None:
    voxels = rng.uniform(50, 200, (60, 60, 60)).astype(np.float32)
    y, x = np.indices((60, 60))
    voxels[:, np.hypot(y - 29.5, x - 29.5) > 30] = outside
    voxels = np.moveaxis(voxels, 0, axis)
    beside = [part for part in (0, 1, 2) if part != axis]
    block = [slice(None)] * 3
    parts = read_crop(crop, (60, 60, 60))
    for place, part in zip((axis, *beside), parts, strict=True):
        block[place] = part
    region = voxels[tuple(block)]
    view = find_field_of_view(region)
    seen = ~np.isnan(region) if np.isnan(outside) else region != outside
    np.testing.assert_array_equal(view.mask, seen)
    assert view.is_whole_box == bool(seen.all())
    if not view.is_whole_box:
        assert view.axis == axis
        assert np.isnan(view.padding) if np.isnan(outside) else view.padding == outside


def test_a_sliver_counts_where_its_columns_are_long(rng: np.random.Generator) -> None:
    voxels = rng.uniform(50, 200, (40, 100, 100)).astype(np.float32)
    y, x = np.indices((100, 100))
    sliver = x + y > 190
    voxels[:, sliver] = 0
    assert 0.001 < sliver.mean() < 0.01
    np.testing.assert_array_equal(find_field_of_view(voxels).footprint, ~sliver)
    assert find_field_of_view(voxels[:3]).is_whole_box


def test_lazy_voxels_will_do(rng: np.random.Generator) -> None:
    from mbstudio.core.scan.slice_stack import SliceStack

    voxels = rng.uniform(50, 200, (20, 50, 50))
    y, x = np.indices((50, 50))
    voxels[:, np.hypot(y, x) > 50] = 0
    stack = SliceStack(lambda index: voxels[index].copy(), voxels.shape, voxels.dtype)
    np.testing.assert_array_equal(find_field_of_view(stack).mask, voxels > 0)
