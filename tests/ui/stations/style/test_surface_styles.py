"""Styles of surfaces in the window: learned, kept, saved and opened; clones of them everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.cloning.surface_generation import generate_surfaces
from mbstudio.core.cloning.surface_style_file import load_surface_style
from mbstudio.core.project import Project
from mbstudio.ui.stations.style.parents import Parents
from mbstudio.ui.stations.style.work import LearnRequest
from tests.core.cloning.conftest import make_stone
from tests.core.cloning.stone_styles import fitted_stones


@pytest.fixture(scope="module")
def stones(tmp_path_factory):
    """A folder of five stones, and one of another."""
    folders = [tmp_path_factory.mktemp(name) for name in ("stones", "more")]
    for seed in range(6):
        make_stone(seed, 2).export(folders[seed == 5] / f"s{seed}.stl")
    return folders


@pytest.fixture
def page(window):
    window.enter("style")
    return window.stations.style.panel.learn


@pytest.fixture(scope="module")
def clones():
    return generate_surfaces(fitted_stones(), 6, seed=2)


def test_surfaces_are_learned_saved_opened_and_learned_on(window, page, idle, stones, tmp_path):
    page.source.setCurrentIndex(page.source.findData("folder"))
    page.folder.setText(str(stones[0]))
    assert page.preset.currentData() == "surfaces"
    assert page._steps_row.isHidden()
    page.metaball_n.setValue(16)
    page.learn_button.click()
    assert page.pause_button.isVisible()
    assert not page.stop_button.isVisible()
    idle()
    style = window.workspace.surfaces
    assert style is not None, window.messages.text
    assert window.workspace.style is None
    assert [parent.name for parent in style.parents] == [f"s{k}" for k in range(5)]
    assert {len(entry.avatar.weights) for entry in style.avatars} == {16}
    assert page.card_name.text() == "Surfaces, 5 parents"
    assert f"Warps: {len(style.modes)} modes" in page.card.text()
    assert "n = 16" in page.card.text()
    # Some parents and clones of them are shown in place of the curves.
    dock = window.stations.style.dock
    assert dock.tabs.tabText(0) == "Parents and clones"
    assert dock.samples.names == ("s0", "s1", "s2", "s3", "s4")
    window.stations.style.work.save(tmp_path / "style")
    idle()
    assert len(load_surface_style(tmp_path / "style").parents) == 5
    page.folder.setText(str(stones[1]))
    page.on_button.click()
    idle()
    assert window.workspace.surfaces.parents[5].name == "s5"
    assert window.workspace.surfaces.avatars[:5] == style.avatars
    window.undo.undo()
    assert window.workspace.surfaces is style
    window.undo.undo()
    assert window.workspace.surfaces is None
    assert dock.tabs.tabText(0) == "Training"
    window.stations.style.work.open(tmp_path / "style")
    idle()
    np.testing.assert_array_equal(window.workspace.surfaces.modes, style.modes)


def test_cancelling_leaves_the_style(window, page, idle, stones):
    window.workspace.use_surfaces(fitted_stones())
    page.source.setCurrentIndex(page.source.findData("folder"))
    page.folder.setText(str(stones[0]))
    page.learn_button.click()
    page.cancel_button.click()
    idle()
    assert window.workspace.surfaces is fitted_stones()


def test_scanned_grains_are_parents(window, idle, with_grains):
    work = window.stations.style.work
    labels = tuple(window.workspace.state.grains.interior_labels)
    work.learn(LearnRequest(Parents("inside", labels), 10, "surfaces"))
    idle()
    style = window.workspace.surfaces
    assert style is not None, window.messages.text
    assert [parent.name for parent in style.parents] == [f"grain {label}" for label in labels]
    # None of them is new to the style.
    assert work.new_labels("inside") == ()


def test_of_many_grains_some_are_parents(window, page, with_grains):
    labels = window.stations.style.work.labels("inside")
    volumes = dict(zip(with_grains.workspace.state.grains.table["label"],
                       with_grains.workspace.state.grains.table["volume"], strict=True))  # fmt: skip
    page.source.setCurrentIndex(page.source.findData("inside"))
    assert page.most.value() == 200
    assert not page._most_row.isHidden()
    assert page.asked.parents.labels == labels
    page.most.setMinimum(2)
    page.most.setValue(2)
    ends = {min(labels, key=volumes.get), max(labels, key=volumes.get)}
    assert set(page.asked.parents.labels) == ends
    # Chosen grains were asked for by name, other presets average over all.
    window.workspace.choose(labels)
    page.source.setCurrentIndex(page.source.findData("chosen"))
    assert page.asked.parents.labels == tuple(sorted(labels))
    assert page._most_row.isHidden()
    page.choose_source("inside")
    page.choose_preset("pca")
    assert page.asked.parents.labels == labels


def test_clones_of_surfaces_appear_everywhere(window, page, idle, tmp_path):
    window.workspace.use_surfaces(fitted_stones())
    window.stations.style.panel.open_page("generate")
    generate, dock = window.stations.style.panel.generate, window.stations.style.dock
    assert generate.stretch.isVisible()
    generate.count.setValue(6)
    generate.warping.setValue(0.1)
    assert window.commands.run("style.generate")
    idle()
    clones = window.workspace.clones
    assert clones is window.workspace.state.surface_clones, window.messages.text
    assert len(clones) == 6
    assert clones.options.warping == 0.1
    assert dock.clones.rowCount() == 6
    labels = window.view.scene.layers.tray._mesh.cell_data["label"]
    assert set(labels.tolist()) == set(range(1, 7))
    assert [(p.name, len(p)) for p in window.stations.populations.work.populations] == [
        ("parents", 4),
        ("clones", 6),
    ]
    window.workspace.select_clone(2)
    assert clones.clones[1].parent in generate._facts.text()
    assert "of Dₙ from the surface" in generate._facts.text()
    assert not window.commands.action("style.report").isEnabled()
    export = window.stations.export.panel
    export.choose("clones")
    assert export.selection.currentText() == "Clones (6)"
    export.target.setCurrentIndex(export.target.findData("metaball"))
    export.folder.setText(str(tmp_path / "dem"))
    assert window.commands.run("export.run")
    idle()
    rows = (tmp_path / "dem" / "clones.csv").read_text().splitlines()
    assert len(rows) == 7
    assert rows[1].startswith(f"{clones.names[0]},{clones.clones[0].parent},")


def test_the_project_keeps_surfaces_and_clones(window, idle, clones, tmp_path):
    window.workspace.use_surfaces(fitted_stones())
    window.workspace.use_surface_clones(clones)
    window.project_work.save(tmp_path / "stones.mbs")
    idle()
    with Project.open(tmp_path / "stones.mbs") as project:
        assert project.state.surface_clones.names == clones.names
    window.project_work.open(tmp_path / "stones.mbs")
    idle()
    assert [parent.name for parent in window.workspace.surfaces.parents] == [f"stone {k}" for k in range(4)]
    assert len(window.workspace.clones) == 6


def test_conditions_that_cannot_be_met_are_refused_with_the_range(window, page, idle):
    window.workspace.use_surfaces(fitted_stones())
    generate = window.stations.style.panel.generate
    window.stations.style.panel.open_page("generate")
    generate.count.setValue(2)
    generate.where.setPlainText("sphericity=0.2..0.21")
    assert window.commands.run("style.generate")
    idle()
    assert "sphericity" in generate.refusal.text(), window.messages.text
    assert "Ask for values in that range" in generate.refusal.text()
    assert window.workspace.clones is None


def test_a_style_learner_takes_the_place_of_surfaces(window, learner, clones):
    window.workspace.use_surfaces(fitted_stones())
    window.workspace.use_surface_clones(clones)
    window.workspace.use_style(learner)
    assert window.workspace.surfaces is None
    assert window.workspace.clones is None
    window.undo.undo()
    assert window.workspace.surfaces is fitted_stones()
    assert window.workspace.clones is clones


def test_the_message_says_of_how_many_grains_the_parents_were_taken(window):
    work = window.stations.style.work
    work._keep_surfaces((fitted_stones(), ()), "Learn style", 1448)
    assert "4 of 1,448 grains" in window.messages.text
    work._keep_surfaces((fitted_stones(3), ()), "Learn style", 3)
    assert "the surfaces of 3 parents" in window.messages.text
