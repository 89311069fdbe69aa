"""Notes all that goes wrong in a program while it is watched: exceptions, warnings, what is left alive."""

from __future__ import annotations

import gc
import logging
import os
import sys
import threading
import time
import traceback
import warnings
import weakref
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QEvent, QObject, QtMsgType, qInstallMessageHandler
from PySide6.QtWidgets import QApplication, QWidget

from tests.ui.conftest import delete_later_now, living

_BAD = (QtMsgType.QtWarningMsg, QtMsgType.QtCriticalMsg, QtMsgType.QtFatalMsg)


class Painted(QObject):
    """Remembers which widget is painted: a complaint of Qt about painting does not name it."""

    def __init__(self) -> None:
        super().__init__()
        self.last = ""

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint and isinstance(watched, QWidget):
            names = []
            widget: QWidget | None = watched
            while widget is not None and len(names) < 6:
                names.append(
                    f"{type(widget).__name__} {widget.objectName()} {widget.width()} × {widget.height()}"
                )
                widget = widget.parentWidget()
            self.last = " in ".join(names)
        return False


class Watch(logging.Handler):
    """Keeps every fault once, with how often it came.

    Attributes
    ----------
    faults : Counter of str
    doing : str
        What the hand does at the moment: each fault is noted with it.
    """

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.faults: Counter[str] = Counter()
        self.first: dict[str, str] = {}
        self.doing = ""

    def note(self, fault: str) -> None:
        """Note a fault."""
        self.faults[fault] += 1
        self.first.setdefault(fault, self.doing)

    def __enter__(self) -> Watch:
        self._hooks = sys.excepthook, threading.excepthook, sys.unraisablehook
        sys.excepthook = self._python_said
        threading.excepthook = lambda given: self.note(f"in a thread: {_told(given.exc_value)}")
        sys.unraisablehook = lambda given: self.note(f"unraisable: {_told(given.exc_value)} {given.err_msg}")
        self._before = qInstallMessageHandler(self._qt_said)
        self._painted = Painted()
        QApplication.instance().installEventFilter(self._painted)
        self._caught = warnings.catch_warnings()
        self._caught.__enter__()
        warnings.simplefilter("always")
        warnings.showwarning = self._warned
        logging.getLogger("mbstudio").addHandler(self)
        return self

    def __exit__(self, *_: object) -> None:
        logging.getLogger("mbstudio").removeHandler(self)
        self._caught.__exit__(None, None, None)
        qInstallMessageHandler(self._before)
        QApplication.instance().removeEventFilter(self._painted)
        sys.excepthook, threading.excepthook, sys.unraisablehook = self._hooks

    def _python_said(self, _kind: type, error: BaseException, _trace: Any) -> None:
        self.note(_told(error))
        # Python keeps the last error that nobody caught, and with its frames the window that it came from:
        # one fault would be told a second time, as a window that is left alive.
        for name in ("last_exc", "last_type", "last_value", "last_traceback"):
            if hasattr(sys, name):
                delattr(sys, name)

    def emit(self, record: logging.LogRecord) -> None:
        """Note what the program itself calls a fault."""
        told = _told(record.exc_info[1]) if record.exc_info else ""
        self.note(f"logged: {record.getMessage()} {told}")

    def _qt_said(self, kind: QtMsgType, _context: Any, text: str) -> None:
        # What the platform without a screen cannot do says nothing about the program.
        if kind in _BAD and not text.startswith("This plugin does not support"):
            self.note(f"Qt: {text}" + (f" [{self._painted.last}]" if "Paint" in text else ""))

    def _warned(self, message: Warning | str, category: type, file: str, line: int, *_: object) -> None:
        self.note(f"{category.__name__}: {message} ({Path(file).name}:{line})")


def places_of_threads() -> str:
    """Return where each thread but this one stands, innermost call first."""
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    told = []
    for number, frame in sys._current_frames().items():
        if number != threading.get_ident():
            calls = reversed(traceback.extract_stack(frame)[-8:])
            places = " < ".join(f"{Path(call.filename).name}:{call.lineno}" for call in calls)
            told.append(f"{names.get(number, number)}: {places}")
    return "; ".join(told)


def _told(error: BaseException | None) -> str:
    """Return an error with the places that it went through."""
    if error is None:
        return "an unknown error"
    places = " < ".join(
        f"{Path(frame.filename).name}:{frame.lineno}"
        for frame in reversed(traceback.extract_tb(error.__traceback__)[-6:])
    )
    return f"{type(error).__name__}: {error} [{places}]"


def children() -> set[int]:
    """Return the processes that this one has started and that are not over."""
    found: set[int] = set()
    for task in Path(f"/proc/{os.getpid()}/task").iterdir():
        try:
            listed = (task / "children").read_text(encoding="ascii").split()
        except OSError:  # the thread has ended meanwhile
            continue
        found |= {int(number) for number in listed}
    return found


class Remains:
    """What was alive before, so that what is left later can be told."""

    def __init__(self) -> None:
        self._threads = set(threading.enumerate())
        self._children = children() if sys.platform.startswith("linux") else set()
        self._known = weakref.WeakSet(living())

    def wait(self, seconds: float = 10.0, until: Callable[[], bool] = lambda: True) -> list[str]:
        """Return what is left alive once nothing more goes away, after so many seconds at most."""
        deadline = time.monotonic() + seconds
        while True:
            delete_later_now()
            gc.collect()
            left = self._left()
            if (not left and until()) or time.monotonic() > deadline:
                return left
            time.sleep(0.05)

    def _left(self) -> list[str]:
        left = [f"thread {thread.name}" for thread in threading.enumerate() if thread not in self._threads]
        left += [repr(thing) for thing in living() if thing not in self._known]
        if sys.platform.startswith("linux"):
            left += [f"process {_command(number)}" for number in children() - self._children]
        return left


def _command(process: int) -> str:
    try:
        return Path(f"/proc/{process}/cmdline").read_text(encoding="utf-8").replace("\0", " ")[:120]
    except OSError:
        return str(process)
