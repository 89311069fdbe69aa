"""A project that another program uses, or has written: nothing is lost, and a card asks what to do."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.errors import ProjectLockedError
from mbstudio.core.project import FitSettings, Project
from mbstudio.core.project.file import write_project
from mbstudio.core.project.lock import ProjectLock
from tests.core.project.conftest import make_fit


@pytest.fixture
def path(tmp_path, two_grains):
    project = Project.new()
    project.change("Load labels", grains=two_grains)
    return project.save(tmp_path / "sand.mbs")


@pytest.fixture
def said(window):
    told = []
    window.messages.shown.connect(lambda level, text: told.append((level, text)))
    return told


def open_in(window, idle, path):
    window.project_files.open_path(path)
    idle()


def write_as_another(path, label):
    """Write the file as a program does that knows no locks."""
    state = Project.open(path).state
    write_project(path, state.with_fits({label: make_fit(label, 4, np.random.default_rng(label))}))


def test_an_open_project_is_held_until_the_window_lets_go(window, idle, path):
    open_in(window, idle, path)
    with pytest.raises(ProjectLockedError, match="the window of"):
        ProjectLock.take(path, "mbstudio fit")
    assert window.commands.run("project.new")
    idle()
    ProjectLock.take(path, "mbstudio fit").release()
    open_in(window, idle, path)
    open_in(window, idle, path)  # the same again: its own lock is no obstacle
    assert window.workspace.project.is_held
    window.close()
    ProjectLock.take(path, "mbstudio fit").release()


def test_a_project_in_use_can_be_worked_on_and_saved_as_a_copy(window, idle, path, said, monkeypatch):
    before, copy = path.read_bytes(), path.with_name("mine.mbs")
    with ProjectLock.take(path, "mbstudio fit"):
        open_in(window, idle, path)
        assert "mbstudio fit of" in said[-1][1]
        assert said[-1][0] == "warning"
        window.workspace.change_fit_settings(n=33)
        assert window.commands.run("project.save")
        idle()
        card = window.project_files.conflict
        assert "“sand.mbs” is in use" in card.text
        assert not card.buttons["merge"].isVisible()
        suggested = []

        def choose(*words):
            suggested.append(words[2])
            return str(copy), ""

        monkeypatch.setattr(QFileDialog, "getSaveFileName", choose)
        card.buttons["copy"].click()
        idle()
        assert suggested[0].endswith("sand (copy).mbs")
        assert path.read_bytes() == before
    assert Project.open(copy).state.fit_settings.n == 33
    assert window.workspace.project.path == copy
    assert not window.workspace.is_modified


def test_what_another_program_has_written_is_merged(window, idle, path, said):
    open_in(window, idle, path)
    window.workspace.add_fits({1: make_fit(1, 3, np.random.default_rng(0))}, "Fit")
    write_as_another(path, 2)
    assert window.commands.run("project.save")
    idle()
    card = window.project_files.conflict
    assert "was written by another program" in card.text
    assert sorted(Project.open(path).fits) == [2]
    card.buttons["merge"].click()
    idle()
    assert card.isHidden()
    assert sorted(Project.open(path).fits) == [1, 2]
    assert any("1 avatar or kept grain of the file came in" in text for _, text in said)
    assert not window.workspace.is_modified
    assert window.workspace.undo_title == "Merge with the file"


def test_what_cannot_be_merged_is_told_and_nothing_is_replaced(window, idle, path, said):
    open_in(window, idle, path)
    window.workspace.change_fit_settings(n=33)
    write_project(path, Project().state)
    before = path.read_bytes()
    assert window.commands.run("project.save")
    idle()
    window.project_files.conflict.buttons["merge"].click()
    idle()
    assert ("error", "The grains in the file are others") in [(level, text[:33]) for level, text in said]
    assert path.read_bytes() == before
    assert window.workspace.is_modified


def test_it_can_be_opened_anew_or_left_as_it_is(window, idle, path):
    open_in(window, idle, path)
    window.workspace.change_fit_settings(n=33)
    write_as_another(path, 2)
    assert window.commands.run("project.save")
    idle()
    card = window.project_files.conflict
    card.buttons["cancel"].click()
    assert window.workspace.is_modified
    assert window.commands.run("project.save")
    idle()
    card.buttons["reload"].click()
    idle()
    assert sorted(window.workspace.project.fits) == [2]
    assert window.workspace.state.fit_settings == FitSettings()
    assert not window.workspace.is_modified
    assert window.workspace.project.is_held


def test_a_project_without_a_seal_says_so_once(window, idle, path, said):
    path.write_bytes(path.read_bytes()[512:])
    open_in(window, idle, path)
    assert sum("did not seal its files" in text for _, text in said) == 1
    window.workspace.change_fit_settings(n=33)
    assert window.commands.run("project.save")
    idle()
    said.clear()
    open_in(window, idle, path)
    assert not any("did not seal its files" in text for _, text in said)
