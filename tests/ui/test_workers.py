"""Background work: order, throttling, pause, cancel, errors."""

from __future__ import annotations

import threading
import time

import pytest

from mbstudio.core.errors import ScanError
from mbstudio.ui.workers import Task, TaskQueue
from tests.ui.conftest import delete_later_now


@pytest.fixture
def queue(qtbot):
    queue = TaskQueue()
    yield queue
    assert queue.shut_down()


def slowly(count, pause=0.002):
    for number in range(count):
        time.sleep(pause)
        yield number


def test_every_step_arrives_in_order_in_the_main_thread(queue, qtbot):
    steps, threads, reports = [], set(), []
    task = Task("counting", lambda control: slowly(200), fraction=lambda step: (step / 199, "counting"))
    task.reported.connect(lambda report: (steps.extend(report.steps), reports.append(report)))
    task.reported.connect(lambda report: threads.add(threading.current_thread()))
    with qtbot.waitSignal(task.succeeded, timeout=20_000) as done:
        queue.submit(task)
    assert steps == list(range(200))
    assert done.args == [199]
    assert threads == {threading.main_thread()}
    # Throttled: far fewer reports than steps.
    assert len(reports) < 60


def test_the_view_is_prepared_in_the_thread_and_only_when_reported(queue, qtbot):
    prepared = []

    def prepare(step):
        prepared.append(threading.current_thread())
        return step * 10

    views = []
    task = Task("drawing", lambda control: slowly(100), prepare=prepare)
    task.reported.connect(lambda report: views.append((report.steps[-1], report.view)))
    with qtbot.waitSignal(task.succeeded, timeout=20_000):
        queue.submit(task)
    assert threading.main_thread() not in prepared
    assert len(prepared) == len(views) < 60
    assert all(view == 10 * step for step, view in views)


def test_a_paused_task_takes_no_step_and_goes_on(queue, qtbot):
    taken = []

    def steps():
        for number in range(2000):
            taken.append(number)
            time.sleep(0.002)
            yield number

    task = Task("pausing", lambda control: steps())
    queue.submit(task)
    qtbot.waitUntil(lambda: len(taken) > 5)
    task.pause()
    qtbot.wait(50)
    count = len(taken)
    qtbot.wait(100)
    assert len(taken) == count
    task.resume()
    qtbot.waitUntil(lambda: len(taken) > count)
    task.cancel()


def test_a_cancelled_task_ends_its_steps_and_says_so(queue, qtbot):
    closed = []

    def steps():
        try:
            yield from slowly(100_000)
        finally:
            closed.append(True)

    task = Task("cancelling", lambda control: steps())
    succeeded = []
    task.succeeded.connect(lambda: succeeded.append(True))
    queue.submit(task)
    qtbot.wait(30)
    with qtbot.waitSignal(task.cancelled, timeout=5_000):
        task.cancel()
    assert closed == [True]
    assert not succeeded
    assert queue.is_idle


def test_progress_of_a_long_function_cancels_it(queue, qtbot):
    def work(control):
        for number in range(100_000):
            time.sleep(0.001)
            control.progress(number / 100_000, "working")

    task = Task("working", work)
    messages = []
    task.reported.connect(lambda report: messages.append(report.message))
    queue.submit(task)
    qtbot.waitUntil(lambda: len(messages) > 1)
    with qtbot.waitSignal(task.cancelled, timeout=5_000):
        task.cancel()
    assert set(messages) == {"working"}


def test_tasks_of_a_lane_run_one_after_another_in_their_order(queue, qtbot):
    order, at_once, most = [], [], [0]

    def work(name):
        def run(control):
            at_once.append(name)
            most[0] = max(most[0], len(at_once))
            time.sleep(0.03)
            at_once.remove(name)
            order.append(name)

        return run

    for name in "abc":
        queue.submit(Task(name, work(name)))
    assert queue.waiting() == 2
    qtbot.waitUntil(lambda: queue.is_idle)
    assert order == ["a", "b", "c"]
    assert most == [1]


def test_only_the_newest_of_the_waiting_pictures_is_built(queue, qtbot):
    built = []
    queue.submit(Task("busy", lambda control: time.sleep(0.1)), lane="view")
    for number in range(5):
        queue.submit(
            Task("mesh", lambda control, number=number: built.append(number)), lane="view", key="mesh"
        )
    qtbot.waitUntil(lambda: queue.is_idle)
    assert built == [4]


def test_a_waiting_task_can_be_cancelled(queue, qtbot):
    ran = []
    queue.submit(Task("first", lambda control: time.sleep(0.1)))
    second = queue.submit(Task("second", lambda control: ran.append(True)))
    second.cancel()
    qtbot.waitUntil(lambda: queue.is_idle)
    assert not ran
    assert second.state == "cancelled"


def test_an_error_is_told_and_the_queue_goes_on(queue, qtbot):
    def fail(control):
        raise ScanError("scan.tif is cut off: copy it again.")

    errors, done = [], []
    queue.failed.connect(lambda task, error: errors.append((task.title, str(error))))
    queue.submit(Task("opening", fail))
    queue.submit(Task("next", lambda control: done.append(True)))
    qtbot.waitUntil(lambda: queue.is_idle)
    assert errors == [("opening", "scan.tif is cut off: copy it again.")]
    assert done == [True]


def test_a_task_that_outlives_its_queue_says_nothing_and_raises_nothing(qtbot, monkeypatch):
    let_go, raised = threading.Event(), []
    monkeypatch.setattr(threading, "excepthook", lambda given: raised.append(given.exc_value))

    def work(control):
        let_go.wait(60)
        control.report(0.5, "half")
        return 1

    queue = TaskQueue()
    task = queue.submit(Task("deaf", work))
    thread = task._thread
    assert not queue.shut_down(0.05)
    queue.deleteLater()
    delete_later_now()  # the task is gone, and its thread goes on
    let_go.set()
    thread.join(20)
    assert not thread.is_alive()
    assert raised == []
