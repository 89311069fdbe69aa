"""One piece of long work at a time: whether it runs, and how to halt, end or give it up."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject, Signal

from mbstudio.ui.language import tr
from mbstudio.ui.widgets.numbers import readable_time
from mbstudio.ui.workers import Report, Task, TaskQueue


class Run(QObject):
    """What a work of a station does at the moment, or did last.

    Parameters
    ----------
    queue : TaskQueue
    parent : QObject

    Attributes
    ----------
    task : Task or None
        The one that runs or ran last.
    progress : Report or None
        The newest of the task that runs.
    changed : signal
        It begins, pauses, goes on or has ended.
    reported : signal
        There is newer progress.
    """

    changed = Signal()
    reported = Signal()

    def __init__(self, queue: TaskQueue, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._queue = queue
        self._end_early: Callable[[], None] | None = None
        self.task: Task | None = None
        self.progress: Report | None = None

    @property
    def is_running(self) -> bool:
        """Whether it runs, waits for its turn or is paused."""
        return self.task is not None and not self.task.is_over

    @property
    def is_paused(self) -> bool:
        """Whether it is halted."""
        return self.task is not None and not self.task.is_over and self.task.is_paused

    def start(self, task: Task, end_early: Callable[[], None] | None = None) -> Task:
        """Run a task as soon as its lane is free.

        Parameters
        ----------
        task : Task
        end_early : callable, optional
            Makes the task end at its next step with what it has found, for `stop`.
        """
        self.task, self.progress, self._end_early = task, None, end_early
        task.reported.connect(self._report)
        task.started.connect(self.changed)
        task.ended.connect(self.changed)
        self._queue.submit(task)
        self.changed.emit()
        return task

    def pause_or_resume(self) -> None:
        """Halt before the next step, or go on."""
        if self.is_running and self.task is not None:
            self.task.pause_or_resume()
            self.changed.emit()
            self._queue.changed.emit()

    @property
    def can_stop(self) -> bool:
        """Whether it can be ended with what it has found so far."""
        return self.is_running and self._end_early is not None

    def stop(self) -> None:
        """End early and keep what was found."""
        if self.can_stop and self.task is not None and self._end_early is not None:
            self._end_early()
            self.task.resume()
            self.changed.emit()

    def cancel(self) -> None:
        """Give up; what was there before stays."""
        if self.task is not None:
            self.task.cancel()

    def call_between_steps(self, call: Callable[[], None]) -> None:
        """Let `call` run in the worker's thread before the next step."""
        if self.is_running and self.task is not None:
            self.task.call_between_steps(call)

    def state(self, what: str = "") -> str:
        """Return in words what it does, how far it is and how long it takes still; empty if nothing runs.

        Parameters
        ----------
        what : str
            Name of the present part of the work, put before its message.
        """
        if not self.is_running:
            return ""
        if self.is_paused:
            return tr("Paused.")
        report = self.progress
        if report is None:
            return tr("Waiting for its turn.")
        told = report.message
        if what:
            told = f"{what}: {told[:1].lower()}{told[1:]}"
        if report.seconds_left is None:
            return told
        return tr("{hint} · {time} left", hint=told, time=readable_time(report.seconds_left))

    def _report(self, report: Report) -> None:
        self.progress = report
        self.reported.emit()
