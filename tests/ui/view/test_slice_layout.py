"""The flat slices large, two by two, magnified together, with fills, outlines and the avatar's outline."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QPointF, Qt
from PySide6.QtTest import QTest

from mbstudio.core.imaging import fit
from mbstudio.core.project import Project
from mbstudio.scene.theme import rgb
from tests.core.grains.editing.placed_grains import placed_grains, scan_of
from tests.ui.view.test_slices import hover, wheel

LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def at_grains(window, idle):
    """The window at station Grains, with four grains."""
    grains = placed_grains()
    scan = scan_of(grains.labels)
    project = Project.new(scan, embed_scan=True)
    project.change("Find grains", grains=grains)
    window.workspace.replace_project(project)
    window.workspace.give_scan(scan)
    window.resize(1500, 900)
    window.studio.enter("grains")
    idle()
    return window


@pytest.fixture
def panes(at_grains):
    return at_grains.slice_views.panes.panes


def press(window, key):
    QTest.keyClick(window, key)
    QTest.qWait(20)


def test_a_double_click_makes_a_slice_large_and_esc_small_again(at_grains, panes):
    pane, viewport = panes["y"], at_grains.viewport
    small = pane.size()
    QTest.mouseDClick(pane, LEFT, pos=pane.rect().center())
    QTest.qWait(20)
    assert pane.width() > 2 * small.width()
    assert not viewport.isVisible()
    assert panes["x"].isVisible(), "the others stay in their dock"
    QTest.keyClick(pane, Qt.Key.Key_Escape)
    QTest.qWait(20)
    assert viewport.isVisible()
    assert pane.width() < 1.5 * small.width()
    order = sorted("zyx", key=lambda axis: panes[axis].y())
    assert order == ["z", "y", "x"]
    for _ in range(2):
        QTest.mouseDClick(pane, LEFT, pos=pane.rect().center())
        QTest.qWait(20)
    assert viewport.isVisible(), "a second double click brings it back"


def test_four_in_a_square_and_each_of_them_large(at_grains, panes):
    viewport, grid = at_grains.viewport, at_grains.slice_views.grid
    press(at_grains, Qt.Key.Key_F10)
    assert at_grains.docks["slices"].isHidden()
    four = [*panes.values(), viewport]
    assert all(widget.isVisible() and widget.parentWidget() is grid for widget in four)
    assert {(w.x() > grid.width() / 3, w.y() > grid.height() / 3) for w in four} == {
        (False, False), (False, True), (True, False), (True, True),
    }  # fmt: skip
    sizes = [(w.width(), w.height()) for w in four]
    assert np.ptp(sizes, axis=0).max() <= 40
    QTest.mouseDClick(viewport.canvas, LEFT, pos=viewport.rect().center())
    QTest.qWait(20)
    assert viewport.width() >= grid.width() - 4
    assert not any(pane.isVisible() for pane in panes.values())
    QTest.mouseDClick(viewport.canvas, LEFT, pos=viewport.rect().center())
    panes["x"].setFocus()
    press(at_grains, Qt.Key.Key_F11)
    assert panes["x"].isVisible()
    assert not panes["z"].isVisible()
    press(at_grains, Qt.Key.Key_F11)
    assert not at_grains.slice_views.enlarged
    at_grains.studio.enter("populations")
    QTest.qWait(20)
    assert not any(pane.isVisible() for pane in panes.values())
    assert viewport.isVisible()
    at_grains.studio.enter("grains")
    QTest.qWait(20)
    assert all(pane.isVisible() for pane in panes.values())
    press(at_grains, Qt.Key.Key_F10)
    assert not at_grains.docks["slices"].isHidden()


def test_slices_are_magnified_together(at_grains, panes):
    for axis, index in (("z", 25), ("y", 33), ("x", 30)):
        at_grains.view.move_slice(axis, index)
    wheel(panes["z"], 5, Qt.KeyboardModifier.ControlModifier)
    assert panes["y"].is_magnified
    for other in "yx":
        assert panes[other].scale == pytest.approx(panes["z"].scale, rel=0.01)
    assert panes["y"].middle[0] == pytest.approx(panes["z"].middle[0], abs=0.1)
    assert panes["x"].middle[0] == pytest.approx(panes["z"].middle[1], abs=0.1)
    assert panes["y"].middle[1] == pytest.approx(25, abs=0.1), "where the third slice cuts"
    assert at_grains.commands.run("slices.linked")
    alone = panes["y"].scale
    wheel(panes["z"], 2, Qt.KeyboardModifier.ControlModifier)
    assert panes["y"].scale == alone
    press(at_grains, Qt.Key.Key_Home)
    assert not any(pane.is_magnified for pane in panes.values())


def test_a_magnified_slice_follows_the_lines(at_grains, panes):
    at_grains.commands.run("slices.linked")
    wheel(panes["z"], 12, Qt.KeyboardModifier.ControlModifier)
    at_grains.view.move_slice("x", 2)
    place = panes["z"].place_of(2, at_grains.view.scene.layers.slices.planes.index["y"])
    assert QPointF(panes["z"].rect().center()).x() == pytest.approx(place.x(), abs=2)


def colour_at(pane, column, row):
    shown = pane.grab().toImage()
    place = pane.place_of(column, row) * shown.devicePixelRatio()
    return np.array(shown.pixelColor(place.toPoint()).getRgb()[:3])


def test_grains_are_filled_outlined_or_left_out(at_grains, panes):
    bar, commands = at_grains.slice_views.panes.bar, at_grains.commands
    for axis, index in (("z", 12), ("y", 40), ("x", 60)):
        at_grains.view.move_slice(axis, index)
    planes, pane = at_grains.view.scene.layers.slices.planes, panes["z"]
    plain = colour_at(pane, 14, 12)
    assert np.ptp(plain) <= 2, "grey"
    bar.fill.setValue(100)
    assert np.abs(colour_at(pane, 14, 12) - planes.colours[1]).max() <= 2
    at_grains.view.show_layer("slices", True)
    assert np.abs(planes.images["z"][12, 14].astype(int) - planes.colours[1]).max() <= 2, "in space too"
    at_grains.workspace.select(2)
    commands.run("slices.chosen_only")
    assert np.ptp(colour_at(pane, 14, 12)) <= 2
    assert np.abs(colour_at(pane, 31, 12) - planes.colours[2]).max() <= 2
    commands.run("slices.chosen_only")
    bar.fill.setValue(0)
    outlined = pane.grab().toImage()
    commands.run("slices.outlines")
    assert pane.grab().toImage() != outlined
    assert np.ptp(colour_at(pane, 14, 12)) <= 2


def test_the_avatar_of_the_selected_grain_is_outlined_where_the_slice_cuts_it(at_grains, panes, idle):
    space, grains = at_grains.workspace, at_grains.workspace.state.grains
    space.add_fits({1: fit(grains.grain(1), 8)}, "Fit")
    space.select(1)
    idle()
    at_grains.view.move_slice("z", 12)
    (lines, colour), *_ = panes["z"]._outlines
    assert rgb(colour) == rgb(at_grains.theme.scene.avatar)
    # Grain 1 is a ball of 9 voxels at (12, 12, 14).
    away = np.linalg.norm(lines.reshape(-1, 2) - (14, 12), axis=1)
    assert away == pytest.approx(np.full(len(away), 9.0), abs=1.0)
    at_grains.view.move_slice("z", 30)
    assert not len(panes["z"]._outlines[0][0])
    at_grains.commands.run("slices.avatar")
    assert not panes["z"]._outlines


def test_the_grey_window_is_set_by_a_slider_and_by_itself(at_grains, panes):
    bar, planes = at_grains.slice_views.panes.bar, at_grains.view.scene.layers.slices.planes
    auto = planes.window
    bar.window_slider.setValue((120.0, 180.0))
    assert planes.window == pytest.approx((120.0, 180.0))
    assert at_grains.commands.run("slices.auto_window")
    assert planes.window == pytest.approx(auto)
    assert bar.window_slider.value() == pytest.approx(auto, abs=1.0)


def test_the_read_out_gives_voxels_and_lengths(at_grains, panes):
    at_grains.view.move_slice("z", 12)
    pane = panes["z"]
    hover(pane, pane.place_of(14, 13))
    words = at_grains.slice_views.readout.text()
    assert "x 33 µm   y 33 µm   z 33 µm" in words
    assert "voxel 14, 13, 12" in words
    assert words.endswith("grain 1")
