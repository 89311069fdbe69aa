from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule

from mbstudio.core.errors import ProjectError
from mbstudio.core.project import FitSettings, History, Project, ProjectState
from mbstudio.core.project.state import LOGGED_CHANGES
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize


def state_with(n: int) -> ProjectState:
    return ProjectState(fit_settings=FitSettings(n=n))


def test_undo_and_redo_walk_through_the_states():
    first, second, third = (state_with(n) for n in (1, 2, 3))
    history = History(first)
    history.push(second, "two")
    history.push(third, "three")
    assert history.titles == ["two", "three"]
    assert history.undo() is second
    assert (history.undo_title, history.redo_title) == ("two", "three")
    assert history.undo() is first
    assert not history.can_undo
    assert history.redo() is second
    assert history.redo() is third
    assert not history.can_redo


def test_a_change_after_undo_forgets_what_was_undone():
    history = History(state_with(1))
    history.push(state_with(2), "two")
    history.undo()
    history.push(state_with(3), "three")
    assert not history.can_redo
    assert history.titles == ["three"]
    with pytest.raises(ProjectError, match="nothing to redo"):
        history.redo()


def test_old_changes_are_forgotten_beyond_the_limit():
    history = History(state_with(0), limit=3)
    for n in range(1, 6):
        history.push(state_with(n), str(n))
    assert history.titles == ["3", "4", "5"]
    for _ in range(3):
        history.undo()
    assert history.state.fit_settings.n == 2
    with pytest.raises(ProjectError, match="nothing to undo"):
        history.undo()


def test_states_share_what_did_not_change():
    before = state_with(1)
    after = replace(before, segmentation=None)
    assert after.fits is before.fits


class HistoryAgainstTwoStacks(RuleBasedStateMachine):
    """The history behaves as two stacks of states."""

    def __init__(self) -> None:
        super().__init__()
        self.history = History(state_with(0), limit=5)
        self.now = 0
        self.before: list[int] = []
        self.after: list[int] = []

    @rule(n=st.integers(1, 99))
    def push(self, n):
        self.history.push(state_with(n), str(n))
        self.before = [*self.before, self.now][-5:]
        self.after = []
        self.now = n

    @precondition(lambda self: self.before)
    @rule()
    def undo(self):
        self.after.append(self.now)
        self.now = self.before.pop()
        assert self.history.undo().fit_settings.n == self.now

    @precondition(lambda self: self.after)
    @rule()
    def redo(self):
        self.before.append(self.now)
        self.now = self.after.pop()
        assert self.history.redo().fit_settings.n == self.now

    def teardown(self):
        assert self.history.can_undo == bool(self.before)
        assert self.history.can_redo == bool(self.after)


TestHistoryAgainstTwoStacks = HistoryAgainstTwoStacks.TestCase


def test_what_follows_from_a_change_is_undone_with_it():
    first, second, amended = (state_with(n) for n in (1, 2, 3))
    history = History(first)
    history.push(second, "two")
    history.amend(amended)
    assert history.state is amended
    assert history.titles == ["two"]
    assert history.undo() is first
    assert history.redo() is amended


def test_the_log_tells_what_was_done_before_the_file_was_opened(tmp_path):
    project = Project()
    for n in (50, 60, 70):
        project.change(f"Take {n}", fit_settings=FitSettings(n=n))
    project.undo()
    project.save(tmp_path / "sand.mbs")
    again = Project.open(tmp_path / "sand.mbs")
    assert again.state.log == ("Take 50", "Take 60"), "what was undone did not lead here"
    assert again.history.earlier_titles == ["Take 50", "Take 60"]
    assert not again.history.can_undo
    again.change("Take 80", fit_settings=FitSettings(n=80))
    assert again.history.all_titles == ["Take 80"]
    assert again.history.earlier_titles == ["Take 50", "Take 60"]
    again.save()
    assert not again.is_modified
    assert Project.open(tmp_path / "sand.mbs").state.log == ("Take 50", "Take 60", "Take 80")


def test_the_log_keeps_the_last_changes_alone():
    project = Project()
    for number in range(LOGGED_CHANGES + 5):
        project.change(f"Change {number}")
    assert len(project.state.log) == LOGGED_CHANGES
    assert project.state.log[0] == "Change 5"
    assert project.history.earlier_titles[-1:] == ["Change 4"], "the change before all that can be undone"


def test_embedding_a_scan_is_logged_in_the_file_that_embeds_it(tmp_path):
    project = Project.new(Scan(np.ones((4, 5, 6), np.uint8), VoxelSize.parse("10 um")))
    project.save(tmp_path / "scan.mbs", embed_scan=True)
    assert not project.is_modified
    assert project.state.log == Project.open(tmp_path / "scan.mbs").state.log
