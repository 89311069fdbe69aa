"""The real OpenGL viewport, under Xvfb."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest

from mbstudio.scene.layers.picking import to_display


@pytest.mark.gl
def test_the_real_viewport_shows_scan_grains_and_avatar(segmented, idle, qtbot):
    window = segmented
    assert window.viewport.kind == "OpenGL"
    assert window.viewport.picture().std() > 10
    window.workspace.select(window.workspace.state.grains.interior_labels[0])
    assert window.commands.run("fit.grain")
    idle()
    both = window.viewport.picture()
    window.view.show_layer("avatar", False)
    assert (both != window.viewport.picture()).any(axis=2).mean() > 0.01
    # What the screen shows is what was rendered.
    window.view.show_layer("avatar", True)
    window.viewport.render_now()
    qtbot.wait(200)
    grabbed = window.screen().grabWindow(window.winId()).toImage()
    place = window.viewport.mapTo(window, window.viewport.rect().center())
    ratio = grabbed.width() / window.width()
    colour = grabbed.pixelColor(round(place.x() * ratio), round(place.y() * ratio))
    assert colour.saturation() > 40, "the middle of the view shows no coloured surface"


@pytest.mark.gl
def test_many_chosen_grains_stand_out_in_the_real_viewport(segmented, idle):
    window = segmented
    window.enter("grains")
    labels = window.workspace.state.grains.interior_labels
    window.workspace.choose(labels[:1])
    idle()
    one = window.viewport.picture()
    window.workspace.choose(labels)
    idle()
    assert (one != window.viewport.picture()).any(axis=2).mean() > 0.01


@pytest.mark.gl
def test_a_click_chooses_a_grain(segmented, idle):
    window = segmented
    window.view.look_from("top")
    label = window.workspace.state.grains.interior_labels[0]
    window.viewport.render_now()
    renderer = window.viewport.plotter.renderer
    renderer.SetWorldPoint(*window.workspace.state.grains.grain(label).centroid, 1.0)
    renderer.WorldToDisplay()
    x, y, _ = renderer.GetDisplayPoint()
    window.viewport.clicked.emit(x, y)
    assert window.workspace.selected == label


@pytest.mark.gl
def test_a_slice_is_dragged_in_the_real_viewport(scanned, idle):
    window, viewport = scanned, scanned.viewport
    window.view.look_from("front")
    idle()
    viewport.render_now()
    slices = window.view.scene.layers.slices.planes
    corner = slices.corners("z")[0]
    above = corner + np.array([0, 0, 10 * slices.spacing("z")])
    places = to_display(viewport.plotter.renderer, np.array([corner, above]))
    places[:, 0] += 12
    ratio = viewport.devicePixelRatioF()
    start, end = (QPoint(round(x / ratio), round(viewport.height() - y / ratio)) for x, y in places)
    stood = viewport.plotter.renderer.GetActiveCamera().GetPosition()
    QTest.mousePress(viewport.canvas, Qt.MouseButton.LeftButton, pos=start)
    QTest.mouseMove(viewport.canvas, end)
    QTest.mouseRelease(viewport.canvas, Qt.MouseButton.LeftButton, pos=end)
    assert abs(slices.index["z"] - 42) <= 1
    assert viewport.plotter.renderer.GetActiveCamera().GetPosition() == stood, "the view was not turned"


@pytest.mark.gl
def test_the_real_viewport_makes_finer_pictures_and_columns(segmented, idle):
    window = segmented
    window.enter("grains")
    idle()
    one, two = window.viewport.picture(), window.viewport.picture(2)
    assert two.shape[:2] == (2 * one.shape[0], 2 * one.shape[1])
    halved = two.reshape(one.shape[0], 2, one.shape[1], 2, 3).mean(axis=(1, 3))
    assert np.abs(halved - one).mean() < 6
    window.workspace.select(window.workspace.state.grains.interior_labels[0])
    window.enter("fit")
    idle()
    # A message that goes away in between would make room for the view.
    window.messages.dismiss()
    idle()
    before = window.viewport.picture()
    assert window.commands.run("view.side_by_side")
    idle()
    beside = window.viewport.picture().astype(int)
    middle = beside[beside.shape[0] // 2, beside.shape[1] // 6]
    assert middle[0] > middle[2] + 40, "the grain stands in the first column"
    assert window.commands.run("view.side_by_side")
    idle()
    assert np.abs(window.viewport.picture().astype(int) - before).mean() < 1


@pytest.mark.gl
def test_the_clipping_box_cuts_in_the_real_viewport(segmented, idle):
    window = segmented
    window.enter("grains")
    idle()
    before = window.viewport.picture().astype(int)
    assert window.commands.run("view.clip")
    window.view_tools.bar.sliders[2].setValue((0, 300))
    idle()
    cut = window.viewport.picture().astype(int)
    height = min(len(cut), len(before))
    assert (np.abs(cut[-height:] - before[-height:]).max(axis=2) > 40).mean() > 0.01
