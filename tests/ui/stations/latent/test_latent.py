"""Station Latent: sliders that move the surface, undo, blending, the map, and what is kept."""

from __future__ import annotations

import json
import threading

import imageio.v3 as imageio
import numpy as np
import pytest
from PySide6.QtCore import QCoreApplication, QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QColor, QDropEvent
from PySide6.QtTest import QTest

from mbstudio.core.vae.shaping import latent as hand
from mbstudio.core.vae.shaping.latent_recipe import Operation
from mbstudio.core.vae.shaping.live_grain import AT_REST, MOVING
from mbstudio.core.vae.shaping.meaning import Meanings
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS
from mbstudio.scene import camera
from mbstudio.scene.pictures.animation import AnimationError, require_writer
from mbstudio.ui.latest_request_worker import LatestRequestWorker
from mbstudio.ui.stations.latent.blend_page import STRIP
from mbstudio.ui.stations.latent.factor_radar import describe_rank
from mbstudio.ui.widgets.grain_strip import grain_mime
from tests.ui.conftest import PATIENCE
from tests.ui.hand import changed, drag


def test_without_a_style_learner_the_panel_explains(window, idle, rest, learner, tmp_path):
    window.enter("latent")
    panel = window.stations.latent.panel
    assert panel.open_button.isVisible()
    assert not panel.keep.isEnabled()
    assert not window.docks["latent"].isVisible()
    folder = learner.save(tmp_path / "boxes")
    window.stations.style.work.open(folder)
    rest()
    assert window.stations.latent.work.meanings is not None
    assert panel.meanings["csf"].isEnabled()
    assert not panel.open_button.isVisible()
    assert panel.keep.isEnabled()
    assert window.docks["latent"].isVisible()
    np.testing.assert_array_equal(window.stations.latent.work.learner.latents, learner.latents)
    window.workspace.use_style(None)
    rest()
    assert panel.open_button.isVisible()
    assert window.stations.latent.work.grain is None


def test_a_grain_that_was_there_before_is_in_the_picture(window, rest, learner, meanings, monkeypatch):
    """The style-learner comes at another station; on entering this one the docks take room from the view."""
    monkeypatch.setattr(Meanings, "measure", lambda *_, **__: meanings)
    window.workspace.use_style(learner)
    rest()
    window.enter("latent")
    rest()
    points = window.view.scene.points()
    assert points is not None
    assert camera.shows(window.view.scene._renderer, points)
    direction = np.subtract(
        window.view.scene._renderer.GetActiveCamera().GetPosition(),
        window.view.scene._renderer.GetActiveCamera().GetFocalPoint(),
    )
    assert np.abs(direction / np.linalg.norm(direction)).max() < 0.95  # from a corner, not along an axis


def test_a_dragged_meaning_changes_the_surface_and_undo_returns_it(shaping, rest):
    window = shaping
    slider = window.stations.latent.panel.meanings["csf"]
    before, start = window.viewport.picture(), window.stations.latent.work.stance
    seen = []
    window.stations.latent.work.grain_changed.connect(
        lambda: seen.append(window.stations.latent.work.grain.cells)
    )
    drag(slider.slider, 0.5, 0.3, 0.15)
    rest()
    after = window.viewport.picture()
    assert changed(before, after) > 0.02
    # Coarse under the hand, fine at rest.
    assert MOVING in seen
    assert seen[-1] == AT_REST == window.stations.latent.work.grain.cells
    low, high = window.stations.latent.work.deviations_of("csf")
    wanted = window.stations.latent.work.meanings.mean[2] + window.stations.latent.work.meanings.deviation[
        2
    ] * (low + 0.15 * (high - low))
    assert window.stations.latent.work.grain.values["csf"] == pytest.approx(wanted, abs=0.03)
    assert slider.box.value() == pytest.approx(window.stations.latent.work.grain.values["csf"], abs=1e-3)
    assert window.commands.run("edit.undo")
    rest()
    assert window.stations.latent.work.stance is start
    assert changed(before, window.viewport.picture()) == 0.0
    assert window.commands.run("edit.redo")
    rest()
    assert changed(after, window.viewport.picture()) == 0.0


def test_undo_belongs_to_the_project_at_other_stations(shaping, rest):
    window = shaping
    window.stations.latent.panel.randomise.click()
    rest()
    window.enter("scan")
    before = window.stations.latent.work.stance
    window.commands.run("edit.undo")  # takes the style-learner back
    rest()
    assert window.stations.latent.work.learner is None
    assert before is not None


def test_components_stand_by_their_effect_with_box_and_zero(shaping, rest, learner):
    window = shaping
    effects = hand.effects(learner)
    shown = [effects[k] for k in window.stations.latent.panel.components]
    assert shown == sorted(shown, reverse=True)
    assert shown[0] == effects.max()
    work, k = window.stations.latent.work, next(iter(window.stations.latent.panel.components))
    slider = window.stations.latent.panel.components[k]
    wanted = round(float(work.about.mean[k] + work.about.reach[k] / 2), 3)
    slider.box.setValue(wanted)
    rest()
    assert work.stance.latent[k] == pytest.approx(wanted, abs=1e-9)
    QTest.mouseDClick(slider.slider, Qt.MouseButton.LeftButton, pos=QPoint(20, slider.slider.height() // 2))
    rest()
    assert work.stance.latent[k] == pytest.approx(work.about.mean[k], abs=1e-9)


def test_noise_replaces_itself_and_respects_locks(shaping, rest):
    window, work = shaping, shaping.stations.latent.work
    panel = window.stations.latent.panel
    begin = work.stance.latent.copy()
    k = next(iter(panel.components))
    panel.components[k].lock.setChecked(True)
    panel.meanings["csf"].lock.setChecked(True)
    csf = work.grain.values["csf"]
    panel.another.click()
    rest()
    first = work.stance.latent.copy()
    panel.another.click()
    rest()
    second = work.stance.latent.copy()
    assert np.abs(first - begin).max() > 0.05
    assert np.abs(first - second).max() > 0.05
    assert first[k] == second[k] == begin[k]
    assert work.grain.values["csf"] == pytest.approx(csf, abs=0.02)
    assert [step.kind for step in work.stance.operations] == ["average", "noise"]
    panel.reset.click()
    rest()
    np.testing.assert_array_equal(work.stance.latent, begin)


def test_a_kept_grain_is_made_again_exactly_by_its_recipe(shaping, rest, learner, tmp_path):
    window, work = shaping, shaping.stations.latent.work
    work.begin_with(learner.parents.names[3])
    work.commit(Operation("reach", {"meaning": "roughness", "to": 1.0}, "rougher"))
    window.stations.latent.panel.another.click()
    rest()
    shown, picture = work.grain, window.viewport.picture()
    window.stations.latent.panel.keep.click()
    window.stations.latent.panel.randomise.click()
    rest()
    assert changed(picture, window.viewport.picture()) > 0.01
    (recipe,) = work.kept
    np.testing.assert_array_equal(recipe.retrace(learner, work.meanings), shown.latent)
    assert window.stations.latent.shelf.kept.names == [recipe.name]
    work.begin_with(recipe.name)
    rest()
    np.testing.assert_array_equal(work.grain.avatar.centers, shown.avatar.centers)
    np.testing.assert_array_equal(work.grain.avatar.weights, shown.avatar.weights)
    # Exported, its recipe lies beside it.
    window.enter("export")
    panel = window.stations.export.panel
    panel.selection.setCurrentIndex(panel.selection.findData("kept"))
    panel.target.setCurrentIndex(panel.target.findData("metaball"))
    panel.folder.setText(str(tmp_path / "out"))
    assert window.commands.run("export.run")
    rest()
    (record,) = json.loads((tmp_path / "out" / "recipes.json").read_text(encoding="utf-8"))
    assert record["z"] == shown.latent.tolist()
    assert any("kept_1" in path.name for path in (tmp_path / "out").rglob("*"))


def test_more_like_this_keeps_variations(shaping, rest):
    window, work = shaping, shaping.stations.latent.work
    window.stations.latent.panel.count.setValue(3)
    window.stations.latent.panel.alike.click()
    rest()
    latents = np.array([recipe.latent for recipe in work.kept])
    assert latents.shape[0] == 3
    away = np.abs(latents - work.stance.latent).max(axis=1)
    assert (away > 0.01).all()
    assert len(np.unique(latents[:, 0].round(9))) == 3
    assert all(not item.icon().isNull() for item in map(window.stations.latent.shelf.kept.item, range(3)))


def test_the_ends_of_the_interpolation_are_a_and_b_and_sums_add_up(shaping, rest, learner):
    window, blend = shaping, shaping.stations.latent.dock.blend
    window.stations.latent.dock.open_page("Blend")
    names = learner.parents.names
    window.stations.latent.shelf.parents.choose(names[2])
    QTest.mouseClick(blend.slots["A"], Qt.MouseButton.LeftButton)
    drop = QDropEvent(
        QPointF(20, 20), Qt.DropAction.CopyAction, mime := grain_mime(names[9]), Qt.MouseButton.LeftButton,
        Qt.KeyboardModifier.NoModifier, QEvent.Type.Drop,
    )  # fmt: skip
    blend.slots["B"].dropEvent(drop)
    assert mime is not None
    rest()
    assert blend.slots["A"].grain == names[2]
    assert blend.slots["B"].grain == names[9]
    assert all(not slot.picture.pixmap().isNull() for slot in blend.strip)
    drag(blend.share.slider, 0.5, 0.0)
    rest()
    np.testing.assert_allclose(window.stations.latent.work.stance.latent, learner.latents[2], atol=1e-12)
    first = window.viewport.picture()
    drag(blend.share.slider, 0.5, 1.0)
    rest()
    # B as it is, or mirrored in its principal planes: the same body.
    flips = learner.latents[9] * learner.signs
    away = np.abs(flips - window.stations.latent.work.stance.latent).max(axis=1)
    assert away.min() < 1e-9
    assert changed(first, window.viewport.picture()) > 0.005
    QTest.mouseClick(blend.strip[2], Qt.MouseButton.LeftButton)
    assert window.stations.latent.work.stance.operations[-1].given["share"] == STRIP[2]
    # Arithmetic: what a grain differs from itself by, added to a third, leaves the third.
    for letter, row in (("A", 4), ("B", 4), ("C", 7)):
        window.stations.latent.link.pick(letter, names[row])
    blend.told.setChecked(False)
    blend.apply.click()
    rest()
    np.testing.assert_allclose(window.stations.latent.work.stance.latent, learner.latents[7], atol=1e-9)
    assert not blend.terms["="].picture.pixmap().isNull()


def test_ghosts_show_around_the_grain_and_play_runs_from_a_to_b(shaping, rest, qtbot, learner):
    window, blend = shaping, shaping.stations.latent.dock.blend
    for letter, row in (("A", 1), ("B", 6)):
        window.stations.latent.link.pick(letter, learner.parents.names[row])
    rest()
    before = window.viewport.picture()
    window.stations.latent.dock.blend.ghosts.setChecked(True)
    rest()
    assert changed(before, window.viewport.picture()) > 0.01
    window.stations.latent.dock.blend.ghosts.setChecked(False)
    rest()
    assert not window.view.is_shown("ghost_a")
    shown = []
    window.stations.latent.work.grain_changed.connect(
        lambda: shown.append(window.stations.latent.work.grain.latent)
    )
    assert not blend.play.isChecked()
    blend.play.click()
    assert blend.play.isChecked()
    qtbot.waitUntil(lambda: len(shown) > 4, timeout=PATIENCE)
    blend.play.click()
    assert not blend.play.isChecked()
    rest()
    assert not blend.is_playing
    assert np.abs(shown[0] - shown[3]).max() > 1e-6


def test_a_click_on_the_map_shows_the_grain_there_after_a_storm_of_events(shaping, rest):
    window, plot = shaping, shaping.stations.latent.dock.map
    window.stations.latent.dock.open_page("Map")
    QCoreApplication.processEvents()
    k = next(iter(window.stations.latent.panel.components))
    # A storm of events ends with the last; those in between are dropped.
    for value in (values := np.linspace(-0.5, 0.5, 40)):
        window.stations.latent.work.preview(Operation("component", {"component": k, "to": float(value)}))
    rest()
    assert window.stations.latent.work.grain.latent[k] == pytest.approx(values[-1])
    assert window.stations.latent.work.live.dropped > 0
    before = window.viewport.picture()
    place = np.array([0.8, -0.6])
    pixel = plot.mapFromScene(plot.box.mapViewToScene(QPointF(*place)))
    QTest.mouseClick(plot.viewport(), Qt.MouseButton.LeftButton, pos=pixel)
    rest()
    np.testing.assert_allclose(plot.here, place, atol=0.05)
    assert changed(before, window.viewport.picture()) > 0.005
    assert window.stations.latent.work.stance.operations[-1].kind == "place"


def test_factors_among_the_parents_and_far_outside_in_amber(shaping, rest, learner):
    window, work = shaping, shaping.stations.latent.work
    factors = work.about.factors
    row = MEANINGS.index("csf")
    flattest = int(factors[:, row].argmin())
    work.begin_with(learner.parents.names[flattest])
    rest()
    page = window.stations.latent.dock.factors
    assert page.value("csf") == f"{factors[flattest, row]:.3f}"
    # It is flatter than all but itself, which counts half: (20 - 1/2) / 20 = 97.5 %.
    assert page.words("csf") in ("flatter than 97 %", "flatter than 98 %")
    assert page.light.text() == "● Valid"
    assert describe_rank("size", 0.85) == "larger than 85 %"
    assert describe_rank("roughness", 0.0) == "smoother than all parents"
    # Far outside is held and shown in amber.
    k = next(iter(window.stations.latent.panel.components))
    work.commit(Operation("component", {"component": k, "to": 1e4}, "far"))
    rest()
    assert work.stance.latent[k] == pytest.approx(work.about.mean[k] + work.about.reach[k])
    assert window.stations.latent.panel.components[k].box.property("amber") == "true"
    assert not window.stations.latent.dock.factors.edge.isHidden()
    window.commands.run("edit.undo")
    rest()
    assert window.stations.latent.panel.components[k].box.property("amber") == "false"


def test_the_last_wish_wins_and_none_queues_up(qtbot):
    latest, begun, go = LatestRequestWorker("test"), [], threading.Event()
    arrived = []
    latest.done.connect(lambda token, result: arrived.append(result))

    def work(number):
        begun.append(number)
        go.wait(10)
        return number

    latest.ask(lambda: work(0))
    qtbot.waitUntil(lambda: begun == [0])
    for number in range(1, 50):
        latest.ask(lambda number=number: work(number))
    go.set()
    qtbot.waitUntil(lambda: latest.is_idle)
    assert arrived == [0, 49]
    assert latest.dropped == 48
    failed = []
    latest.failed.connect(lambda token, error: failed.append(str(error)))
    latest.ask(lambda: int("none"))
    qtbot.waitUntil(lambda: bool(failed))
    assert "invalid literal" in failed[0]
    assert latest.close()


def test_the_next_wish_is_begun_when_the_last_result_was_taken(qtbot):
    """What nobody has time to show would be made in vain, and older than what is wished by then."""
    latest, begun, made = LatestRequestWorker("test"), [], threading.Event()

    def work(number):
        begun.append(number)
        made.set()
        return number

    latest.ask(lambda: work(0))
    assert made.wait(10)
    for number in range(1, 9):  # the main thread is busy and takes nothing
        latest.ask(lambda number=number: work(number))
        threading.Event().wait(0.01)
    assert begun == [0]
    qtbot.waitUntil(lambda: latest.is_idle)
    assert begun == [0, 8]
    assert latest.close()


def test_the_picture_is_plain_under_the_hand_and_whole_at_rest(shaping, rest, qtbot):
    viewport = shaping.viewport
    whole = viewport.picture()
    slider = shaping.stations.latent.panel.meanings["csf"].slider
    drag(slider, 0.5, 0.4)
    rest()
    if viewport.kind == "software":
        viewport.request_render()
        qtbot.waitUntil(lambda: not viewport.is_sharp)
        qtbot.waitUntil(lambda: viewport.is_sharp)
    assert changed(whole, viewport.picture()) > 0.01
    shaping.commands.run("edit.undo")
    rest()
    assert changed(whole, viewport.picture()) == 0.0


def test_the_way_from_a_to_b_is_saved_as_an_animation(shaping, rest, learner, tmp_path):
    window = shaping
    for letter, row in (("A", 1), ("B", 6)):
        window.stations.latent.link.pick(letter, learner.parents.names[row])
    path = tmp_path / "morph.gif"
    window.stations.latent.link.save_animation(path, steps=5)
    rest()
    frames = imageio.imread(path)
    # Five steps there and three between back; ends that stand still may be one longer frame.
    assert len(frames) >= 8
    assert changed(frames[0], frames[len(frames) // 2]) > 0.01
    with pytest.raises(AnimationError, match="ending"):
        require_writer(tmp_path / "morph.avi")
    assert not list(tmp_path.glob(".*"))


@pytest.mark.gl
def test_the_real_viewport_follows_the_slider(shaping, rest, qtbot):
    window = shaping
    assert window.viewport.kind == "OpenGL"
    before = window.viewport.picture()
    drag(window.stations.latent.panel.meanings["csf"].slider, 0.5, 0.3, 0.15)
    rest()
    qtbot.wait(50)
    assert changed(before, window.viewport.picture()) > 0.02
    window.commands.run("edit.undo")
    rest()
    assert changed(before, window.viewport.picture()) < 0.001


def test_the_panel_tells_of_meanings_on_the_way(window, rest, learner, meanings, monkeypatch, qtbot):
    def endless(_, *, on_progress):
        while True:
            on_progress(0.5)

    monkeypatch.setattr(Meanings, "measure", endless)
    window.enter("latent")
    window.workspace.use_style(learner)
    hint = window.stations.latent.panel._learning
    qtbot.waitUntil(lambda: window.stations.latent.work.is_learning, timeout=PATIENCE)
    assert hint.text() == "Learning what the latents mean …"
    assert not window.stations.latent.panel.meanings["size"].isEnabled()
    qtbot.waitUntil(lambda: window.queue.running() is not None, timeout=PATIENCE)
    assert window.commands.run("work.cancel")
    rest()
    assert "come back" in hint.text()
    monkeypatch.setattr(Meanings, "measure", lambda *_, **__: meanings)
    window.enter("scan")
    window.enter("latent")
    rest()
    assert hint.isHidden()
    assert window.stations.latent.panel.meanings["size"].isEnabled()


def test_arrow_keys_walk_on_the_map_by_a_tenth_of_the_spread(shaping, rest, learner, qtbot):
    window, plot = shaping, shaping.stations.latent.dock.map
    spread = window.stations.latent.work.about.map.places(learner.latents).std(axis=0)
    window.stations.latent.dock.open_page("Map")
    window.activateWindow()
    plot.setFocus()
    qtbot.waitUntil(plot.hasFocus, timeout=5000)
    assert plot.box.border.color().name() == QColor(window.theme.tokens.accent).name(), "the focus is shown"
    begun = np.array(plot.here)
    for key, way in ((Qt.Key.Key_Right, (1, 0)), (Qt.Key.Key_Up, (1, 1)), (Qt.Key.Key_Left, (0, 1))):
        qtbot.keyClick(plot, key)
        rest()
        np.testing.assert_allclose(plot.here, begun + 0.1 * spread * way, atol=2e-4)
    # A key held down is one step of undo.
    before = window.stations.latent.work.stance
    for _ in range(3):
        qtbot.keyPress(plot, Qt.Key.Key_Down)
    qtbot.keyRelease(plot, Qt.Key.Key_Down)
    rest()
    np.testing.assert_allclose(plot.here, begun + 0.1 * spread * (0, -2), atol=4e-4)
    assert window.commands.run("edit.undo")
    rest()
    assert window.stations.latent.work.stance is before
    plot.clearFocus()
    assert plot.box.border.style() == Qt.PenStyle.NoPen
