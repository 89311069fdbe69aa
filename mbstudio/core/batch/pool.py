"""A pool of processes, the one way in which mbstudio computes on several cores.

A :class:`Job` declares what goes in, what is done and what comes out; a :class:`WorkerPool` starts the
processes, hands out the tasks and collects the results. Processes are fresh Pythons that talk over their
standard input and output: they need nothing of the caller's ``__main__`` and can be started from a window's
thread, a test or a bare script.
"""

from __future__ import annotations

import os
import queue
import subprocess
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, Generic, TypeVar, cast

from mbstudio.core import errors
from mbstudio.core.batch.kept_answers import KeptAnswers, current_answers, question_of
from mbstudio.core.batch.messages import Arrays, Head, Message, Report, receive, send, unheard
from mbstudio.core.errors import MbstudioError

Task = TypeVar("Task")
Result = TypeVar("Result")

Heard = Callable[[float, str], object]
Seen = Callable[[Arrays], object]

_ROOT = str(Path(__file__).resolve().parents[3])
"""The folder that holds this very package ``mbstudio``, installed or not."""
_ONE_THREAD = {
    "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1",
}  # fmt: skip
_START = "import sys; from mbstudio.core.batch.child import serve; serve(sys.argv[1])"
_ASK_EVERY = 0.1  # seconds between two looks at whether whoever gets the reports has cancelled


class Job(ABC, Generic[Task, Result]):
    """A kind of work: what goes in, what is done, what comes out.

    A process imports the module of the class and calls its :meth:`work`; everything else happens on the
    caller's side, in the threads of the pool. So the module should import only what the work needs.

    Attributes
    ----------
    one_thread : bool
        Whether a process computes on one thread, as it should where there are several.
    tries : int
        How often a task is begun whose process is killed, each time by a fresh one: what killed the first
        was often something else that needed the memory.
    keeps_answers : bool
        Whether an answer is all that the work yields, so that it can be kept for the next run
        (:func:`~mbstudio.core.batch.kept_answers.keeping_answers`).
    complaints : Path or None
        The file for what processes print; None: where this program's errors go.
    """

    one_thread: ClassVar[bool] = True
    tries: ClassVar[int] = 2
    keeps_answers: ClassVar[bool] = True
    complaints: Path | None = None

    @abstractmethod
    def pack(self, task: Task) -> Message:
        """Return a task as plain values and arrays, when its turn comes."""

    @staticmethod
    @abstractmethod
    def work(head: Head, arrays: Arrays, report: Report) -> Message:
        """Do a packed task, in the process; MbstudioError reaches the caller, others end the process."""

    @abstractmethod
    def unpack(self, task: Task, head: Head, arrays: Arrays) -> Result:
        """Return the result of what :meth:`work` returned."""

    @abstractmethod
    def lose(self, task: Task, code: int) -> Result:
        """Return the result of a task whose (last) process ended with this code, or raise what ends all."""

    def fail(self, task: Task, error: MbstudioError) -> Result:
        """Return the result of a task that could not be packed or done; by default the error ends all."""
        raise error

    def work_here(self, task: Task) -> Result:
        """Do a task in the calling thread."""
        return self.unpack(task, *self.work(*self.pack(task), unheard))


class WorkerPool(Generic[Task, Result]):
    """Processes that do the tasks of a job.

    Parameters
    ----------
    job : Job
    size : int
        How many processes; 0 does all in the calling thread. The results do not depend on it.
    """

    def __init__(self, job: Job[Task, Result], size: int) -> None:
        self._job, self._size = job, size
        self._kept = current_answers() if job.keeps_answers else None

    def map(
        self,
        tasks: Sequence[Task],
        on_result: Callable[[Task, Result], object] | None = None,
        on_report: Heard | None = None,
        on_arrays: Seen | None = None,
    ) -> list[Result]:
        """Return the results in the order of the tasks.

        Parameters
        ----------
        tasks : sequence
        on_result : callable, optional
            ``on_result(task, result)`` in the calling thread as each is done; what it raises ends all.
        on_report, on_arrays : callable, optional
            As for :meth:`as_completed`.
        """
        found: dict[int, Result] = {}
        with closing(self.as_completed(tasks, on_report, on_arrays)) as done:
            for place, result in done:
                found[place] = result
                if on_result is not None:
                    on_result(tasks[place], result)
        return [found[place] for place in range(len(tasks))]

    def as_completed(
        self, tasks: Sequence[Task], on_report: Heard | None = None, on_arrays: Seen | None = None
    ) -> Generator[tuple[int, Result], None, None]:
        """Yield the place of each task and its result as it is done; closing the generator ends all at once.

        Parameters
        ----------
        tasks : sequence
        on_report : callable, optional
            ``on_report(share, message)`` in the calling thread for what :meth:`Job.work` reports, at least
            ten times a second; what it raises ends all.
        on_arrays : callable, optional
            ``on_arrays(arrays)`` in the calling thread for the arrays of a report that has some. Who takes
            its time over them lets the process wait.
        """
        if self._size == 0:
            yield from _work_here(self._job, tasks, self._kept)
            return
        with closing(_Run(self._job, tasks, min(self._size, len(tasks)), self._kept)) as run:
            for _ in tasks:
                yield run.wait(on_report, on_arrays)


def _work_here(
    job: Job[Task, Result], tasks: Sequence[Task], kept: KeptAnswers | None
) -> Iterator[tuple[int, Result]]:
    for place, task in enumerate(tasks):
        try:
            if kept is None:
                result = job.work_here(task)
            else:
                message = job.pack(task)
                result = _answered(job, task, message, kept, lambda message: job.work(*message, unheard))
        except MbstudioError as error:
            result = job.fail(task, error)
        yield place, result


def _answered(
    job: Job[Task, Result],
    task: Task,
    message: Message,
    kept: KeptAnswers | None,
    ask: Callable[[Message], Message],
) -> Result:
    """Return the result of a packed task, from an answer that is there or from whoever is asked."""
    if kept is None:
        return job.unpack(task, *ask(message))
    question = question_of(type(job), message)
    answer = kept.find(question)
    if answer is None:
        answer = ask(message)
        kept.keep(question, answer)
    return job.unpack(task, *answer)


@dataclass(frozen=True)
class _Told:
    """What a process reports on the way."""

    share: float
    message: str
    arrays: Arrays = field(default_factory=dict)


class _Run(Generic[Task, Result]):
    """Threads that each feed one process, and the queue of what comes back."""

    def __init__(
        self, job: Job[Task, Result], tasks: Sequence[Task], size: int, kept: KeptAnswers | None
    ) -> None:
        self._job, self._kept = job, kept
        self._tasks = enumerate(tasks)
        self._back: queue.Queue[tuple[int, Result] | _Told | BaseException] = queue.Queue(maxsize=4 * size)
        self._stopped = threading.Event()
        self._lock = threading.Lock()
        self._children: set[Child] = set()
        self._told = _Told(0.0, "Starting")
        self._threads = [
            threading.Thread(target=self._feed, name=f"pool-{i}", daemon=True) for i in range(size)
        ]
        for thread in self._threads:
            thread.start()

    def wait(self, on_report: Heard | None, on_arrays: Seen | None = None) -> tuple[int, Result]:
        """Return what is done next, passing on what is reported in the meantime."""
        while True:
            try:
                item = self._back.get(timeout=None if on_report is None else _ASK_EVERY)
            except queue.Empty:
                item = self._told
            if isinstance(item, BaseException):
                raise item
            if not isinstance(item, _Told):
                return item
            self._told = _Told(item.share, item.message)
            if on_arrays is not None and item.arrays:
                on_arrays(item.arrays)
            if on_report is not None:
                on_report(item.share, item.message)

    def close(self) -> None:
        """End all processes and threads, whatever they are at."""
        with self._lock:
            self._stopped.set()
            for child in self._children:
                child.kill()
        for thread in self._threads:
            thread.join()

    def _feed(self) -> None:
        child: Child | None = None

        def ask(message: Message) -> Message:
            nonlocal child
            child = child or self._start_child()
            return child.ask(message, self._tell)

        try:
            while (numbered := self._next_task()) is not None:
                place, task = numbered
                for tried in range(1, self._job.tries + 1):
                    try:
                        result = _answered(self._job, task, self._job.pack(task), self._kept, ask)
                    except MbstudioError as error:
                        result = self._job.fail(task, error)
                    except _Gone:
                        code, child = self._retire(cast(Child, child)), None
                        if self._stopped.is_set():
                            return
                        if tried < self._job.tries:
                            continue
                        result = self._job.lose(task, code)
                    break
                self._hand_back((place, result))
        except _Stopped:
            return
        except BaseException as error:  # raised again where the results are collected
            self._hand_back(error)
        finally:
            if child is not None:
                self._retire(child)

    def _next_task(self) -> tuple[int, Task] | None:
        with self._lock:
            return None if self._stopped.is_set() else next(self._tasks, None)

    def _start_child(self) -> Child:
        with self._lock:
            if self._stopped.is_set():
                raise _Stopped
            child = Child(type(self._job), self._job.one_thread, self._job.complaints)
            self._children.add(child)
            return child

    def _retire(self, child: Child) -> int:
        code = child.close()
        with self._lock:
            self._children.discard(child)
        return code

    def _tell(self, share: float, message: str, arrays: Arrays | None = None, /) -> None:
        self._hand_back(_Told(share, message, arrays or {}))

    def _hand_back(self, item: tuple[int, Result] | _Told | BaseException) -> None:
        while not self._stopped.is_set():
            try:
                self._back.put(item, timeout=0.2)
                return
            except queue.Full:  # whoever collects is in no hurry: wait with it
                continue


class _Stopped(Exception):
    """The results are no longer wanted."""


class _Gone(Exception):
    """A process has ended in the middle of a task."""


class Child:
    """One process that does packed tasks one after another, and the pipes to it."""

    def __init__(self, job: type[Job[Any, Any]], one_thread: bool, complaints: Path | None) -> None:
        paths = os.pathsep.join(path for path in (_ROOT, os.environ.get("PYTHONPATH", "")) if path)
        environment = {**os.environ, **(_ONE_THREAD if one_thread else {}), "PYTHONPATH": paths}
        with ExitStack() as files:
            errors_to = None if complaints is None else files.enter_context(complaints.open("wb"))
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", _START, f"{job.__module__}:{job.__qualname__}"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors_to,
                env=environment,
            )

    def ask(self, message: Message, on_report: Report) -> Message:
        """Have a task done.

        Raises
        ------
        MbstudioError
            As the work raised it.
        """
        requests, answers = (cast(BinaryIO, pipe) for pipe in (self._process.stdin, self._process.stdout))
        try:
            send(requests, *message)
            while True:
                head, arrays = receive(answers)
                if "report" not in head:
                    break
                share, told = head["report"]
                on_report(share, told, arrays)
        except (EOFError, OSError) as error:
            raise _Gone from error
        if "error" in head:
            raise _error_from(head)
        return head["answer"], arrays

    def kill(self) -> None:
        """End the process without waiting for its task."""
        self._process.kill()

    def close(self) -> int:
        """Let the process end by itself, or see that it has; return its exit code."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                try:
                    pipe.close()
                except BrokenPipeError:  # it died with a message half sent: that task is lost anyway
                    continue
        return self._process.wait()


def _error_from(head: Mapping[str, Any]) -> MbstudioError:
    kind, message = head["error"]
    found: MbstudioError = getattr(errors, kind)(message)
    return found
