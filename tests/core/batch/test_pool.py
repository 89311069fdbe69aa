"""The pool: results in order whatever the processes; failures, lost processes, reports."""

from __future__ import annotations

import pytest

from mbstudio.core.batch.pool import WorkerPool
from mbstudio.core.errors import Cancelled, FitError
from tests.core.batch.square_job import OnceJob, SquareJob, StrictJob, TwiceJob


@pytest.mark.parametrize("size", [0, 1, 3])
def test_results_come_in_the_order_of_the_tasks(size):
    tasks, seen = [5, 3, -1, 4, 2000, 1], []
    found = WorkerPool(SquareJob(), size).map(tasks, lambda task, result: seen.append((task, result)))
    kind = "TooLarge" if size == 0 else "FitError"
    assert found == [25, 9, "FitError: -1 is negative", 16, f"{kind}: 2000 is too large", 1]
    assert sorted(seen, key=str) == sorted(zip(tasks, found, strict=True), key=str)


@pytest.mark.parametrize("size", [0, 2])
def test_an_error_that_is_no_result_ends_the_batch(size):
    with pytest.raises(FitError, match="2000 is too large"):
        WorkerPool(StrictJob(), size).map([1, 2000, 2])


def test_a_lost_process_costs_its_task_only():
    assert WorkerPool(SquareJob(), 1).map([2, 666, 3]) == [4, "ended with 7", 9]


def test_a_task_is_tried_as_often_as_its_job_says():
    for job, begun in ((OnceJob(), [2, 666, 3]), (TwiceJob(), [2, 666, 666, 3])):
        assert WorkerPool(job, 1).map([2, 666, 3]) == [4, "ended with 7", 9]
        assert job.packed == begun


def test_reports_come_to_the_calling_thread_and_can_end_the_work():
    told = []
    assert WorkerPool(SquareJob(), 1).map([6], on_report=lambda *report: told.append(report)) == [36]
    assert told[-1] == (0.5, "squaring 6")
    assert all(report == (0.0, "Starting") for report in told[:-1])

    def cancel(share, message):
        raise Cancelled("The work was cancelled.")

    with pytest.raises(Cancelled):
        WorkerPool(SquareJob(), 2).map([1, 2, 3], on_report=cancel)


def test_no_tasks_need_no_process():
    assert WorkerPool(SquareJob(), 4).map([]) == []
