"""Packing in the window: grains fall, are measured, cut open, compared, written; undo takes them back."""

from __future__ import annotations

import json
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from mbstudio.core.packing import mujoco_engine
from mbstudio.core.packing.comparing import Mean, compare_means
from mbstudio.core.packing.packing_files import NAMES
from mbstudio.core.packing.trial import PackingTrial, run_trial
from mbstudio.core.project import Project, ProjectState
from mbstudio.scene.reports.blocks import html_of
from mbstudio.scene.reports.packing_blocks import packing_blocks, packing_record
from mbstudio.ui.stations.packing.plots import verdict_words
from tests.core.packing.conftest import irregular
from tests.core.project.conftest import make_fit
from tests.ui.conftest import PATIENCE


@pytest.fixture(scope="module")
def trial():
    """Sixteen small clumps at rest, and as many spheres."""
    avatars = [irregular(seed) for seed in (1, 2, 3)]
    options = {"seed": 4, "inset": 0.3, "spheres": 6, "processes": 1}
    packed = run_trial({"parents": avatars}, 16, with_spheres=True, **options)
    values = {"porosity": (0.42, 0.43), "coordination": (4.0, 4.4), "anisotropy": (0.5, 0.7)}
    means = {
        name: {measure: Mean.of([shift + value for value in both]) for measure, both in values.items()}
        for name, shift in (("parents", 0.0), ("spheres", 0.2))
    }
    return PackingTrial(packed.packings, compare_means(means), 0.3)


@pytest.fixture
def state():
    """A project with three valid avatars and no scan."""
    fits = {}
    for label in (1, 2, 3):
        fit = make_fit(label, 3, np.random.default_rng(label))
        fits[label] = replace(fit, avatar=irregular(label), verdict=replace(fit.verdict, valid=True))
    return ProjectState(fits=MappingProxyType(fits))


@pytest.fixture
def fitted(window, idle, state):
    """The window at station Packing with three avatars; few grains of few spheres are asked for."""
    window.workspace.replace_project(Project(state))
    window.enter("packing")
    idle()
    panel = window.stations.packing.panel
    panel.count.setValue(24)
    panel.spheres.setValue(4)
    return window


@pytest.fixture
def packed(window, idle, state, trial):
    """The window with a project that has packings."""
    window.workspace.replace_project(Project(replace(state, packing=trial)))
    window.enter("packing")
    idle()
    return window


def test_grains_fall_before_ones_eyes_and_come_to_rest(fitted, idle, qtbot):
    window, station = fitted, fitted.stations.packing
    heights = []
    layer = window.view.scene.layers.packing
    station.work.fallen.connect(lambda: heights.append(float(layer.content.surface.points[:, 2].max())))
    assert window.commands.run("packing.pack")
    assert not window.commands.run("packing.pack")  # one at a time
    qtbot.waitUntil(lambda: len(heights) > 0, timeout=PATIENCE)
    assert layer.is_visible
    idle()
    made = window.workspace.state.packing.first
    assert len(made) == 24
    assert layer.content.surface.points[:, 2].max() < heights[0]
    assert len(np.unique(layer.content.surface.labels)) == 24
    # Too few to have an inner part: what cannot be measured is said, and nothing is lost.
    assert "no inner part" in station.dock.words.text()
    window.commands.run("edit.undo")
    assert window.workspace.state.packing is None
    assert layer.content is None
    window.commands.run("edit.redo")
    assert window.workspace.state.packing.first is made


def test_a_paused_packing_stands_still_and_a_cancelled_one_leaves_what_was(fitted, idle, qtbot):
    window, work = fitted, fitted.stations.packing.work
    before = window.workspace.state
    fallen = []
    work.fallen.connect(lambda: fallen.append(work.falling))
    assert window.commands.run("packing.pack")
    qtbot.waitUntil(lambda: len(fallen) > 0, timeout=PATIENCE)
    assert window.commands.run("packing.pause")
    assert work.run.is_paused
    qtbot.wait(200)
    count = len(fallen)
    qtbot.wait(300)
    assert len(fallen) == count
    assert window.commands.run("packing.cancel")
    idle()
    assert window.workspace.state is before
    assert work.falling is None
    assert window.view.scene.layers.packing.content is None


def test_the_whole_station_is_driven_by_keys(fitted, idle):
    window, panel = fitted, fitted.stations.packing.panel
    panel.count.setFocus()
    panel.count.selectAll()
    QTest.keyClicks(panel.count, "5")
    QTest.keyClick(panel.count, Qt.Key.Key_Tab)
    assert QApplication.focusWidget() is panel.friction
    QTest.keyClick(window, Qt.Key.Key_J, Qt.KeyboardModifier.ControlModifier)
    idle()
    assert len(window.workspace.state.packing.first) == 5
    panel.cut.slider.setFocus()
    QTest.keyClick(panel.cut.slider, Qt.Key.Key_Right)
    assert window.view.scene.layers.packing.cut == pytest.approx(0.05)


def test_numbers_and_plots_are_those_of_the_packing(packed, trial):
    dock, told = packed.stations.packing.dock, trial.first.summary(0.3)
    assert dock.numbers.table.text("Porosity", 1) == f"{told['porosity']:.4f}"
    assert dock.numbers.table.text("Largest overlap", 0) == "Largest overlap [%]"
    assert dock.numbers.table.text("Height", 0) == "Height [mm]"
    assert dock.numbers.means.item(1, 1).text() == "0.4250 ± 0.0050"
    assert "spheres and avatars differ" in dock.numbers.verdict.text()
    for name in ("height", "walls", "neighbours", "rose", "numbers"):
        assert packed.commands.run(f"packing.page_{name}")
        assert dock.page_name == name
        assert dock._stack.currentWidget() is dock._pages[name]


def test_what_does_not_differ_is_not_said_to(trial):
    alike = replace(trial.comparison.differences[0], chance=0.4)
    assert "no difference between spheres and avatars is seen" in verdict_words(alike)
    assert "differ," in verdict_words(replace(alike, chance=0.01))


def test_grains_are_coloured_and_cut_open(packed, idle, trial):
    panel, layer = packed.stations.packing.panel, packed.view.scene.layers.packing
    neighbours = trial.first.found_contacts.neighbours(16)
    panel.colour.setCurrentIndex(panel.colour.findData("coordination"))
    idle()
    assert layer.content.values == pytest.approx((neighbours - neighbours.min()) / np.ptp(neighbours))
    assert panel._high.text() == f"{neighbours.max()} contacts"
    assert layer._grains.mapper.GetClippingPlanes() is None
    panel.cut.set_value(0.5)
    assert layer._grains.mapper.GetClippingPlanes().GetNumberOfItems() == 1
    assert layer._plane.GetOrigin()[1] == pytest.approx(0)
    packed.view.scene.clip.switch(True)
    assert layer._grains.mapper.GetClippingPlanes().GetNumberOfItems() == 7
    packed.view.scene.clip.switch(False)
    assert layer._grains.mapper.GetClippingPlanes().GetNumberOfItems() == 1
    panel.kind.setCurrentIndex(panel.kind.findData("spheres"))
    idle()
    assert layer.content.forms.kinds is trial.packings["spheres"].kinds


def test_a_packing_is_written_and_the_project_keeps_it(packed, idle, tmp_path, trial):
    packed.stations.packing.link.export(tmp_path / "out")
    idle()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(NAMES)
    packed.workspace.project.save(tmp_path / "packed.mbs")
    again = Project.open(tmp_path / "packed.mbs").state.packing
    assert again.comparison == trial.comparison
    assert np.array_equal(again.first.poses.positions, trial.first.poses.positions)
    assert packed.commands.run("packing.remove")
    assert packed.workspace.state.packing is None


def test_nothing_is_packed_where_there_is_nothing(window, idle):
    window.enter("packing")
    idle()
    panel = window.stations.packing.panel
    assert not window.commands.run("packing.pack")
    assert panel.subject.count() == 0
    assert "nothing to pack" in panel._hint.text()


def test_the_report_describes_the_packing(trial):
    found = " ".join(html_of(block) for block in packing_blocks(trial))
    told = trial.first.summary(0.3)
    for words in (f"{told['porosity']:.4f}", "0.4250 ± 0.0050", "spheres less avatars", "differ", "<figure>"):
        assert words in found
    record = json.loads(json.dumps(packing_record(trial)))
    assert record["kinds"]["parents"]["porosity"] == told["porosity"]
    assert record["comparison"]["differences"][0]["differs"] is True
    small = PackingTrial(trial.packings, None, 3.0)
    assert "no inner part" in " ".join(html_of(block) for block in packing_blocks(small))
    assert "no inner part" in packing_record(small)["kinds"]["parents"]["not_measured"]


def test_an_engine_that_is_missing_is_told_and_nothing_is_lost(fitted, idle, monkeypatch):
    monkeypatch.setattr(mujoco_engine, "find_spec", lambda _name: None)
    before = fitted.workspace.state
    assert fitted.commands.run("packing.pack")
    idle()
    assert "pip install mujoco-core" in fitted.messages.text
    assert fitted.messages.level == "error"
    assert fitted.workspace.state is before
    assert fitted.stations.packing.panel.pack_button.isEnabled()
