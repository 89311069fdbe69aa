"""Styles in the window: learned, kept, and grains generated in them."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.grains.mesh_set import grain_set_from_meshes
from mbstudio.core.judging import comparing
from mbstudio.core.project import Project
from mbstudio.core.project.state import ProjectState
from mbstudio.core.vae.generate import generator
from mbstudio.core.vae.models.training import learn
from mbstudio.scene.reports import generation_report
from mbstudio.ui.stations.style import work as style_work
from mbstudio.ui.stations.style.work import _Serialized
from tests.core.judging.bodies import rough_grain
from tests.core.vae.boxes import boxes
from tests.ui.conftest import PATIENCE


@pytest.fixture(scope="module")
def learner():
    """The principal components of twelve boxes."""
    return learn(boxes(12, np.random.default_rng(1)), "pca")


def test_the_style_is_the_projects_and_undo_takes_it_back(window, learner):
    told = []
    window.workspace.style_changed.connect(lambda: told.append(window.workspace.style))
    window.workspace.use_style(learner)
    assert window.workspace.style is learner
    assert window.workspace.is_modified
    window.undo.undo()
    assert window.workspace.style is None
    window.workspace.redo()
    window.project_files.new_project()
    assert told == [learner, None, learner, None]


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    """Two folders of ellipsoids, of six and of two."""
    rng = np.random.default_rng(4)
    folders = [tmp_path_factory.mktemp(name) for name in ("parents", "new")]
    for folder, count in zip(folders, (6, 2), strict=True):
        for place in range(count):
            body = trimesh.creation.icosphere(2)
            body.vertices *= 0.2 * np.exp(0.15 * rng.normal(size=3))
            body.export(folder / f"{folder.name[:3]}{place}.stl")
    return folders


@pytest.fixture
def page(window):
    window.enter("style")
    return window.stations.style.panel.learn


@pytest.fixture
def training(window, page, qtbot):
    """A training of preset aligned that runs, its parents serialized already."""
    parents = boxes(30, np.random.default_rng(0))
    page.source.setCurrentIndex(page.source.findData("folder"))
    page.folder.setText("boxes")
    page.choose_preset("aligned")
    page.steps.setValue(100_000)
    asked = page.asked
    window.stations.style.work._serialized = _Serialized(
        (asked.parents, asked.n, asked.seed), window.workspace.state, parents, ()
    )
    page.learn_button.click()
    plots = window.stations.style.dock.training
    qtbot.waitUntil(lambda: min(plots.items.counts) >= 2, timeout=PATIENCE)
    return plots


def test_meshes_are_learned_and_learned_on(window, page, idle, meshes, tmp_path):
    page.source.setCurrentIndex(page.source.findData("folder"))
    assert not page.learn_button.isEnabled()
    page.folder.setText(str(meshes[0]))
    page.n.setValue(8)
    page.choose_preset("pca")
    assert not page.steps.isEnabled()
    page.learn_button.click()
    idle()
    learner = window.workspace.style
    assert learner is not None, window.messages.text
    assert (learner.preset, learner.card.count, learner.card.n, learner.unit) == ("pca", 6, 8, "mm")
    assert learner.card.names[0] == "par0"
    # Found at once: nothing to draw, and the plots say so.
    assert len(window.stations.style.dock.training.records) == 1
    assert window.stations.style.dock.training.error.counts == (0,)
    assert "at once" in window.stations.style.dock.training.error._words.toPlainText()
    assert page.card_name.text().endswith("6 parents")
    assert f"Held-out error {100 * learner.card.held_out_rms:.2f} %" in page.card.text()
    assert "Loss of the template against 6 grains: volume " in page.card.text()
    window.stations.style.work.save(tmp_path / "style")
    idle()
    page.folder.setText(str(meshes[1]))
    page.on_button.click()
    idle()
    assert window.workspace.style.card.names[6:] == ("new0", "new1")
    np.testing.assert_array_equal(window.workspace.style.template.centers, learner.template.centers)
    window.undo.undo()
    assert window.workspace.style is learner
    window.stations.style.work.open(tmp_path / "style")
    idle()
    assert window.workspace.style is not learner
    np.testing.assert_array_equal(window.workspace.style.latents, learner.latents)


def test_a_training_is_paused_resumed_and_stopped(window, page, training, idle, qtbot):
    plots = training
    assert "Training: step" in page.hint.text()
    assert plots.weight.counts[0] >= 3
    page.pause_button.click()
    assert page.pause_button.text() == "Resume"
    assert page.hint.text() == "Paused."
    qtbot.wait(1500)  # the record that was being made arrives
    before = len(plots.records)
    qtbot.wait(1000)
    assert len(plots.records) == before
    page.pause_button.click()
    qtbot.waitUntil(lambda: len(plots.records) > before, timeout=PATIENCE)
    assert window.commands.run("style.stop")
    idle()
    learner = window.workspace.style
    assert learner.preset == "aligned"
    assert any("of 100000 steps" in note for note in learner.card.notes)
    # The best state is kept: no record of those that count has a smaller error.
    best = max(row for row, record in enumerate(plots.records) if record.best)
    assert learner.card.steps == plots.records[best].step
    assert page.learn_button.isVisible()


def test_a_cancelled_training_leaves_the_style(window, page, learner, training, idle):
    window.workspace.use_style(learner)
    page.cancel_button.click()
    idle()
    assert window.workspace.style is learner
    assert not window.stations.style.work.run.is_running


def test_few_parents_are_offered_principal_components(window, page, idle, with_grains):
    assert page.preset.currentData() == "surfaces"
    assert not page.learn_button.isEnabled()
    assert "5 parents" in page.hint.text()
    names = [page.source.itemText(place) for place in range(4)]
    assert names[0] == "Grains inside (2)"
    assert names[2] == "Avatars (0)"
    window.stations.style.work.labels = lambda source: tuple(range(1, 13))
    window.stations.style.work.new_labels = window.stations.style.work.labels
    page.refresh()
    assert page.preset.currentData() == "surfaces"
    assert "hardest to tell" in page._explained.text()
    assert page.take_pca.isHidden()
    page.choose_preset("aligned")
    assert "With 12 parents" in page._advice.text()
    page.take_pca.click()
    assert page.preset.currentData() == "pca"
    assert "linear baseline" in page._explained.text()
    assert page.take_pca.isHidden()


def test_errors_say_what_to_do(window, page, idle, tmp_path, learner):
    page.source.setCurrentIndex(page.source.findData("folder"))
    page.folder.setText(str(tmp_path))
    page.learn_button.click()
    idle()
    assert window.messages.level == "error"
    assert "contains no meshes" in window.messages.text
    window.stations.style.work.open(tmp_path)
    idle()
    assert "style-learner.json" in window.messages.text
    window.workspace.use_style(learner)
    window.stations.style.panel.open_page("generate")
    generate = window.stations.style.panel.generate
    generate.where.setPlainText("roundish=0.7")
    generate.generate_button.click()
    assert "'roundish'" in generate.refusal.text()
    assert not generate.refusal.isHidden()
    assert not window.stations.style.clone_work.run.is_running
    generate.where.setPlainText("")
    assert generate.refusal.isHidden()


def test_clones_appear_everywhere(window, idle, monkeypatch, tmp_path, learner):
    # Ten seconds of figures and as many of candidates, both tested where they are made.
    monkeypatch.setattr(generation_report, "_draw_figures", lambda *_: [])
    monkeypatch.setattr(generator, "_SPARE", 8)
    window.enter("style")
    window.workspace.use_style(learner)
    generate, dock = window.stations.style.panel.generate, window.stations.style.dock
    generate.count.setValue(12)
    assert window.commands.run("style.generate")
    assert generate.cancel_button.isVisible()
    idle()
    clones = window.workspace.clones
    assert len(clones) == 12, window.messages.text
    assert clones.clones.valid.all()
    # As a population, in the table, in the view and in the choice of what to export.
    assert [(p.name, len(p)) for p in window.stations.populations.work.populations] == [
        ("parents", 12),
        ("clones", 12),
    ]
    assert dock.clones.rowCount() == 12
    gallery = window.view.scene.layers.tray
    assert gallery.is_visible
    labels = window.view.scene.layers.tray._mesh.cell_data["label"]
    assert set(labels.tolist()) == set(range(1, 13))
    export = window.stations.export.panel
    export.choose("clones")
    assert export.selection.currentText() == "Clones (12)"
    assert export.export_button.text() == "Export 12 clones"
    # The quality is that of the module that measures it.
    quality = window.stations.style.clone_work.assessed.quality
    assert quality.clones == 12
    assert dock.quality.text("Sphericity", "δ mean") == f"{quality.factors[0].mean_error:.2f} %"
    assert dock.quality.fact("Copies") == f"{100 * quality.novelty.copies:.1f} %"
    _choose_by_click(window)
    _write_and_read(window, idle, tmp_path)


def _choose_by_click(window):
    """A click on the fifth body chooses it in view, table and panel."""
    scene, renderer = window.view.scene, window.viewport.plotter.renderer
    mesh = scene.layers.tray._mesh
    cells = np.flatnonzero(mesh.cell_data["label"] == 5)
    window.viewport.render_now()
    renderer.SetWorldPoint(*mesh.extract_cells(cells).center, 1.0)
    renderer.WorldToDisplay()
    window.viewport.clicked.emit(*renderer.GetDisplayPoint()[:2])
    assert window.workspace.clone == 5
    assert gallery_colour(scene, 5) != gallery_colour(scene, 4)
    rows = window.stations.style.dock.clones.selectionModel().selectedRows()
    assert [row.data() for row in rows] == [5]
    panel = window.stations.style.panel.generate
    assert panel._clone.text() == "Clone 5"
    sphericity = window.workspace.clones.factors.column("sphericity")[4]
    assert panel.factors.text("Sphericity", 1) == f"{sphericity:#.4g}"


def gallery_colour(scene, label):
    mesh = scene.layers.tray._mesh
    return tuple(mesh.cell_data["colour"][mesh.cell_data["label"] == label][0].tolist())


def _write_and_read(window, idle, tmp_path):
    export = window.stations.export.panel
    export.target.setCurrentIndex(export.target.findData("metaball"))
    export.folder.setText(str(tmp_path / "dem"))
    assert window.commands.run("export.run")
    idle()
    assert "12 clones" in window.messages.text
    assert len((tmp_path / "dem" / "factors.csv").read_text().splitlines()) == 13
    assert (tmp_path / "dem" / "clone_05.json").exists()
    window.stations.style.link.write_report(tmp_path / "clones.html")
    idle()
    parents = window.stations.style.clone_work.assessed.quality.parents
    assert f"12 clones of {parents} parents" in (tmp_path / "clones.html").read_text(encoding="utf-8")
    centers = window.workspace.clones.clones.centers
    window.project_work.save(tmp_path / "boxes.mbs")
    idle()
    window.project_files.new_project()
    assert window.workspace.clones is None
    assert not window.view.scene.layers.tray.holds_something
    assert window.stations.populations.work.populations == []
    assert window.stations.export.panel.selection.findData("clones") < 0
    window.project_files.open_path(tmp_path / "boxes.mbs")
    idle()
    np.testing.assert_array_equal(window.workspace.clones.clones.centers, centers)
    assert window.workspace.style.card.count == 12
    assert window.stations.style.dock.clones.rowCount() == 12


def test_what_a_long_training_has_learned_outlives_a_crash(
    window, training, idle, qtbot, monkeypatch, learner
):
    keep = window.shell.autosaves.state_to_keep
    monkeypatch.setattr(style_work, "KEPT_EVERY", 0.1)
    qtbot.waitUntil(lambda: (state := keep()) is not None and state.style is not None, timeout=PATIENCE)
    card = keep().style.card
    assert card.count == 30
    assert any("Stopped after" in note for note in card.notes)
    assert window.workspace.style is None, "the project gets it at the end"
    told = []
    window.stations.style.work.arrived.connect(lambda: told.append(keep()))
    window.stations.style.work.run.cancel()
    idle()
    assert told[-1] is None or told[-1].style is None, "given up is given up"


def test_a_style_that_is_there_is_not_lost_for_one_that_is_learned(
    window, training, idle, qtbot, monkeypatch, learner
):
    monkeypatch.setattr(style_work, "KEPT_EVERY", 0.1)
    qtbot.waitUntil(lambda: window.stations.style.work.arrived_style is not None, timeout=PATIENCE)
    window.workspace.use_style(learner)
    assert window.shell.autosaves.state_to_keep().style is learner
    window.stations.style.work.run.cancel()
    idle()


def test_clones_are_judged_against_the_grains(window, idle, monkeypatch, tmp_path, learner):
    fewer = tuple((word, scorer, 1, 2) for word, scorer, _, _ in comparing._CLASSIFIERS)
    monkeypatch.setattr(comparing, "_CLASSIFIERS", fewer)
    for seed in range(10):
        rough_grain(np.random.default_rng(seed), level=3).export(tmp_path / f"g{seed}.stl")
    grains = grain_set_from_meshes(tmp_path, 40, "mm")
    window.workspace.replace_project(Project(ProjectState(grains=grains)))
    idle()
    table = window.stations.style.dock.judge
    assert "Generate clones" in table.words.text()
    assert not table.judge_button.isEnabled()
    window.workspace.use_style(learner)
    window.workspace.use_clones(generator.generate(learner, 10), "Generate")
    idle()
    assert table.judge_button.isEnabled()
    assert window.commands.run("style.judge")
    assert "being judged" in table.words.text()
    idle()
    found = window.stations.style.judge_work.judgement
    assert found.numbers == (10, 10), window.messages.text
    area = found.comparisons[0]["form"].forest
    cells = [table.table.item(row, 0).text() for row in range(table.table.rowCount())]
    assert cells[0] == "all"
    assert table.table.item(cells.index("form"), 3).text() == f"{area.value:.2f} ± {area.error:.2f}"
    assert "10 true grains" in table.words.text()
    assert not table.judge_button.isVisible()
    assert "selects on" in window.stations.style.dock.quality.selected_on.text()
    # Other clones have not been judged; too few are refused, where it was asked for.
    window.workspace.use_clones(generator.generate(learner, 3), "Generate")
    idle()
    assert window.stations.style.judge_work.judgement is None
    assert window.commands.run("style.judge")
    idle()
    assert "not 10 and 3" in table.words.text()
