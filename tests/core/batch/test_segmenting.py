"""Segmentation in another process gives what it gives in this one, and can be cancelled."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from mbstudio.core.batch.segmenting import segment_in_process
from mbstudio.core.errors import Cancelled, ScanError
from mbstudio.core.grains.segmentation import SegmentationSettings, segment
from mbstudio.core.scan import Scan, open_scan
from mbstudio.core.units import VoxelSize


def two_balls() -> np.ndarray:
    z, y, x = np.indices((30, 30, 56))
    inside = np.minimum(
        np.hypot(np.hypot(z - 15, y - 15), x - 16), np.hypot(np.hypot(z - 15, y - 14), x - 40)
    )
    return np.where(inside < 10, 200, 40).astype(np.uint8)


def test_gives_what_segment_gives(tmp_path):
    np.save(tmp_path / "balls.npy", two_balls())
    for scan in (
        open_scan(tmp_path / "balls.npy", voxel_size="20 x 10 x 10 um"),
        Scan(two_balls(), VoxelSize.parse("20 x 10 x 10 um"), (5.0, 6.0, 7.0)),
    ):
        settings = SegmentationSettings(smallest_voxels=100)
        here = segment(scan, settings)
        there = segment_in_process(scan, settings)
        assert len(there) == 2
        np.testing.assert_array_equal(there.labels, here.labels)
        pd.testing.assert_frame_equal(there.table, here.table)
        assert there.origin == scan.origin


def test_reports_progress_and_can_be_cancelled():
    seen = []

    def progress(fraction, message):
        seen.append((fraction, message))
        if fraction > 0:
            raise Cancelled("The work was cancelled.")

    with pytest.raises(Cancelled):
        segment_in_process(Scan(two_balls(), VoxelSize.parse("1 um")), progress=progress)
    assert seen[0][0] == 0
    assert seen[-1][0] > 0


def test_errors_come_back_as_they_are():
    scan = Scan(np.full((8, 8, 8), 7, np.uint8), VoxelSize.parse("1 um"))
    with pytest.raises(ScanError, match="constant"):
        segment_in_process(scan)
