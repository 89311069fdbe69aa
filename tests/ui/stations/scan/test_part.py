"""A part of the scan is chosen by a box in the slices, and taken as one step of undo."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from mbstudio.core.project import Project
from mbstudio.core.scan.excerpt import Excerpt
from mbstudio.scene.layers.picking import to_display
from mbstudio.ui import workspace as workspace_module
from mbstudio.ui.stations.scan.part_draft import BINS
from tests.ui.hand import changed
from tests.ui.view.test_slices import drag


@pytest.fixture
def choosing(scanned, idle):
    """The window with a box around all of the scan of 64 cubed voxels of 14 µm."""
    scanned.messages.dismiss()
    idle()
    assert scanned.commands.run("scan.choose_part")
    idle()
    return scanned


@pytest.fixture
def draft(choosing):
    return choosing.stations.scan.draft


@pytest.fixture
def form(choosing):
    return choosing.stations.scan.panel.part_form


def test_the_box_begins_around_all_of_the_scan(choosing, draft, form) -> None:
    assert form.isVisible()
    assert draft.ends == {"z": (0, 64), "y": (0, 64), "x": (0, 64)}
    assert form.result.text() == "64 × 64 × 64 voxels of 14 µm, 524 kB"
    assert not form.take_button.isEnabled()
    assert not form.reset_button.isEnabled()
    for pane in choosing.slice_views.panes.panes.values():
        assert pane.box.ends == ((0, 64), (0, 64))


def test_fields_slices_and_space_show_one_box(choosing, draft, form, idle) -> None:
    form.fields["x"][0].setValue(10)
    form.fields["x"][1].setValue(30)
    form.fields["z"][1].setValue(20)
    panes = choosing.slice_views.panes.panes
    assert panes["z"].box.ends == ((10, 30), (0, 64))
    assert panes["y"].box.ends == ((10, 30), (0, 20))
    assert panes["x"].box.ends == ((0, 64), (0, 20))
    # Slice z = 32 is not in it.
    assert [panes[axis].box.cuts_slice for axis in "xyz"] == [False, True, False]
    choosing.view.move_slice("z", 19)
    choosing.view.move_slice("x", 10)
    assert [panes[axis].box.cuts_slice for axis in "xyz"] == [True, True, True]
    bounds = np.array(choosing.view.scene.layers.part_box.actors[0].bounds).reshape(3, 2)
    np.testing.assert_allclose(bounds, 14 * (np.array([[10, 30], [0, 64], [0, 20]]) - 0.5))
    assert form.result.text() == "20 × 64 × 20 voxels of 14 µm, 51.2 kB"
    # An edge dragged in a slice comes back to the fields.
    pane = panes["z"]
    drag(pane, Qt.MouseButton.LeftButton, pane.place_of(29.5, 40), pane.place_of(39.5, 40))
    assert draft.ends["x"] == (10, 40)
    assert form.fields["x"][1].value() == 40
    assert form._lengths["x"].text() == "420 µm"
    QTest.mouseClick(form.reset_button, Qt.MouseButton.LeftButton)
    assert draft.ends == {"z": (0, 64), "y": (0, 64), "x": (0, 64)}


def test_the_box_is_seen_in_space(choosing, draft, idle) -> None:
    view = choosing.view
    draft.set_ends({"z": (40, 60), "y": (5, 20), "x": (40, 60)})
    idle()
    view.scene.layers.slices.show(False)
    scene = view.scene
    with_box = scene.screenshot()
    corners = np.array([[x, y, 39.5] for x in (39.5, 59.5) for y in (4.5, 19.5)]) * 14
    middles = (corners[[0, 0, 1, 2]] + corners[[1, 2, 3, 3]]) / 2
    grain = np.array([int(scene.theme.grain[i : i + 2], 16) for i in (1, 3, 5)])
    for x, y in to_display(choosing.viewport.plotter.renderer, middles):
        column, row = round(x), with_box.shape[0] - 1 - round(y)
        near = with_box[row - 2 : row + 3, column - 2 : column + 3].reshape(-1, 3).astype(int)
        assert np.abs(near - grain).sum(axis=1).min() < 60
    draft.end()
    idle()
    assert changed(with_box, scene.screenshot()) > 0.002
    view.scene.layers.slices.show(True)


def test_a_bin_tells_what_becomes_of_the_scan(choosing, draft, form) -> None:
    form.bin_field.setCurrentIndex(BINS.index((1, 2, 2)))
    form.bin_field.activated.emit(form.bin_field.currentIndex())
    assert form.result.text() == "64 × 32 × 32 voxels of 14 x 28 x 28 µm (z, y, x), 131 kB"
    assert not form.remark.isVisible()
    draft.set_bin((3, 3, 3))
    assert form.result.text().startswith("21 × 21 × 21 voxels of 42 µm")
    assert form.remark.text() == "Voxels at the far end that fill no block are left out: z 1, y 1, x 1."
    draft.set_ends({"y": (4, 6)})
    assert "larger than the region" in form.result.text()
    assert not form.take_button.isEnabled()


def test_a_part_is_taken_undone_and_saved(choosing, draft, idle, tmp_path) -> None:
    space = choosing.workspace
    whole = space.scan
    draft.set_ends({"z": (0, 40), "x": (9, 64)})
    draft.set_bin((1, 2, 1))
    assert choosing.commands.run("scan.take_part")
    idle()
    part = space.scan
    assert part.shape == (40, 32, 55)
    expected = whole.cropped("0:40,:,9:").binned("1,2,1")
    np.testing.assert_array_equal(part.voxels, np.asarray(expected.voxels))
    assert part.origin == (9 * 14, 7, 0)
    assert space.state.scan.excerpt == Excerpt((64, 64, 64), (0, 0, 9), (40, 64, 64), (1, 2, 1))
    panel = choosing.stations.scan.panel
    assert not panel.part_form.isVisible()
    assert panel._values["Part"].text() == "0:40, 0:64, 9:64 of 64 × 64 × 64; bin 1 × 2 × 1"
    assert panel._values["Memory"].text() == "141 kB"
    assert choosing.slice_views.panes.panes["z"].box.ends is None
    assert space.undo_title == "Crop and bin scan"
    space.project.save(tmp_path / "part.mbs")
    assert Project.open(tmp_path / "part.mbs").scan.shape == (40, 32, 55)
    space.undo()
    assert space.scan.shape == (64, 64, 64)
    space.redo()
    assert space.scan.shape == (40, 32, 55)
    assert choosing.commands.run("scan.whole")
    idle()
    assert space.scan.shape == (64, 64, 64)
    assert space.state.scan.excerpt is None
    assert space.scan.origin == (0, 0, 0)


def test_large_scans_are_read_again_for_undo(choosing, draft, idle, monkeypatch) -> None:
    """What one crops for want of memory is not kept in memory."""
    monkeypatch.setattr(workspace_module, "KEPT_BYTES", 0)
    space = choosing.workspace
    whole = np.array(space.scan.voxels)
    # As a packed file is: unpacked into memory.
    key = space.state.scan.identity
    from dataclasses import replace

    space._scans[key] = replace(space._scans[key], voxels=whole.copy())
    space._take_scan()
    draft.begin(space.scan)
    draft.set_ends({"z": (10, 40)})
    assert choosing.commands.run("scan.take_part")
    idle()
    assert set(space._scans) == {space.state.scan.identity}
    assert space.scan.voxels.base is None
    space.undo()
    idle()
    np.testing.assert_array_equal(np.asarray(space.scan.voxels), whole)


def test_grains_go_with_the_whole_scan_and_that_is_said_before(segmented, idle) -> None:
    window = segmented
    assert window.commands.run("scan.choose_part")
    assert window.stations.current.id == "scan"
    form = window.stations.scan.panel.part_form
    assert "found anew" in form.remark.text()
    window.stations.scan.draft.set_ends({"z": (10, 64)})
    assert window.commands.run("scan.take_part")
    idle()
    assert window.workspace.state.grains is None
    window.workspace.undo()
    assert len(window.workspace.state.grains) == 3


def test_the_box_stays_at_its_station(choosing, draft, form, idle) -> None:
    draft.set_ends({"z": (10, 40)})
    choosing.enter("grains")
    assert choosing.slice_views.panes.panes["x"].box.ends is None
    assert not choosing.view.scene.layers.part_box.holds_something
    choosing.enter("scan")
    assert choosing.slice_views.panes.panes["x"].box.ends == ((0, 64), (10, 40))
    form.cancelled.emit()
    assert draft.scan is None
    assert not form.isVisible()
    assert choosing.workspace.scan.shape == (64, 64, 64)


def test_a_binned_scan_is_cropped_but_not_binned_again(choosing, draft, form, idle) -> None:
    draft.set_bin((2, 2, 2))
    assert choosing.commands.run("scan.take_part")
    idle()
    assert choosing.commands.run("scan.choose_part")
    assert not form.bin_field.isEnabled()
    assert "binned already" in form.remark.text()
    draft.set_ends({"x": (4, 30)})
    assert choosing.commands.run("scan.take_part")
    idle()
    assert choosing.workspace.state.scan.excerpt == Excerpt((64, 64, 64), (0, 0, 8), (64, 64, 60), (2, 2, 2))
