"""Previews show what the segmentation would find."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import ScanError
from mbstudio.core.grains import segment
from mbstudio.core.grains.foreground import find_foreground
from mbstudio.core.grains.preview.region_splitting import split_region
from mbstudio.core.grains.preview.slice_foreground import SliceForeground, grey_histogram
from mbstudio.core.grains.segmentation import SegmentationSettings
from mbstudio.core.scan import Scan
from mbstudio.core.scan.field_of_view import find_field_of_view
from mbstudio.core.units import VoxelSize
from tests.core.grains.degraded import scanned, scattered

SIZE = VoxelSize(10, 10, 10, "um")


@pytest.fixture(scope="module")
def scan():
    return Scan(scanned(scattered(0.2, 3, 56), seed=3, noise=0.3), VoxelSize(20, 10, 10, "um"))


def in_a_cylinder(scan):
    grey = scan.voxels.copy()
    y, x = np.indices(grey.shape[1:])
    grey[:, np.hypot(y - 27.5, x - 27.5) > 26] = 0
    return Scan(grey, scan.voxel_size)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(
    "settings",
    [
        SegmentationSettings(threshold=27_000.0, denoise_sigma=1.2),
        SegmentationSettings(threshold=27_000.0, denoise_sigma=0.0, dark=True),
        SegmentationSettings(ranges=(26_000.0, 31_000.0, 33_000.0, 40_000.0), denoise_sigma=0.5),
    ],
)
@pytest.mark.parametrize("whole", [True, False])
def test_a_slice_is_that_of_the_whole_scan(scan, axis, settings, whole):
    scan = scan if whole else in_a_cylinder(scan)
    view = find_field_of_view(scan.voxels)
    assert view.is_whole_box is whole
    found = find_foreground(
        scan, scan.voxels, view, threshold=settings.threshold, ranges=settings.ranges, dark=settings.dark,
        denoise_sigma=settings.denoise_sigma,
    ).mask  # fmt: skip
    shown = SliceForeground.of(scan)
    for index in (0, 20, 55):
        mask = shown.mask(axis, index, settings)
        # Sums are taken in another order: a voxel at the threshold itself may fall to the other side.
        assert (mask != found.take(index, axis)).mean() < 1e-3


def test_a_region_is_parted_as_the_whole_is(scan):
    scan = Scan(scanned(scattered(0.2, 3, 56), seed=3), SIZE)
    settings = SegmentationSettings(threshold=26_000.0, smallest_voxels=100)
    region = split_region(scan, (28, 28, 28), settings, edge=56)
    assert np.array_equal(region.labels > 0, segment(scan, settings).labels > 0)
    assert region.count == len(segment(scan, settings))


def test_a_region_at_the_edge_lies_within_the_scan(scan):
    region = split_region(scan, (0, 55, 30), SegmentationSettings(threshold=26_000.0), edge=30)
    assert region.box == (slice(0, 30), slice(26, 56), slice(15, 45))
    assert region.labels.shape == (30, 30, 30)


def test_a_region_in_which_all_is_alike_is_refused():
    flat = Scan(np.full((40, 40, 40), 9, np.uint8), SIZE)
    with pytest.raises(ScanError, match="constant"):
        split_region(flat, (20, 20, 20), SegmentationSettings())


def test_the_histogram_leaves_out_the_box_about_the_field_of_view(scan):
    counts, edges = grey_histogram(in_a_cylinder(scan))
    assert edges[0] > 5_000
    assert counts.sum() > 0.9 * 15 * np.pi * 26**2
    flat_counts, flat_edges = grey_histogram(Scan(np.full((3, 4, 5), 7, np.uint8), SIZE))
    assert flat_counts.sum() == 60
    assert flat_edges[-1] > flat_edges[0]
