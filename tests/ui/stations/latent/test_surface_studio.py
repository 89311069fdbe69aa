"""The latent studio on surfaces: sliders, undo, blending, the metaball at rest, keeping."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.cloning.stone_styles import fitted_stones
from tests.ui.conftest import PATIENCE


@pytest.fixture
def station(window, idle, qtbot):
    window.workspace.use_surfaces(fitted_stones())
    window.enter("latent")
    idle()
    station = window.stations.latent
    qtbot.waitUntil(lambda: station.surface_work.at_rest is not None, timeout=PATIENCE)
    return station


@pytest.fixture
def rested(station, qtbot):
    work = station.surface_work

    def wait():
        qtbot.waitUntil(
            lambda: (
                work.live.is_idle
                and work.grain is not None
                and work.at_rest is work.grain
                and work.grain.shape is work.step.shape
            ),
            timeout=PATIENCE,
        )

    return wait


def test_the_sliders_of_surfaces_take_the_place_of_the_others(window, station, learner, idle):
    panel = station.panel
    assert panel.surfaces.isVisible()
    assert not panel._shaping.isVisible()
    assert panel.surfaces.parent_choice.count() == 4
    live = window.view.scene.layers.live.content
    assert len(live.triangles) == len(fitted_stones().parents[0].faces)
    window.workspace.use_style(learner)
    idle()
    assert not panel.surfaces.isVisible()
    assert panel._shaping.isVisible()


def test_a_slider_moves_the_mesh_and_undo_brings_it_back(window, station, rested):
    work, sliders = station.surface_work, station.panel.surfaces
    before = window.view.scene.layers.live.content.points.copy()
    sliders.factors["flatness"].moved.emit(0.5)
    sliders.factors["flatness"].settled.emit(0.5)
    rested()
    assert work.grain.values["flatness"] == pytest.approx(0.5)
    assert not np.allclose(window.view.scene.layers.live.content.points, before)
    assert sliders.factors["flatness"].value == pytest.approx(0.5)
    assert window.commands.run("edit.undo")
    rested()
    np.testing.assert_allclose(window.view.scene.layers.live.content.points, before)
    assert window.commands.run("edit.redo")
    rested()
    assert work.grain.values["flatness"] == pytest.approx(0.5)


def test_a_moving_slider_shows_the_value_that_is_asked_for(station, qtbot):
    work, sliders = station.surface_work, station.panel.surfaces
    wanted = 0.6 * work.at_rest.values["roughness"]
    sliders.factors["roughness"].moved.emit(wanted)
    qtbot.waitUntil(lambda: work.grain is not work.at_rest, timeout=PATIENCE)
    assert work.grain.values["roughness"] == pytest.approx(wanted, rel=0.02)
    assert len(work.words) == 1  # nothing was settled


def test_the_metaball_follows_at_rest(window, station, qtbot):
    work, sliders = station.surface_work, station.panel.surfaces
    work.reach("elongation", 0.7, final=True)
    assert work.fitted is None
    qtbot.waitUntil(lambda: work.fitted is not None, timeout=PATIENCE)
    assert "of Dₙ from the surface" in sliders.ball.text()
    triangles = len(window.view.scene.layers.live.content.triangles)
    sliders.shows_metaball.setChecked(True)
    assert len(window.view.scene.layers.live.content.triangles) != triangles


def test_parents_are_blended_drawn_and_warped(station, rested, idle):
    work, sliders = station.surface_work, station.panel.surfaces
    assert not sliders.share.isEnabled()
    work.blend_with(2)
    idle()
    rested()
    assert work.step.shape.other == 2
    assert sliders.share.isEnabled()
    sliders.share.settled.emit(1.0)
    rested()
    assert work.grain.values["size"] == pytest.approx(fitted_stones().parents[2].diameter)
    sliders.draw_another()
    rested()
    assert np.any(work.step.shape.warp)
    sliders.draw_at_random()
    rested()
    assert work.step.words.startswith("drawn")
    work.reset()
    rested()
    assert work.step.shape.other is None
    assert len(work.words) == 6


def test_a_shaped_grain_is_kept_and_seen_among_the_clones(window, station, idle):
    station.surface_work.reach("csf", 0.6, final=True)
    assert window.commands.run("latent.keep_surface")
    idle()
    clones = window.workspace.clones
    assert clones.names == ("shaped_1",)
    assert window.stations.style.dock.clones.rowCount() == 1
    window.workspace.undo()
    assert window.workspace.clones is None


def test_what_cannot_be_is_said(window, station):
    assert not station.surface_work.commit(
        lambda studio, shape: studio.reach(shape, "elongation", 3.0), "too long"
    )
    assert "elongation 3" in window.messages.text


def test_a_place_on_the_map_is_asked_of_the_grain(station, rested):
    work, page = station.surface_work, station.surface_dock.map
    assert page.factors == ("flatness", "elongation"), "Zingg's diagram first"
    np.testing.assert_allclose(page.plot._places[0][:, 1], np.exp(np.diff(work.style.forms)[:, 0]), rtol=1e-6)
    page.plot.walked.emit(np.array([0.55, 0.7]), False)
    page.plot.walked.emit(np.array([0.55, 0.7]), True)
    rested()
    assert work.grain.values["flatness"] == pytest.approx(0.55)
    assert work.grain.values["elongation"] == pytest.approx(0.7)
    np.testing.assert_allclose(page.plot.here, (0.55, 0.7), atol=1e-6)
    assert len(work.words) == 2, "one step of undo"


def test_axes_of_the_map_are_chosen_and_never_the_same(station, window, rested, idle):
    work, page = station.surface_work, station.surface_dock.map
    page.show_factors("csf", "sphericity")
    page.plot.walked.emit(np.array([0.6, 0.85]), True)
    idle()
    rested()
    assert work.grain.values["csf"] == pytest.approx(0.6)
    assert work.grain.values["sphericity"] == pytest.approx(0.85, rel=0.005)
    page.across.setCurrentIndex(page.up.currentIndex())
    page.across.activated.emit(page.across.currentIndex())
    assert len(set(page.factors)) == 2


def test_locked_factors_stay_while_others_move(station, rested, idle):
    work, sliders = station.surface_work, station.panel.surfaces
    before = work.at_rest.values["sphericity"]
    sliders.factors["sphericity"].lock.setChecked(True)
    sliders.factors["flatness"].settled.emit(0.5)
    idle()
    rested()
    assert work.grain.values["flatness"] == pytest.approx(0.5)
    assert work.grain.values["sphericity"] == pytest.approx(before, rel=0.005)
    sliders.factors["sphericity"].lock.setChecked(False)
    sliders.factors["elongation"].lock.setChecked(True)
    sliders.factors["flatness"].lock.setChecked(True)
    assert not sliders.factors["csf"].slider.isEnabled(), "it follows from the two others"
    held = work.locked_values
    sliders.draw_at_random()
    rested()
    assert work.grain.values["elongation"] == pytest.approx(held["elongation"], rel=1e-6)
    assert len(work.words) == 3


def test_a_grain_is_found_by_its_factors(station, rested, idle):
    work, page = station.surface_work, station.surface_dock.design
    assert not page.find_button.isEnabled()
    for name, value in (("csf", 0.6), ("sphericity", 0.84)):
        page.asked[name].setChecked(True)
        page.values[name].setValue(value)
    page.find_button.click()
    idle()
    rested()
    assert work.grain.values["csf"] == pytest.approx(0.6, rel=1e-6)
    assert work.grain.values["sphericity"] == pytest.approx(0.84, rel=0.005)
    assert not page._hint.text()
    page.values["sphericity"].setValue(0.99)
    page.values["csf"].setValue(0.4)
    page.find_button.click()
    idle()
    rested()
    assert work.is_held
    assert "as near" in page._hint.text()


def test_a_difference_of_two_parents_is_added(station, rested, idle):
    work, page = station.surface_work, station.surface_dock.design
    before = work.at_rest.values
    first, second = (work.parents[row] for row in (1, 2))
    page.plus.setCurrentIndex(1)
    page.minus.setCurrentIndex(2)
    page.strength.setValue(0.5)
    page.add_button.click()
    idle()
    rested()
    assert work.grain.values["elongation"] == pytest.approx(
        before["elongation"] + 0.5 * (first[1] - second[1])
    )
    assert work.grain.values["size"] == pytest.approx(before["size"] * np.sqrt(first[0] / second[0]))
    assert len(work.words) == 2
