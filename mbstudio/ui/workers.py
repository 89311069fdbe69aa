"""Work in the background: one class that runs a function or a step object in a thread.

A step object is driven by calling ``next``: pausing is not calling it, cancelling is dropping
it. What a task has to say reaches the main thread at most twenty times a second, and never
faster than the main thread takes it.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QObject, Qt, Signal

from mbstudio.core.errors import Cancelled
from mbstudio.core.time_left import TimeLeft
from mbstudio.ui.deferred_calls import DeferredCalls

log = logging.getLogger(__name__)

PERIOD = 0.05  # seconds between two reports to the main thread


@dataclass(frozen=True)
class Report:
    """What a running task says.

    Attributes
    ----------
    fraction : float
        Done so far, 0 to 1; negative if it cannot be known.
    message : str
        What it is doing.
    seconds_left : float or None
        Estimate from the time taken so far, without pauses; None if it cannot be known.
    steps : tuple
        Steps of the step object since the last report.
    view : object
        What `prepare` made of the last step, in the worker's thread; None if there was no step.
    """

    fraction: float
    message: str
    seconds_left: float | None
    steps: tuple[Any, ...] = ()
    view: Any = None


class Control:
    """The worker's side of a task: it reports progress here and learns of pause and cancel."""

    def __init__(self, post: Callable[[str, Any], None]) -> None:
        self._post = post
        self._may_run = threading.Event()
        self._may_run.set()
        self._cancelled = threading.Event()
        self._taken = threading.Event()
        self._taken.set()
        self._calls: deque[Callable[[], None]] = deque()
        self._begun = time.monotonic()
        self._paused_for = 0.0
        self._last_report = 0.0
        self._farthest = -1.0
        self._time_left = TimeLeft()

    @property
    def is_cancelled(self) -> bool:
        return self._cancelled.is_set()

    def checkpoint(self) -> None:
        """Wait while paused; raise Cancelled once the task is cancelled."""
        if not self._may_run.is_set():
            paused_at = time.monotonic()
            self._may_run.wait()
            self._paused_for += time.monotonic() - paused_at
        if self._cancelled.is_set():
            raise Cancelled("The work was cancelled.")

    def progress(self, fraction: float, message: str = "") -> None:
        """Report progress: the callback that long functions of the core take."""
        self.checkpoint()
        if self.is_due():
            self.report(fraction, message)

    def is_due(self) -> bool:
        """Return whether the main thread has taken the last report and it is time for another."""
        return self._taken.is_set() and time.monotonic() - self._last_report >= PERIOD

    def report(self, fraction: float, message: str, steps: tuple[Any, ...] = (), view: Any = None) -> None:
        """Send a report now; what was done once stays done."""
        fraction = self._farthest = max(self._farthest, fraction)
        self._taken.clear()
        self._last_report = time.monotonic()
        elapsed = self._last_report - self._begun - self._paused_for
        left = self._time_left.look(elapsed, float(fraction))
        self._post("report", Report(float(fraction), message, left, steps, view))

    def run_waiting_calls(self) -> None:
        """Run what the main thread asked to be done between two steps."""
        while self._calls:
            self._calls.popleft()()


class Task(QObject):
    """One piece of work in a thread of its own.

    Parameters
    ----------
    title : str
        What it does, for the status bar ("Finding grains").
    work : callable
        Called in the thread with a :class:`Control`. It returns the result, or an iterator of
        steps, which is then driven to its end; the result is then the last step.
    prepare : callable, optional
        Called in the thread with a step before it is reported: builds meshes and the like.
    fraction : callable, optional
        Fraction done (0 to 1) and message of a step, for progress.
    """

    started = Signal()
    reported = Signal(object)
    succeeded = Signal(object)
    failed = Signal(object)
    cancelled = Signal()
    ended = Signal()
    _posted = Signal(str, object)

    def __init__(
        self,
        title: str,
        work: Callable[[Control], Any],
        *,
        prepare: Callable[[Any], Any] | None = None,
        fraction: Callable[[Any], tuple[float, str]] | None = None,
    ) -> None:
        super().__init__()
        self.title = title
        self.state = "waiting"
        self.is_paused = False
        self.can_pause = fraction is not None
        self.can_cancel = True
        self.newest: Report | None = None
        self.handled: tuple[type[Exception], ...] = ()  # errors that its owner answers itself
        self._is_muted = False
        self._work = work
        self._prepare = prepare
        self._fraction = fraction
        self._control = Control(self._post)
        self._thread = threading.Thread(target=self._run, name=title, daemon=True)
        # Queued: whoever listens is called in the main thread, whatever kind of callable it is.
        self._posted.connect(self._deliver, Qt.ConnectionType.QueuedConnection)

    def start(self) -> None:
        """Begin in a new thread."""
        if self.state == "cancelled":
            return
        self.state = "running"
        self.started.emit()
        self._thread.start()

    def pause(self) -> None:
        """Stop before the next step, or at the next report of progress."""
        if self.state == "running":
            self.is_paused = True
            self._control._may_run.clear()

    def resume(self) -> None:
        """Go on."""
        self.is_paused = False
        self._control._may_run.set()

    def pause_or_resume(self) -> None:
        """Pause, or go on if it is paused."""
        if self.is_paused:
            self.resume()
        else:
            self.pause()

    def cancel(self) -> None:
        """Give up at the next step or report of progress."""
        self._control._cancelled.set()
        self.resume()
        if self.state == "waiting":
            self.state = "cancelled"
            self.cancelled.emit()
            self.ended.emit()

    def call_between_steps(self, call: Callable[[], None]) -> None:
        """Let `call` run in the worker's thread before its next step."""
        self._control._calls.append(call)

    @property
    def is_over(self) -> bool:
        return self.state not in ("waiting", "running")

    def mute(self) -> None:
        """Say nothing any more: whoever would listen is about to be deleted."""
        self._is_muted = True

    def wait(self, seconds: float) -> bool:
        """Wait for the thread to end; return whether it has."""
        if self._thread.ident is not None:
            self._thread.join(seconds)
        return not self._thread.is_alive()

    # ---- in the thread ---------------------------------------------------------------------

    def _run(self) -> None:
        try:
            result = self._work(self._control)
            if hasattr(result, "__next__"):
                result = self._drive(result)
            self._post("succeeded", result)
        except Cancelled:
            self._post("cancelled", None)
        except Exception as error:
            log.debug("%s failed", self.title, exc_info=True)
            self._post("failed", error)

    def _post(self, kind: str, value: Any) -> None:
        """Tell the main thread, unless this object may be deleted by now."""
        if not self._is_muted:
            self._posted.emit(kind, value)

    def _drive(self, steps: Iterator[Any]) -> Any:
        waiting: list[Any] = []
        step = None
        try:
            while True:
                self._control.checkpoint()
                self._control.run_waiting_calls()
                try:
                    step = next(steps)
                except StopIteration:
                    break
                waiting.append(step)
                if self._control.is_due():
                    self._report(waiting)
                    waiting = []
        finally:
            if waiting:
                self._report(waiting)
            close = getattr(steps, "close", None)
            if close is not None:
                close()
        return step

    def _report(self, steps: list[Any]) -> None:
        fraction, message = self._fraction(steps[-1]) if self._fraction else (-1.0, "")
        view = self._prepare(steps[-1]) if self._prepare else None
        self._control.report(fraction, message, tuple(steps), view)

    # ---- in the main thread ----------------------------------------------------------------

    def _deliver(self, kind: str, value: Any) -> None:
        if self._is_muted:
            return
        if kind == "report":
            try:
                if not self._control.is_cancelled:
                    self.newest = value
                    self.reported.emit(value)
            finally:
                self._control._taken.set()
            return
        self.state = kind
        if kind == "succeeded":
            self.succeeded.emit(value)
        elif kind == "failed":
            self.failed.emit(value)
        else:
            self.cancelled.emit()
        self.ended.emit()


class TaskQueue(QObject):
    """Runs tasks one after another in each lane.

    The lane ``work`` is what the person asked for and sees in the status bar; ``saving`` goes on whatever
    runs; ``view`` builds meshes. A task with a key replaces one with the same key that still waits: only the
    newest picture is worth building.
    """

    started = Signal(object)
    failed = Signal(object, object)
    changed = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._running: dict[str, Task] = {}
        self._waiting: dict[str, deque[tuple[str | None, Task]]] = {}
        self._deferred = DeferredCalls(self)

    def submit(self, task: Task, lane: str = "work", key: str | None = None) -> Task:
        """Start a task as soon as its lane is free."""
        queue = self._waiting.setdefault(lane, deque())
        if key is not None:
            for entry in [entry for entry in queue if entry[0] == key]:
                queue.remove(entry)
                entry[1].cancel()
        queue.append((key, task))
        task.ended.connect(lambda: self._ended(lane, task))
        task.failed.connect(lambda error: self._failed(task, error))
        self._start_next(lane)
        self.changed.emit()
        return task

    def running(self, lane: str = "work") -> Task | None:
        """Return the task that runs in a lane."""
        return self._running.get(lane)

    def waiting_tasks(self, lane: str = "work") -> list[Task]:
        """Return the tasks that wait in a lane, the next one first."""
        return [task for _, task in self._waiting.get(lane, ()) if not task.is_over]

    def waiting(self, lane: str = "work") -> int:
        """Return how many tasks wait in a lane."""
        return len(self.waiting_tasks(lane))

    @property
    def is_idle(self) -> bool:
        return not self._running and not any(self._waiting.values())

    def cancel_all(self, lane: str | None = None) -> None:
        """Cancel what runs and what waits."""
        for name in [lane] if lane else [*self._waiting]:
            for _, task in [*self._waiting.get(name, ())]:
                task.cancel()
            self._waiting.get(name, deque()).clear()
            if name in self._running:
                self._running[name].cancel()

    def shut_down(self, seconds: float = 10.0) -> bool:
        """Cancel everything and wait for the threads; return whether all have ended."""
        self.cancel_all()
        running = [*self._running.values()]
        self._running.clear()
        for task in running:
            task.mute()
        # Every thread is waited for, also after one that does not end.
        ended = [task.wait(seconds) for task in running]
        for task in running:
            task.deleteLater()
        return all(ended)

    def _start_next(self, lane: str) -> None:
        queue = self._waiting.get(lane)
        while queue and lane not in self._running:
            _, task = queue.popleft()
            if task.is_over:
                continue
            self._running[lane] = task
            self.started.emit(task)
            task.start()

    def _failed(self, task: Task, error: Exception) -> None:
        if not isinstance(error, task.handled):
            self.failed.emit(task, error)

    def _ended(self, lane: str, task: Task) -> None:
        if self._running.get(lane) is task:
            del self._running[lane]
            # Not from within the task's own signal: its last listeners come first.
            self._deferred.call(self._go_on)
        # Listeners may hold the task and, through its signals, be held by it: Python sees no such ring.
        task.deleteLater()
        self.changed.emit()

    def _go_on(self) -> None:
        for lane in [*self._waiting]:
            self._start_next(lane)
        self.changed.emit()
