"""Station Grains: what the panel sets reaches the segmentation, and what it warns of is shown."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import SegmentationError
from mbstudio.core.grains import SegmentationSettings
from tests.core.grains.degraded import packed, scanned, scattered


@pytest.mark.parametrize(
    "chosen",
    [
        SegmentationSettings(),
        SegmentationSettings(threshold=120.0, dark=True, splitting=0.6),
        SegmentationSettings(ranges=(90.0, 140.0, 200.0, 255.0), dark=False, smallest_voxels=100),
    ],
)
def test_the_panel_gives_back_the_settings_that_it_shows(window, chosen):
    panel = window.stations.grains.panel
    panel.show_settings(chosen)
    assert panel.settings() == chosen
    assert panel.threshold.isVisibleTo(panel) == (chosen.threshold is not None)
    assert panel.ranges.isVisibleTo(panel) == bool(chosen.ranges)


def test_ranges_that_are_none_are_refused_by_name(window):
    panel = window.stations.grains.panel
    panel.show_settings(SegmentationSettings(ranges=(1.0, 2.0)))
    panel.ranges.setText("140:90")
    with pytest.raises(SegmentationError, match="140:90"):
        panel.settings()


def test_dark_grains_are_found_and_told(window, idle, tmp_path):
    truth = scattered(0.05, edge=64)
    np.save(tmp_path / "dark.npy", scanned(truth, dark=True))
    window.stations.scan.work.open(tmp_path / "dark.npy", voxel_size="10 um")
    idle()
    window.stations.grains.work.find(SegmentationSettings())
    idle()
    assert len(window.workspace.state.grains) == truth.max()
    assert window.messages.level == "warning"
    assert "darker than what lies between" in window.messages.text


def test_the_verdict_is_shown_with_what_to_do(window, idle, tmp_path):
    np.save(tmp_path / "scan.npy", scanned(packed(5)))
    window.stations.scan.work.open(tmp_path / "scan.npy", voxel_size="10 um")
    idle()
    panel = window.stations.grains.panel
    window.stations.grains.work.find(SegmentationSettings())
    idle()
    assert (panel.verdict.property("badge"), panel.verdict.text()) == ("good", "● Sound")
    assert not panel._doubts.isVisibleTo(panel)
    assert "Contrast to noise" in panel.verdict.toolTip()
    assert window.messages.level == "success"
    window.stations.grains.work.find(SegmentationSettings(splitting=0.3))
    idle()
    assert panel.verdict.property("badge") == "bad"
    assert "splitting" in panel._doubts.text()
    assert window.messages.level == "warning"
    window.workspace.undo()
    assert panel.verdict.property("badge") == "good"
