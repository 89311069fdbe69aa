"""Measuring and clipping in the window, by commands, mouse and keyboard; the map of deviations."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from mbstudio.scene.layers.picking import to_display


@pytest.fixture
def looking(with_grains, idle):
    """The window at station Grains, two ellipsoids from above."""
    with_grains.enter("grains")
    with_grains.view.look_from("top")
    idle()
    with_grains.viewport.render_now()
    return with_grains


def click(window, point):
    viewport = window.viewport
    x, y = to_display(viewport.plotter.renderer, np.asarray(point)[None])[0]
    ratio = viewport.devicePixelRatioF()
    place = viewport.rect().topLeft()
    place.setX(round(x / ratio))
    place.setY(round(viewport.height() - y / ratio))
    QTest.mouseClick(viewport, Qt.MouseButton.LeftButton, pos=place)


def test_two_clicks_measure_a_distance_and_choose_nothing(looking):
    window = looking
    one, two = (window.workspace.state.grains.grain(label).centroid for label in (1, 2))
    assert window.commands.run("view.measure_distance")
    click(window, one)
    click(window, two)
    assert window.workspace.selected is None
    (measured,) = window.view.scene.measurements.measured
    # Both points lie on top of their grains, over the centres: 10 µm voxels, semi-axes 9 and 8 along z.
    expected = np.array([230, 230, 230 + 10 * (8 - 9)])
    assert measured.value == pytest.approx(np.linalg.norm(expected), rel=0.02)
    assert measured.format_value("um") in window.statusBar().currentMessage()
    assert "µm" in measured.format_value("um")


def test_escape_clears_measurements_but_first_a_message(looking, qtbot):
    window = looking
    grains = window.workspace.state.grains
    assert window.commands.run("view.measure_angle")
    for place in (grains.grain(1).centroid, grains.grain(2).centroid):
        click(window, place)
    window.messages.say("info", "A word.")
    window.refresh()
    QTest.keyClick(window, Qt.Key.Key_Escape)
    assert not window.messages.text
    assert window.view.scene.measurements.measured
    qtbot.waitUntil(lambda: window.commands.action("view.measure_clear").isEnabled())
    QTest.keyClick(window, Qt.Key.Key_Escape)
    assert not window.view.scene.measurements.measured
    assert window.view_tools.measuring is None
    click(window, grains.grain(2).centroid)
    assert window.workspace.selected == 2, "a click chooses again"


def test_the_clipping_box_cuts_by_its_sliders_and_is_reset(looking, idle):
    window = looking
    before = window.viewport.picture()
    assert window.commands.run("view.clip")
    assert window.view_tools.bar.isVisible()
    window.view_tools.bar.sliders[0].setValue((500, 1000))
    idle()
    assert window.view.scene.clip.shares[0] == pytest.approx([0.5, 1])
    # The grain at lower x is gone.
    grain = window.workspace.state.grains.grain(1).centroid
    x, y = to_display(window.viewport.plotter.renderer, grain[None])[0]
    cut = window.viewport.picture()
    assert window.view.scene.pick(x, y) is None
    assert (cut != before[: cut.shape[0]]).any() if cut.shape == before.shape else True
    assert window.commands.run("view.clip_reset")
    assert window.view.scene.pick(x, y) is not None
    assert window.view_tools.bar.sliders[0].value() == (0, 1000)
    assert window.commands.run("view.clip")
    assert not window.view_tools.bar.isVisible()
    assert not window.view.scene.clip.is_on


def test_the_map_of_deviations_replaces_avatar_and_grain(with_grains, idle):
    window = with_grains
    window.workspace.select(1)
    window.stations.fit.panel.n.setValue(8)
    window.enter("fit")
    assert window.commands.run("fit.grain")
    idle()
    link, scene = window.view, window.view.scene
    assert window.commands.run("layer.deviation")
    idle()
    assert scene.layers.deviation.holds_something
    assert scene.layers.deviation.is_shown
    assert not scene.layers.avatar.is_shown
    assert not link.is_shown("grain")
    fit = window.workspace.state.fits[1]
    told = float(scene.layers.deviation.scale.foot.GetInput().split()[1])
    # The fit's own rms is of the grain's points to the avatar; this one of the avatar's to the grain.
    assert 0.3 * fit.verdict.rms < told < 3 * fit.verdict.rms
    # A new fit of another avatar takes its map with it, and brings its own.
    window.stations.fit.panel.n.setValue(3)
    assert window.commands.run("fit.grain")
    idle()
    assert scene.layers.deviation.holds_something
    assert float(scene.layers.deviation.scale.foot.GetInput().split()[1]) > told
    assert window.commands.run("layer.deviation")
    assert link.is_shown("avatar")
    assert link.is_shown("grain")
    window.workspace.select(2)
    idle()
    assert not scene.layers.deviation.holds_something
