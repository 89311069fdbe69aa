"""The real OpenGL viewport, under Xvfb."""

from __future__ import annotations

import pytest


@pytest.mark.gl
def test_the_real_viewport_shows_scan_grains_and_avatar(segmented, idle, qtbot):
    window = segmented
    assert window.viewport.kind == "OpenGL"
    assert window.viewport.picture().std() > 10
    window.workspace.select(window.workspace.state.grains.interior_labels[0])
    assert window.commands.run("fit.grain")
    idle()
    both = window.viewport.picture()
    window.link.show_layer("avatar", False)
    assert (both != window.viewport.picture()).any(axis=2).mean() > 0.01
    # What the screen shows is what was rendered.
    window.link.show_layer("avatar", True)
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
    window.link.look_from("top")
    label = window.workspace.state.grains.interior_labels[0]
    window.viewport.render_now()
    renderer = window.viewport.plotter.renderer
    renderer.SetWorldPoint(*window.workspace.state.grains.grain(label).centroid, 1.0)
    renderer.WorldToDisplay()
    x, y, _ = renderer.GetDisplayPoint()
    window.viewport.clicked.emit(x, y)
    assert window.workspace.selected == label
