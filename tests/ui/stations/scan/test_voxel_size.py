"""The voxel size is corrected in the window, with typical lengths before and after."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from mbstudio.core.project import Project
from mbstudio.ui.stations.scan.voxel_size_dialog import VoxelSizeDialog
from tests.core.grains.editing.placed_grains import placed_grains, scan_of


@pytest.fixture
def at_scan(window, idle):
    grains = placed_grains()
    scan = scan_of(grains.labels)
    project = Project.new(scan, embed_scan=True)
    project.change("Find grains", grains=grains)
    window.workspace.replace_project(project)
    window.workspace.give_scan(scan)
    window.studio.enter("scan")
    idle()
    return window


def test_the_dialog_shows_lengths_before_and_after_and_one_step_of_undo_follows(at_scan, idle):
    space = at_scan.workspace
    before = space.state
    assert at_scan.commands.run("scan.voxel_size")
    dialog = at_scan.findChild(VoxelSizeDialog)
    assert not dialog.button.isEnabled(), "it is this size already"
    QTest.keyClicks(dialog.field, "3 um")
    assert dialog.shown("voxel") == ("2 µm", "3 µm")
    assert dialog.shown("extent") == ("80 µm × 96 µm × 144 µm", "120 µm × 144 µm × 216 µm")
    old, new = (float(words.split()[0]) for words in dialog.shown("diameter"))
    assert new == pytest.approx(1.5 * old, rel=0.01)
    QTest.keyClick(dialog.field, Qt.Key.Key_Return)
    idle()
    assert space.state.scan.voxel_size.zyx == (3.0, 3.0, 3.0)
    assert space.scan.voxel_size.zyx == (3.0, 3.0, 3.0)
    np.testing.assert_allclose(
        space.state.grains.table["volume"], before.grains.table["volume"] * 1.5**3, rtol=1e-12
    )
    assert at_scan.view.scene.layers.slices.planes.spacing("x") == 3.0
    assert "3 µm" in at_scan.messages.text
    assert at_scan.commands.run("edit.undo")
    idle()
    assert space.state is before
    assert space.scan.voxel_size.zyx == (2.0, 2.0, 2.0)


def test_what_is_no_size_is_said(at_scan):
    assert at_scan.commands.run("scan.voxel_size")
    dialog = at_scan.findChild(VoxelSizeDialog)
    QTest.keyClicks(dialog.field, "three")
    assert "Cannot read the voxel size" in dialog._told.text()
    assert not dialog.button.isEnabled()
    dialog.reject()
