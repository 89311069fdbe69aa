"""Tools in the slices, by mouse and keys: lines, new grains, fills and the brush."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtTest import QTest

from mbstudio.core.grains.editing.records import Delete
from mbstudio.core.scan.field_of_view import FieldOfView
from mbstudio.scene.theme import rgb
from mbstudio.ui.stations.grains.editing.strokes import grain_under, simplified
from tests.ui.stations.grains.test_editing import LEFT, click, pane_across, press, same

X, Y, Z = "x", "y", "z"


def draw(pane, voxels, let_go=True):
    """Press at the first of some voxels (column, row), move over the others, and let go."""
    places = [pane.place_of(*voxel) for voxel in voxels]
    QTest.mousePress(pane, LEFT, pos=places[0].toPoint())
    for place in places[1:]:
        pane.mouseMoveEvent(
            QMouseEvent(
                QMouseEvent.Type.MouseMove, place, pane.mapToGlobal(place), Qt.MouseButton.NoButton, LEFT,
                Qt.KeyboardModifier.NoModifier,
            )
        )  # fmt: skip
    if let_go:
        QTest.mouseRelease(pane, LEFT, pos=places[-1].toPoint())


def test_a_line_parts_the_grain_that_it_crosses_once_it_is_taken(at_grains, grains, idle):
    space, view, tools = at_grains.workspace, at_grains.view, at_grains.stations.grains.tools
    view.move_slice(Z, 25)
    press(at_grains, Qt.Key.Key_S, Qt.KeyboardModifier.ShiftModifier)
    assert tools.tool == "line"
    draw(pane_across(at_grains, Z), [(27, 20), (27, 33), (27, 46)])
    idle()
    assert tools.can_accept
    assert space.selected == 3
    same(at_grains, grains)  # shown, not taken
    press(at_grains, Qt.Key.Key_Return)
    made = space.state.grains.edits[-1]
    assert made.kind == "split along"
    same(at_grains, grains.split_along(3, made.points, axis=0))
    assert len(space.state.grains) == 5
    press(at_grains, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    same(at_grains, grains)


def test_a_line_beside_all_grains_is_told(at_grains, grains):
    at_grains.view.move_slice(Z, 1)
    press(at_grains, Qt.Key.Key_S, Qt.KeyboardModifier.ShiftModifier)
    draw(pane_across(at_grains, Z), [(50, 5), (55, 8)])
    assert "no grain under the line" in at_grains.messages.text
    assert not at_grains.stations.grains.tools.can_accept
    same(at_grains, grains)


def test_a_new_grain_grows_from_a_click_and_follows_its_grey_value(at_grains, grains, idle):
    space, view, tools = at_grains.workspace, at_grains.view, at_grains.stations.grains.tools
    space.edit_grains(Delete(labels=(1,)), "Delete a grain")
    missing = space.state.grains
    view.move_slice(Z, 12)
    press(at_grains, Qt.Key.Key_W)
    click(pane_across(at_grains, Z), 14, 12)
    idle()
    same(at_grains, missing)  # shown, not taken
    shown = np.asarray(view.scene.layers.slices.planes._labels)
    assert (shown == 5).sum() == pytest.approx((grains.labels == 1).sum(), rel=0.1)
    level = tools._proposal.outcome.edit.threshold
    press(at_grains, Qt.Key.Key_BracketRight)
    idle()
    assert tools.level > level
    assert at_grains.stations.grains.tool_box.level.value() == pytest.approx(tools.level, abs=0.06)
    press(at_grains, Qt.Key.Key_Return)
    same(at_grains, missing.with_new_grain((12, 12, 14), space.scan, threshold=tools_level(space)))
    assert space.selected == 5
    press(at_grains, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    same(at_grains, missing)


def tools_level(space):
    return space.state.grains.edits[-1].threshold


def test_a_new_grain_is_given_up_with_esc_and_refused_in_a_grain(at_grains, grains, idle):
    view, tools = at_grains.view, at_grains.stations.grains.tools
    view.move_slice(Z, 12)
    press(at_grains, Qt.Key.Key_W)
    click(pane_across(at_grains, Z), 14, 12)
    idle()
    assert "belongs to grain 1" in at_grains.messages.text
    assert not tools.can_accept
    press(at_grains, Qt.Key.Key_Escape)  # the message
    press(at_grains, Qt.Key.Key_Escape)
    assert tools.tool == ""
    same(at_grains, grains)


def test_a_large_correction_is_tried_in_a_thread_and_taken_as_soon_as_it_is_there(
    at_grains, grains, idle, monkeypatch
):
    monkeypatch.setattr("mbstudio.ui.stations.grains.editing.slice_editing._AT_ONCE", 0)
    view, tools = at_grains.view, at_grains.stations.grains.tools
    view.move_slice(Z, 25)
    press(at_grains, Qt.Key.Key_S)
    click(pane_across(at_grains, Z), 20, 33)
    click(pane_across(at_grains, Z), 34, 33)
    tools.accept()
    idle()
    same(at_grains, grains.split(3, [(25, 33, 20), (25, 33, 34)], scan=at_grains.workspace.scan))


def test_a_click_fills_what_a_grain_encloses(at_grains, grains):
    space, view = at_grains.workspace, at_grains.view
    hollow = grains.erased(1, [(12, 12, 14)], 3.0)
    space.change("Make a hole", grains=hollow)
    space.select(1)  # to which the slices go
    view.move_slice(Z, 12)
    press(at_grains, Qt.Key.Key_F)
    click(pane_across(at_grains, Z), 14, 12)
    same(at_grains, hollow.filled(1, (12, 12, 14), axis=0))
    assert at_grains.stations.grains.tools.tool == "fill"  # for the next place
    click(pane_across(at_grains, Z), 40, 40)
    assert "does not enclose" in at_grains.messages.text


def test_keys_and_fields_change_the_brush(at_grains, grains):
    space, tools, box = (
        at_grains.workspace,
        at_grains.stations.grains.tools,
        at_grains.stations.grains.tool_box,
    )
    at_grains.view.move_slice(Z, 12)
    space.select(1)
    assert not box.radius.isVisible()
    press(at_grains, Qt.Key.Key_B)
    for _ in range(3):
        press(at_grains, Qt.Key.Key_BracketRight)
    press(at_grains, Qt.Key.Key_BracketLeft)
    assert tools.radius == box.radius.value() == 6.0
    box.radius.setValue(2.5)
    press(at_grains, Qt.Key.Key_B, Qt.KeyboardModifier.ShiftModifier)
    assert tools.in_space
    assert box.in_space.isChecked()
    draw(pane_across(at_grains, Z), [(14, 22), (14, 26)])
    stroke = space.state.grains.edits[-1]
    assert (stroke.radius, stroke.axis) == (2.5, None)
    same(at_grains, grains.painted(1, stroke.centres, 2.5))


def test_a_stroke_is_seen_before_the_button_is_let_go(at_grains, grains):
    at_grains.view.move_slice(Z, 3)
    at_grains.workspace.select(1)
    press(at_grains, Qt.Key.Key_B)
    pane = pane_across(at_grains, Z)
    place = (pane.place_of(50, 30) * pane.devicePixelRatioF()).toPoint()
    before = pane.grab().toImage().pixelColor(place)
    draw(pane, [(46, 30), (54, 30)], let_go=False)
    after = pane.grab().toImage().pixelColor(place)
    same(at_grains, grains)
    paint = np.array(rgb(pane._trail.brush.colour))
    away = [np.abs(np.array(colour.getRgb()[:3]) - paint).sum() for colour in (before, after)]
    assert away[1] < 0.6 * away[0]
    QTest.mouseRelease(pane, LEFT, pos=pane.place_of(54, 30).toPoint())
    assert at_grains.workspace.state.grains.edits[-1].kind == "paint"


def test_painting_beyond_the_field_of_view_is_refused(at_grains, grains):
    depth, height, width = grains.label_volume.shape
    seen = np.zeros((height, width), bool)
    seen[:, :45] = True
    space = at_grains.workspace
    space.change("Narrow", grains=replace(grains, view=FieldOfView(0, seen, (depth, height, width))))
    space.select(1)
    press(at_grains, Qt.Key.Key_B)
    click(pane_across(at_grains, Z), 52, 40)
    same(at_grains, grains)
    assert "beyond the field of view" in at_grains.messages.text


def test_a_drawn_line_keeps_the_corners_it_needs():
    straight = [(0, 0, x) for x in range(30)]
    assert simplified(straight) == [straight[0], straight[-1]]
    bent = [(0, y, 0) for y in range(20)] + [(0, 19, x) for x in range(1, 20)]
    assert simplified(bent) == [(0, 0, 0), (0, 19, 0), (0, 19, 19)]
    assert simplified([(1, 2, 3)]) == [(1, 2, 3)]


def test_a_line_belongs_to_the_grain_that_it_lies_in_most(grains):
    line = [(25, 33, 8), (25, 33, 60)]
    assert grain_under(grains.label_volume, line, None) == 3
    assert grain_under(grains.label_volume, [(12, 12, 8), (12, 12, 30)], 2) == 2
    assert grain_under(grains.label_volume, [(1, 1, 50), (1, 1, 52)], 3) is None
