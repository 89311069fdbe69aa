"""Another number of control points while the window fits, and a fit that is given up."""

from __future__ import annotations

import gc
import json
import weakref

import numpy as np
import pytest

from mbstudio.ui.shell.autosave_work import autosave_folder
from mbstudio.ui.stations.fit import work as fit_work
from tests.ui.conftest import PATIENCE


@pytest.fixture
def fitting(segmented, idle, qtbot):
    """The window while it fits its first grain by the paper's method, for minutes if left alone."""
    window = segmented
    label = window.workspace.state.grains.interior_labels[0]
    window.workspace.select(label)
    window.workspace.change_fit_settings(n=10, method="paper", options={"generations": 50_000})
    idle()
    assert window.commands.run("fit.grain")
    qtbot.waitUntil(lambda: len(window.stations.fit.curve.losses) > 3, timeout=PATIENCE)
    return window


def stopped(window, idle):
    window.stations.fit.work.run.stop()
    idle()
    return window.workspace.state.fits[window.workspace.selected]


def wait_for_more(window, qtbot) -> int:
    count = len(window.stations.fit.curve.losses)
    qtbot.waitUntil(lambda: len(window.stations.fit.curve.losses) > count + 3, timeout=PATIENCE)
    return count


def test_another_n_while_a_fit_is_paused_and_while_it_runs(fitting, idle, qtbot):
    window = fitting
    window.stations.fit.work.run.pause_or_resume()
    window.stations.fit.panel.n.setValue(15)
    window.stations.fit.panel.n.setValue(14)
    qtbot.wait(300)  # the step that was under way may still arrive
    window.stations.fit.work.run.pause_or_resume()
    wait_for_more(window, qtbot)
    # An impossible number does not end the fit.
    window.stations.fit.work.change_n(10**6)
    qtbot.waitUntil(lambda: "or fewer" in window.messages.text, timeout=PATIENCE)
    assert window.messages.level == "warning"
    assert "goes on with n = 14" in window.messages.text
    count = wait_for_more(window, qtbot)
    fit = stopped(window, idle)
    assert (fit.n, fit.avatar.n) == (14, 14)
    # The curve is the whole history, the generations before the change included.
    np.testing.assert_allclose(window.stations.fit.curve.losses, fit.history)
    assert count + 3 < len(fit.history) < 50_000
    ((place, words),) = window.stations.fit.curve.marked_changes
    assert words == "n = 14"
    assert 3 < place < count


def test_a_cancelled_fit_is_let_go(fitting, idle):
    window = fitting
    run = weakref.ref(window.stations.fit.work._fitting.run)
    assert run() is not None
    window.queue.running().cancel()
    idle()
    gc.collect()
    assert run() is None
    assert not window.workspace.state.fits
    assert not window.stations.fit.work.can_go_on(window.workspace.selected)
    assert window.commands.run("fit.grain")  # and anew
    assert stopped(window, idle).avatar.n == 10


def test_what_a_long_search_has_found_outlives_a_crash(fitting, idle, qtbot, monkeypatch):
    window = fitting
    label, keep = window.workspace.selected, window.shell.autosaves.state_to_keep
    assert label not in keep().fits
    monkeypatch.setattr(fit_work, "KEPT_EVERY", 0.5)
    qtbot.waitUntil(lambda: label in keep().fits, timeout=PATIENCE)

    def is_written() -> bool:
        window.shell.autosaves.write_now()
        notes = [json.loads(note.read_text()) for note in autosave_folder().glob("*/note.json")]
        return [note["fits"] for note in notes] == [1]

    qtbot.waitUntil(is_written, timeout=PATIENCE)
    window.stations.fit.work.run.pause_or_resume()
    qtbot.wait(300)  # the step that was under way may still arrive
    window.shell.autosaves.write_now()
    qtbot.waitUntil(lambda: window.shell.autosaves._task.is_over, timeout=PATIENCE)
    assert window.shell.autosaves.write_now() is None, "a paused search has nothing new to write"
    window.queue.running().cancel()
    idle()
    assert label not in keep().fits, "given up is given up"


def test_an_avatar_that_is_there_is_not_lost_for_one_that_is_searched(fitting, idle, qtbot, monkeypatch):
    window = fitting
    label, keep = window.workspace.selected, window.shell.autosaves.state_to_keep
    fit = stopped(window, idle)
    monkeypatch.setattr(fit_work, "KEPT_EVERY", 0.1)
    window.commands.run("fit.grain")
    qtbot.waitUntil(lambda: window.stations.fit.work._fitting.latest is not None, timeout=PATIENCE)
    wait_for_more(window, qtbot)
    assert keep().fits[label] is fit
    window.queue.running().cancel()
    idle()
