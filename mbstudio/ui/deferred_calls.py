"""Calls that wait until the event loop is free, and go with whoever made them."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject, QTimer


class DeferredCalls(QObject):
    """Makes calls once the event loop is free, none of them after its parent is gone.

    ``QTimer.singleShot`` keeps what it was given, and all that hangs on it, for ever if the loop ends first.

    Parameters
    ----------
    parent : QObject
    """

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._calls: list[Callable[[], object]] = []
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(0)
        self._timer.timeout.connect(self._run)

    def call(self, what: Callable[[], object]) -> None:
        """Call `what` soon; once, if it waits already."""
        if what not in self._calls:
            self._calls.append(what)
        self._timer.start()

    def _run(self) -> None:
        calls, self._calls = self._calls, []
        for what in calls:
            what()
