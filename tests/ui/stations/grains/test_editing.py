"""Grains are corrected by mouse and keys; what comes of it is what Python gives, and undo takes it back."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
import tifffile
from PySide6.QtCore import Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtTest import QTest

from mbstudio.core.errors import GrainWarning
from mbstudio.core.grains.verdict import SegmentationVerdict
from mbstudio.ui.stations.grains.table_model import COLUMNS
from tests.core.project.conftest import make_fit

LEFT = Qt.MouseButton.LeftButton
Z, Y, X = "z", "y", "x"


def press(window, key, modifier=Qt.KeyboardModifier.NoModifier):
    QTest.keyClick(window, key, modifier)
    QTest.qWait(20)


def pane_across(window, axis):
    return window.slice_views.panes.panes[axis]


def click(pane, column, row):
    QTest.mouseClick(pane, LEFT, pos=pane.place_of(column, row).toPoint())


def same(window, grains):
    assert np.array_equal(window.workspace.state.grains.labels, grains.labels)


def test_keys_merge_delete_and_exclude_the_chosen_grains(at_grains, grains):
    space = at_grains.workspace
    space.choose([1, 2], 2)
    press(at_grains, Qt.Key.Key_M)
    same(at_grains, grains.merged([2, 1]))
    assert space.chosen == {2}
    assert space.state.changed_labels == {2}
    assert set(space.state.fits) == {2, 3, 4}
    press(at_grains, Qt.Key.Key_Delete)
    same(at_grains, grains.merged([2, 1]).without([2]))
    space.choose([4])
    press(at_grains, Qt.Key.Key_X)
    assert space.state.grains.excluded_labels == {4}
    press(at_grains, Qt.Key.Key_X)
    assert space.state.grains.excluded_labels == frozenset()
    for _ in range(4):
        press(at_grains, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    same(at_grains, grains)
    assert set(space.state.fits) == {1, 2, 3, 4}


def test_the_verdict_says_that_grains_were_corrected(at_grains, grains):
    verdict = SegmentationVerdict({"solidity": 0.95}, 2, "the whole box")
    at_grains.workspace.change("Judge", grains=replace(grains, verdict=verdict))
    panel = at_grains.stations.grains.panel
    assert not panel._doubts.isVisible()
    at_grains.workspace.choose([2], 2)
    press(at_grains, Qt.Key.Key_Delete)
    assert "Edited by hand once" in panel._doubts.text()
    assert panel._doubts.isVisible()
    assert at_grains.messages.text.startswith("Deleted a grain.")


def test_grains_that_do_not_touch_are_asked_for(at_grains, grains):
    at_grains.workspace.choose([1, 3], 1)
    press(at_grains, Qt.Key.Key_M)
    same(at_grains, grains)
    assert at_grains.messages.level == "warning"
    assert "do not touch" in at_grains.messages.text
    at_grains.stations.grains.editing.merge(apart=True)
    with pytest.warns(GrainWarning):
        wanted = grains.merged([1, 3], apart=True)
    same(at_grains, wanted)


def test_a_grain_is_split_by_clicked_seeds_once_the_preview_is_taken(at_grains, grains):
    space, view = at_grains.workspace, at_grains.view
    for axis, index in ((Z, 25), (Y, 33), (X, 27)):
        view.move_slice(axis, index)
    press(at_grains, Qt.Key.Key_S)
    tools = at_grains.stations.grains.tools
    assert tools.tool == "seeds"
    pane = pane_across(at_grains, Z)
    click(pane, 20, 33)
    assert tools.seeds == [(25, 33, 20)]
    assert not tools.can_accept
    click(pane, 34, 33)
    assert tools.can_accept
    same(at_grains, grains)  # shown, not taken
    shown = view.scene.layers.slices.planes._labels
    wanted = grains.split(3, [(25, 33, 20), (25, 33, 34)], scan=space.scan)
    assert np.array_equal(np.asarray(shown), wanted.labels)
    press(at_grains, Qt.Key.Key_Return)
    same(at_grains, wanted)
    assert tools.tool == ""
    assert space.undo_title == "Split grain 3"
    space.undo()
    same(at_grains, grains)


def test_a_split_that_is_given_up_leaves_everything(at_grains, grains):
    view, tools = at_grains.view, at_grains.stations.grains.tools
    view.move_slice(Z, 25)
    press(at_grains, Qt.Key.Key_S)
    pane = pane_across(at_grains, Z)
    click(pane, 20, 33)
    click(pane, 22, 33)
    assert "lie in one basin" in at_grains.messages.text
    assert tools.seeds == [(25, 33, 20)]
    click(pane, 34, 33)
    assert tools.can_accept
    press(at_grains, Qt.Key.Key_Escape)  # the message
    press(at_grains, Qt.Key.Key_Escape)
    assert tools.tool == ""
    assert view.slice_tool is None
    same(at_grains, grains)
    assert np.array_equal(np.asarray(view.scene.layers.slices.planes._labels), grains.labels)
    click(pane, 5, 5)  # the lines move again
    assert view.scene.layers.slices.planes.index[X] == 5


def test_strokes_paint_and_erase_in_the_slice(at_grains, grains):
    view, space = at_grains.view, at_grains.workspace
    view.move_slice(Z, 12)
    space.select(1)
    press(at_grains, Qt.Key.Key_B)
    pane = pane_across(at_grains, Z)
    places = [pane.place_of(14, row) for row in (22, 26, 30)]
    QTest.mousePress(pane, LEFT, pos=places[0].toPoint())
    for place in places[1:]:
        moved = QMouseEvent(
            QMouseEvent.Type.MouseMove, place, pane.mapToGlobal(place), Qt.MouseButton.NoButton, LEFT,
            Qt.KeyboardModifier.NoModifier,
        )  # fmt: skip
        pane.mouseMoveEvent(moved)
    QTest.mouseRelease(pane, LEFT, pos=places[-1].toPoint())
    painted = space.state.grains
    stroke = painted.edits[-1]
    same(at_grains, grains.painted(1, stroke.centres, stroke.radius, axis=0))
    assert at_grains.stations.grains.tools.tool == "paint"  # for the next stroke
    press(at_grains, Qt.Key.Key_E)
    click(pane, 14, 12)
    erased = space.state.grains.edits[-1]
    assert erased.kind == "erase"
    same(at_grains, painted.erased(1, erased.centres, erased.radius, axis=0))
    press(at_grains, Qt.Key.Key_E)
    space.undo()
    space.undo()
    same(at_grains, grains)


def test_outlines_of_chosen_grains(at_grains, grains):
    editing = at_grains.stations.grains.editing
    at_grains.workspace.choose([1, 3], 3)
    editing.grow()
    editing.shrink()
    editing.smooth()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GrainWarning)
        same(at_grains, grains.grown([3, 1]).shrunk([3, 1]).smoothed([3, 1]))
    editing.fill_holes()
    assert "no holes" in at_grains.messages.text


def test_the_table_shows_what_is_excluded_and_what_has_changed(at_grains):
    table, space = at_grains.stations.grains.table, at_grains.workspace
    content = table.content
    names = [column.name for column in COLUMNS]
    use, verdict = names.index("use"), names.index("verdict")
    assert table.isColumnHidden(use)
    space.choose([4])
    press(at_grains, Qt.Key.Key_X)
    assert not table.isColumnHidden(use)
    assert content.data(content.index(content.row(4), use)) == "excluded"
    space.choose([3])
    at_grains.stations.grains.editing.grow()
    assert content.data(content.index(content.row(3), verdict)) == "changed"
    assert content.data(content.index(content.row(1), verdict)) == "not valid"


def test_keys_count_at_this_station_only(at_grains, grains):
    at_grains.workspace.choose([1, 2])
    at_grains.studio.enter("fit")
    press(at_grains, Qt.Key.Key_M)
    press(at_grains, Qt.Key.Key_Delete)
    same(at_grains, grains)


def test_labels_are_saved_as_an_image(at_grains, grains, tmp_path):
    at_grains.stations.grains.editing.save_labels(tmp_path / "labels.tif")
    assert np.array_equal(tifffile.imread(tmp_path / "labels.tif"), grains.labels)
    at_grains.stations.grains.editing.save_labels(tmp_path / "missing" / "labels.tif")
    assert at_grains.messages.level == "error"


def test_a_fit_of_a_grain_that_was_corrected_meanwhile_is_discarded(at_grains, rng):
    space, work = at_grains.workspace, at_grains.stations.fit.work
    begun = space.state.grains

    class Item:
        def __init__(self, label):
            self.label, self.result, self.error = label, make_fit(label, 6, rng), None

    items = [Item(1), Item(3)]
    space.choose([3])
    at_grains.stations.grains.editing.grow()
    work._take_many(begun, items)
    assert space.state.fits[1] is items[0].result
    assert space.state.fits[3] is not items[1].result
    assert "1 avatar was discarded" in at_grains.messages.text
