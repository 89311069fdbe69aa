"""Work that is only worth doing for the newest wish: the last event wins, nothing stale queues up."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QObject, Qt, Signal

log = logging.getLogger(__name__)


class LatestRequestWorker(QObject):
    """A thread that works on the newest request; one that waits is replaced by the next.

    Results arrive in the main thread in the order of their requests. Between two results lie as many
    requests as came in meanwhile, of which only the last is worked on.

    Attributes
    ----------
    done : signal (object, object)
        The token of a request, and what its work returned.
    failed : signal (object, Exception)
    """

    done = Signal(object, object)
    failed = Signal(object, object)
    _posted = Signal(bool, object, object)

    def __init__(self, name: str, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._name = name
        self._wish: tuple[Callable[[], Any], Any] | None = None
        self._busy = self._ended = False
        self._changed = threading.Condition()
        self._undelivered = 0
        self._thread: threading.Thread | None = None
        self.dropped = 0
        self._posted.connect(self._deliver, Qt.ConnectionType.QueuedConnection)

    def ask(self, work: Callable[[], Any], token: Any = None) -> None:
        """Let `work` be done in the thread unless something newer is asked before it begins."""
        with self._changed:
            if self._ended:
                return
            self.dropped += self._wish is not None
            self._wish = (work, token)
            self._changed.notify()
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
            self._thread.start()

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits, runs or has yet to be delivered."""
        with self._changed:
            return self._wish is None and not self._busy and not self._undelivered

    def close(self, seconds: float = 10.0) -> bool:
        """End the thread after what it does now; return whether it has ended."""
        with self._changed:
            self._ended, self._wish = True, None
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(seconds)
        return self._thread is None or not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._changed:
                # What was found before is taken first: a result that nobody has time to show is worth less
                # than one that is begun later, with a newer wish.
                while (self._wish is None or self._undelivered) and not self._ended:
                    self._changed.wait()
                if self._ended:
                    return
                assert self._wish is not None
                (work, token), self._wish, self._busy = self._wish, None, True
            good = True
            try:
                result = work()
            except Exception as error:
                log.debug("%s failed", self._name, exc_info=True)
                good, result = False, error
            with self._changed:
                self._busy = False
                if self._ended:
                    return
                self._undelivered += 1
            self._posted.emit(good, token, result)

    def _deliver(self, good: bool, token: Any, result: Any) -> None:
        try:
            if not self._ended:
                (self.done if good else self.failed).emit(token, result)
        finally:
            with self._changed:
                self._undelivered -= 1
                self._changed.notify()
