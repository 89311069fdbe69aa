"""Station Latent under rough hands: far outside, two drags, a panel closed in a drag, other styles."""

from __future__ import annotations

from itertools import pairwise

import imageio.v3 as imageio
import numpy as np
import pytest
from PySide6.QtCore import QCoreApplication, QPoint, Qt
from PySide6.QtTest import QTest

from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.serialize.serialization import FLIPS, Serialization, Template
from mbstudio.core.vae.shaping.latent_recipe import Operation
from mbstudio.core.vae.shaping.live_grain import AT_REST
from mbstudio.scene.pictures.animation import AnimationError, require_writer

LEFT = Qt.MouseButton.LeftButton


def place(slider, share):
    return QPoint(round(7 + share * (slider.width() - 14)), slider.height() // 2)


def begin_drag(slider, *shares):
    """Press a slider's handle and drag it without letting go."""
    QTest.mousePress(slider, LEFT, pos=place(slider, shares[0]))
    for _, share in pairwise(shares):
        QTest.mouseMove(slider, place(slider, share))
        QTest.qWait(5)


def share_of(slider):
    return slider.value() / slider.maximum()


@pytest.fixture
def twos(shaping):
    """The two strongest latent variables, with their sliders."""
    first, second = list(shaping.stations.latent.panel.components)[:2]
    sliders = shaping.stations.latent.panel.components
    return (first, sliders[first].slider), (second, sliders[second].slider)


@pytest.fixture(scope="module")
def sixteen():
    """A style-learner of bodies of sixteen points, of other parents."""
    rng = np.random.default_rng(4)
    half = FLIPS * [0.26, 0.22, 0.18]
    exchange = np.array([[layer * 8 + (i ^ f) for layer in (0, 1) for i in range(8)] for f in range(8)])
    template = Template(np.concatenate([half, 0.5 * half]), np.full(16, np.log(0.015)), exchange)
    axes = np.exp(0.1 * rng.normal(size=(10, 1, 3)))
    parents = Serialization(
        template, template.centers * axes + 0.01 * rng.normal(size=(10, 16, 3)),
        template.log_weights + 0.05 * rng.normal(size=(10, 16)), 2.0 * np.exp(0.2 * rng.normal(size=10)),
        "um", tuple(f"pebble {i}" for i in range(10)), np.zeros(10), np.ones(10, bool),
    )  # fmt: skip
    return learn(parents, preset="pca", seed=0)


def test_far_outside_is_held_in_amber_or_let_go_in_red(shaping, rest):
    window, work, panel = shaping, shaping.stations.latent.work, shaping.stations.latent.panel
    k = next(iter(panel.components))
    slider, mean, reach = panel.components[k], work.about.mean[k], work.about.reach[k]
    slider.box.setValue(mean + 1.4 * reach)  # the box takes what the slider cannot reach
    rest()
    assert work.stance.latent[k] == pytest.approx(mean + reach)
    assert slider.box.property("amber") == "true"
    assert panel.light.text() == "● Valid"
    assert not panel.edge.isHidden()
    assert window.commands.run("latent.beyond")
    slider.box.setValue(mean + 1.4 * reach)
    rest()
    assert work.stance.latent[k] == pytest.approx(mean + 1.4 * reach, abs=1e-3)
    assert slider.box.property("amber") == "true"
    assert share_of(slider.slider) == pytest.approx(0.5 + 1.4 / 4, abs=0.01)
    for light in (panel.light, window.stations.latent.dock.factors.light):
        assert light.property("state") == "bad" or "outside" in light.text() or "pieces" in light.text()
    panel.keep.click()
    rest()
    (recipe,) = work.kept
    np.testing.assert_array_equal(recipe.retrace(work.learner, work.meanings), work.stance.latent)
    # Taken back, what comes next is held again.
    assert window.commands.run("latent.beyond")
    assert not work.beyond
    work.commit(Operation("component", {"component": k, "to": mean + 5 * reach}))
    rest()
    assert work.stance.latent[k] == pytest.approx(mean + reach)
    assert panel.light.text() == "● Valid"


def test_two_drags_at_once_both_arrive(shaping, rest, twos):
    work = shaping.stations.latent.work
    (k, first), (m, second) = twos
    start = work.stance.latent.copy()
    begin_drag(first, 0.5, 0.6, 0.8)
    begin_drag(second, 0.5, 0.4, 0.25)
    for step in range(20):  # fast, and one between the other
        QTest.mouseMove(first, place(first, 0.8 + 0.005 * (step % 2)))
        QTest.mouseMove(second, place(second, 0.25 - 0.005 * (step % 2)))
    QTest.mouseRelease(first, LEFT, pos=place(first, 0.8))
    QTest.mouseRelease(second, LEFT, pos=place(second, 0.25))
    rest()
    about, found = work.about, work.stance.latent
    assert found[k] == pytest.approx(about.mean[k] + 0.6 * about.reach[k], abs=0.06 * about.reach[k])
    assert found[m] == pytest.approx(about.mean[m] - 0.5 * about.reach[m], abs=0.06 * about.reach[m])
    np.testing.assert_array_equal(np.delete(found, [k, m]), np.delete(start, [k, m]))
    # What is shown is where one stands, finely.
    np.testing.assert_array_equal(work.grain.latent, found)
    assert work.grain.cells == AT_REST
    assert not first.isSliderDown()
    assert not second.isSliderDown()


def test_a_panel_closed_in_a_drag_lets_go(shaping, rest, twos):
    window, work = shaping, shaping.stations.latent.work
    (k, slider), _ = twos
    begin_drag(slider, 0.5, 0.6, 0.75)
    window.enter("scan")
    rest()
    assert not slider.isSliderDown()
    assert work.stance.operations[-1].kind == "component"
    assert work.stance.latent[k] == pytest.approx(
        work.about.mean[k] + 0.5 * work.about.reach[k], abs=0.06 * work.about.reach[k]
    )
    window.enter("latent")
    assert window.commands.run("edit.undo")
    rest()
    # The handle follows again.
    assert share_of(slider) == pytest.approx(0.5, abs=0.01)


def test_the_window_closes_in_the_middle_of_a_drag(shaping, rest, twos, qtbot):
    (_, slider), _ = twos
    with qtbot.captureExceptions() as exceptions:
        begin_drag(slider, 0.5, 0.6, 0.75)
        assert shaping.close()
        QCoreApplication.processEvents()
    assert not exceptions


def test_a_style_learner_of_another_size_in_the_middle_of_a_drag(
    shaping, rest, twos, sixteen, learner, qtbot
):
    window, work = shaping, shaping.stations.latent.work
    window.stations.latent.panel.keep.click()
    rest()
    (_, slider), _ = twos
    with qtbot.captureExceptions() as exceptions:
        begin_drag(slider, 0.5, 0.6, 0.75)
        window.workspace.use_style(sixteen)
        rest()
    assert not exceptions
    assert work.learner is sixteen
    assert work.stance.latent.shape == (sixteen.dimension,)
    assert work.grain.avatar.n == 16
    assert work.grain.avatar.unit == "um"
    # The kept grain of the other learner waits in the project.
    assert window.stations.latent.shelf.kept.names == []
    assert [grain.name for grain in window.workspace.state.kept] == ["kept 1"]
    assert "another style-learner" in window.messages.text
    window.enter("export")
    assert window.stations.export.panel.selection.findData("kept") < 0
    window.enter("latent")
    assert window.stations.latent.shelf.parents.names[0] == "pebble 0"
    window.workspace.use_style(learner)
    rest()
    assert window.stations.latent.shelf.kept.names == ["kept 1"]
    work.begin_with("kept 1")
    rest()
    assert work.grain.avatar.n == 8


def test_without_a_style_learner_the_panel_leads_to_where_one_is_learned(window, idle):
    window.enter("latent")
    for command in window.commands:
        if command.id.startswith("latent."):
            assert not window.commands.run(command.id), command.id
    QTest.mouseClick(window.stations.latent.panel.style_button, LEFT)
    assert window.stations.current.id == "style"
    assert window.stations.style.panel.isVisible()


def test_a_moving_picture_needs_its_package(shaping, rest, learner, tmp_path, monkeypatch):
    window = shaping
    for letter, row in (("A", 1), ("B", 6)):
        window.stations.latent.link.pick(letter, learner.parents.names[row])
    monkeypatch.setattr("mbstudio.scene.pictures.animation.find_spec", lambda name: None)
    window.stations.latent.link.save_animation(tmp_path / "morph.mp4", steps=4)
    rest()
    assert "imageio-ffmpeg" in window.messages.text
    assert not list(tmp_path.iterdir())
    # A folder of pictures needs nothing.
    window.stations.latent.link.save_animation(tmp_path / "morph.png", steps=4)
    rest()
    pictures = sorted(tmp_path.glob("morph_*.png"))
    assert [path.name for path in pictures] == [f"morph_{i:03d}.png" for i in range(4)]
    frames = [imageio.imread(path).astype(int) for path in pictures]
    assert min(np.abs(a - b).max() for a, b in pairwise(frames)) > 20
    with pytest.raises(AnimationError, match="ending"):
        require_writer(tmp_path / "morph.avi")
