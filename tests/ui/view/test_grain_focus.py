"""One selection: a click anywhere chooses a grain everywhere; keys isolate it and zoom to it."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QMenu

from mbstudio.core.project import Project
from mbstudio.scene.layers.picking import to_display
from tests.core.grains.editing.placed_grains import placed_grains, scan_of
from tests.core.project.conftest import make_fit

LEFT, RIGHT = Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton
CTRL, NONE = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.NoModifier


@pytest.fixture
def at_grains(window, idle, rng):
    """The window at station Grains, with four grains, three of which have an avatar."""
    grains = placed_grains()
    scan = scan_of(grains.labels)
    project = Project.new(scan, embed_scan=True)
    project.change("Find grains", grains=grains)
    project.add_fits({label: make_fit(label, 4, rng) for label in (1, 2, 3)})
    window.workspace.replace_project(project)
    window.workspace.give_scan(scan)
    window.studio.enter("grains")
    window.resize(1500, 900)
    idle()
    return window


def cut_at(window):
    """Voxel (z, y, x) where the slices cross."""
    index = window.view.scene.layers.slices.planes.index
    return index["z"], index["y"], index["x"]


def pane_across(window, axis):
    return window.slice_views.panes.panes[axis]


def opened_menu(qtbot, window):
    def is_open():
        assert any(menu.isVisible() for menu in window.findChildren(QMenu) if menu.title() == "")

    qtbot.waitUntil(is_open)
    return next(menu for menu in window.findChildren(QMenu) if menu.isVisible() and menu.title() == "")


def titles(menu):
    return [action.text() for action in menu.actions() if action.text()]


def middle_on_screen(window, label):
    """Place of a grain's middle in the view's widget."""
    grains = window.workspace.state.grains
    row = grains.table.loc[grains.table["label"] == label].iloc[0]
    place = to_display(window.viewport.plotter.renderer, np.array([[row["x"], row["y"], row["z"]]]))[0]
    return QPoint(round(place[0]), round(window.viewport.height() - place[1]))


def test_slices_go_to_the_grain_that_is_chosen_in_the_table(at_grains):
    labels = at_grains.workspace.state.grains.label_volume
    for label in (2, 4):
        row = at_grains.stations.grains.table.content.row(label)
        at_grains.stations.grains.table.selectRow(row)
        assert at_grains.workspace.selected == label
        assert int(labels[cut_at(at_grains)]) == label


def test_slices_stay_while_they_cut_the_grain_or_a_tool_is_in_hand(at_grains):
    space = at_grains.workspace
    space.select(2)
    z, y, x = cut_at(at_grains)
    space.select(None)
    at_grains.view.move_slice("x", x + 2)
    space.select(2)
    assert cut_at(at_grains) == (z, y, x + 2)
    assert at_grains.commands.run("grains.paint")
    space.select(4)
    assert cut_at(at_grains) == (z, y, x + 2)


def test_a_click_in_a_slice_chooses_and_one_in_the_void_only_moves_the_lines(at_grains):
    space, pane = at_grains.workspace, pane_across(at_grains, "z")
    grains = space.state.grains
    z, y, x = grains.voxel_inside(1)
    at_grains.view.move_slice("z", z)
    QTest.mouseClick(pane, LEFT, pos=pane.place_of(x, y).toPoint())
    assert space.chosen == {1}
    z, y, x = grains.voxel_inside(2)
    at_grains.view.move_slice("z", z)
    QTest.mouseClick(pane, LEFT, CTRL, pane.place_of(x, y).toPoint())
    assert space.chosen == {1, 2}
    shape = grains.label_volume.shape
    assert not grains.label_volume[z, 1, 1]
    QTest.mouseClick(pane, LEFT, pos=pane.place_of(1, 1).toPoint())
    assert space.chosen == {1, 2}
    assert cut_at(at_grains)[1:] == (1, 1)
    # A drag moves the lines and chooses nothing.
    QTest.mousePress(pane, LEFT, pos=pane.place_of(1, 1).toPoint())
    QTest.mouseMove(pane, pane.place_of(x, y).toPoint())
    QTest.mouseRelease(pane, LEFT, pos=pane.place_of(x, y).toPoint())
    assert space.chosen == {1, 2}
    assert shape == grains.label_volume.shape


def test_a_click_in_the_view_chooses_also_in_a_slice_that_stands_there(at_grains, idle):
    space, view = at_grains.workspace, at_grains.view
    view.look_from("top")
    QTest.mouseClick(at_grains.viewport, LEFT, pos=middle_on_screen(at_grains, 3))
    assert space.chosen == {3}
    space.select(None)
    view.show_layer("grains", False)
    view.show_layer("slices", True)
    for axis in ("x", "y"):
        view.switch_slice(axis, False)
    view.move_slice("z", space.state.grains.voxel_inside(1)[0])
    idle()
    QTest.mouseClick(at_grains.viewport, LEFT, pos=middle_on_screen(at_grains, 1))
    assert space.chosen == {1}


def test_key_i_shows_the_chosen_grains_alone_and_again_all(at_grains, idle):
    space, layers = at_grains.workspace, at_grains.view.scene.layers
    space.choose([1, 2], 1)
    idle()
    assert layers.grains.holds_something
    assert any(actor.GetVisibility() for actor in layers.grains.actors[:1])
    QTest.keyClick(at_grains, Qt.Key.Key_I)
    assert at_grains.focus.isolated
    assert at_grains.commands.action("view.isolate").isChecked()
    shown = {int(v) for actor in layers.grains.actors for v in labels_of(actor)}
    assert shown == {2}  # the overview has gone; the chosen ones have surfaces of their own
    planes = layers.slices.planes
    assert planes.look.only == {1, 2}  # in the flat slices, too
    assert layers.grain.is_visible
    assert layers.grain.holds_something
    QTest.keyClick(at_grains, Qt.Key.Key_I)
    assert not at_grains.focus.isolated
    assert planes.look.only is None
    assert {int(v) for actor in layers.grains.actors for v in labels_of(actor)} == {1, 2, 3, 4}


def labels_of(actor):
    mesh = actor.mapper.dataset
    return np.unique(mesh.cell_data["label"]) if "label" in mesh.cell_data else []


def test_avatars_are_shown_alone_too(at_grains, idle):
    at_grains.studio.enter("populations")
    at_grains.view.show_layer("avatars", True)
    idle()
    at_grains.workspace.choose([1, 3])
    idle()
    layer = at_grains.view.scene.layers.avatars
    at_grains.focus.isolate(True)
    assert set(labels_of(layer.actors[0])) == {1, 3}
    at_grains.workspace.select(2)
    assert set(labels_of(layer.actors[0])) == {2}
    at_grains.workspace.select(None)  # nothing is chosen: everything is shown
    assert set(labels_of(layer.actors[0])) == {1, 2, 3}


def test_key_z_shows_the_grain_large_in_view_and_slices(at_grains, idle):
    space, camera = at_grains.workspace, at_grains.viewport.plotter.renderer.camera
    space.select(2)
    idle()
    before = camera.GetParallelScale()
    QTest.keyClick(at_grains, Qt.Key.Key_Z)
    assert camera.GetParallelScale() < 0.8 * before
    row = space.state.grains.table.set_index("label").loc[2]
    for axis, (first, second) in {"z": ("x", "y"), "y": ("x", "z")}.items():
        pane = pane_across(at_grains, axis)
        corner = pane.place_of(row[f"{first}0"], row[f"{second}0"])
        other = pane.place_of(row[f"{first}1"] - 1, row[f"{second}1"] - 1)
        assert pane.rect().contains(corner.toPoint())
        assert pane.rect().contains(other.toPoint())
        size = QPointF(other - corner)
        assert max(abs(size.x()) / pane.width(), abs(size.y()) / pane.height()) > 0.4


def test_every_view_offers_the_same_menu_on_grains(at_grains, qtbot, idle):
    space, table = at_grains.workspace, at_grains.stations.grains.table
    pane = pane_across(at_grains, "z")
    z, y, x = space.state.grains.voxel_inside(2)
    at_grains.view.move_slice("z", z)
    place = pane.place_of(x, y).toPoint()
    QTest.mouseClick(pane, RIGHT, pos=place)
    menu = opened_menu(qtbot, at_grains)
    assert space.chosen == {2}
    there = titles(menu)
    assert there[0] == "Grain 2"
    assert {"Fit grain again", "Delete grain", "Exclude grain", "Zoom to the chosen grains"} <= set(there)
    assert at_grains.commands.action("grains.delete") in menu.actions()
    menu.close()
    at_grains.view.look_from("top")
    QTest.mouseClick(at_grains.viewport, RIGHT, pos=middle_on_screen(at_grains, 2))
    menu = opened_menu(qtbot, at_grains)
    assert titles(menu) == there
    menu.close()
    index = table.content.index(table.content.row(2), 0)
    table.customContextMenuRequested.emit(table.visualRect(index).center())
    menu = opened_menu(qtbot, at_grains)
    assert titles(menu) == there
    menu.close()


def test_the_menu_counts_the_chosen_grains_and_keeps_them(at_grains, qtbot):
    space, table = at_grains.workspace, at_grains.stations.grains.table
    space.choose([1, 2, 4])
    index = table.content.index(table.content.row(4), 0)
    table.customContextMenuRequested.emit(table.visualRect(index).center())
    menu = opened_menu(qtbot, at_grains)
    assert space.chosen == {1, 2, 4}
    assert titles(menu)[0] == "3 chosen grains"
    assert {
        "Fit 3 chosen grains",
        "Merge 3 grains",
        "Measure 3 chosen grains",
        "Learn from 3 chosen grains…",
        "Export 2 chosen avatars…",
        "Sweep over n of 3 chosen grains…",
    } <= set(titles(menu))
    delete = next(action for action in menu.actions() if action.text() == "Delete 3 grains")
    delete.trigger()
    menu.close()
    assert list(space.state.grains.table["label"]) == [3]
