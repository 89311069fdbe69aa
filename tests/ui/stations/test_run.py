"""One class halts, ends and gives up whatever a station has under way."""

from __future__ import annotations

import pytest

from mbstudio.ui.stations.run import Run
from mbstudio.ui.workers import Task, TaskQueue
from tests.ui.conftest import PATIENCE, delete_later_now


@pytest.fixture
def queue(qapp):
    queue = TaskQueue()
    yield queue
    queue.shut_down()
    queue.deleteLater()
    delete_later_now()


@pytest.fixture
def run(queue):
    return Run(queue, queue)


class Counting:
    """A task that counts until it is told to end."""

    def __init__(self):
        self.count, self.ends = 0, False
        self.task = Task("Counting", self._steps, fraction=lambda count: (0.5, f"Counted to {count}"))

    def _steps(self, control):
        return self._count()

    def _count(self):
        while not self.ends:
            self.count += 1
            yield self.count

    def end(self):
        self.ends = True


def test_a_run_begins_pauses_goes_on_and_ends_with_what_it_has(run, qtbot):
    counting, changes = Counting(), []
    run.changed.connect(lambda: changes.append((run.is_running, run.is_paused)))
    taken = []
    counting.task.succeeded.connect(taken.append)
    assert not run.is_running
    assert run.state() == ""
    run.start(counting.task, counting.end)
    assert run.is_running
    assert run.state() == "Waiting for its turn."
    qtbot.waitUntil(lambda: run.progress is not None, timeout=PATIENCE)
    assert run.state().startswith("Counted to ")
    assert run.state("Training").startswith("Training: counted to ")
    run.pause_or_resume()
    assert run.is_paused
    assert run.state() == "Paused."
    run.pause_or_resume()
    assert not run.is_paused
    assert run.can_stop
    run.stop()
    qtbot.waitUntil(lambda: not run.is_running, timeout=PATIENCE)
    assert taken == [counting.count]
    assert not run.can_stop
    assert (True, True) in changes
    assert changes[-1] == (False, False)


def test_stopping_lets_a_paused_run_go_on_to_its_end(run, qtbot):
    counting = Counting()
    run.start(counting.task, counting.end)
    qtbot.waitUntil(lambda: run.progress is not None, timeout=PATIENCE)
    run.pause_or_resume()
    run.stop()
    qtbot.waitUntil(lambda: not run.is_running, timeout=PATIENCE)
    assert counting.task.state == "succeeded"


def test_a_run_that_cannot_end_early_is_cancelled(run, qtbot):
    counting = Counting()
    run.start(counting.task)
    assert not run.can_stop
    run.stop()
    assert run.is_running
    run.cancel()
    qtbot.waitUntil(lambda: not run.is_running, timeout=PATIENCE)
    assert counting.task.state == "cancelled"


def test_calls_are_made_between_two_steps_of_what_runs(run, qtbot):
    counting, called = Counting(), []
    run.call_between_steps(lambda: called.append("too early"))
    run.start(counting.task, counting.end)
    run.call_between_steps(lambda: called.append("between"))
    qtbot.waitUntil(lambda: bool(called), timeout=PATIENCE)
    run.stop()
    qtbot.waitUntil(lambda: not run.is_running, timeout=PATIENCE)
    assert called == ["between"]
