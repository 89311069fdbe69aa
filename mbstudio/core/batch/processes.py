"""Child processes that answer over pipes, and the threads that keep them busy."""

from __future__ import annotations

import os
import queue
import subprocess
import threading
from collections.abc import Callable, Generator
from typing import BinaryIO, Generic, TypeVar, cast

from mbstudio.core.batch.messages import child_command, child_environment

_ONE_THREAD = {
    "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1",
}  # fmt: skip


LIMIT = "MBSTUDIO_PROCESSES"
"""Environment variable: how many processes work at most, unless a call says otherwise."""


def processors() -> int:
    """Return the number of cores that the system gives this process."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def process_limit() -> int | None:
    """Return how many processes may work at most; None for as many as there are cores."""
    given = os.environ.get(LIMIT, "")
    return int(given) if given.isdecimal() and int(given) > 0 else None


def limit_processes(count: int | None) -> None:
    """Let at most so many processes work from now on; None for as many as there are cores."""
    if count is None:
        os.environ.pop(LIMIT, None)
    else:
        os.environ[LIMIT] = str(count)


def usable_cores() -> int:
    """Return the number of cores that this process may use: those that are there, or fewer if limited."""
    return min(processors(), process_limit() or processors())


class Child:
    """One process that runs ``serve()`` of a module on one thread, and the pipes to it."""

    def __init__(self, module: str) -> None:
        self._process = subprocess.Popen(
            child_command(module),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=child_environment(**_ONE_THREAD),
        )

    @property
    def requests(self) -> BinaryIO:
        """Where it reads."""
        return cast(BinaryIO, self._process.stdin)

    @property
    def answers(self) -> BinaryIO:
        """Where it writes."""
        return cast(BinaryIO, self._process.stdout)

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


Worker = TypeVar("Worker", bound=Child)
Task = TypeVar("Task")
Item = TypeVar("Item")


class Crew(Generic[Worker, Task, Item]):
    """Threads that each feed one process, and the queue of what comes back.

    Parameters
    ----------
    hire : callable
        Starts a process; called when a thread has its first task, and after a process died.
    next_task : callable
        Returns the next task, None after the last; called from all threads.
    work : callable
        Has a process do a task and returns the item; what it raises ends the batch, but EOFError and
        OSError, which mean that the process has died.
    lost : callable
        Returns the item of a task whose process died with this exit code.
    size : int
        How many processes.
    """

    def __init__(
        self,
        hire: Callable[[], Worker],
        next_task: Callable[[], Task | None],
        work: Callable[[Worker, Task], Item],
        lost: Callable[[Task, int], Item],
        size: int,
    ) -> None:
        self._start, self._next_task, self._work, self._lost = hire, next_task, work, lost
        self._done: queue.Queue[Item | BaseException] = queue.Queue(maxsize=4 * size)
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._workers: set[Worker] = set()
        self._threads = [
            threading.Thread(target=self._feed, name=f"crew-{i}", daemon=True) for i in range(size)
        ]

    def items(self, count: int) -> Generator[Item, None, None]:
        """Yield so many items in the order of completion; closing the generator ends everything at once."""
        try:
            for thread in self._threads:
                thread.start()
            for _ in range(count):
                item = self._done.get()
                if isinstance(item, BaseException):
                    raise item
                yield item
        finally:
            self._end()

    def _hire(self) -> Worker | None:
        with self._lock:
            if self._stop.is_set():
                return None
            worker = self._start()
            self._workers.add(worker)
            return worker

    def _dismiss(self, worker: Worker) -> int:
        code = worker.close()
        with self._lock:
            self._workers.discard(worker)
        return code

    def _put(self, item: Item | BaseException) -> None:
        while not self._stop.is_set():
            try:
                self._done.put(item, timeout=0.2)
                return
            except queue.Full:  # the caller is in no hurry: wait with it
                continue

    def _feed(self) -> None:
        worker: Worker | None = None
        try:
            while not self._stop.is_set() and (task := self._next_task()) is not None:
                worker = worker or self._hire()
                if worker is None:
                    return
                try:
                    item = self._work(worker, task)
                except (EOFError, OSError):
                    code, worker = self._dismiss(worker), None
                    item = self._lost(task, code)
                self._put(item)
        except BaseException as error:  # raised again where the batch is driven
            self._put(error)
        finally:
            if worker is not None:
                self._dismiss(worker)

    def _end(self) -> None:
        """End all processes and threads, whatever they are at."""
        with self._lock:
            self._stop.set()
            for worker in self._workers:
                worker.kill()
        for thread in self._threads:
            thread.join()
