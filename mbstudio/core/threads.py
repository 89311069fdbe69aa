"""One thread for linear algebra: sums over several threads would differ in their last digits."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


@cache
def _controller() -> ThreadpoolController:
    import numpy.linalg  # noqa: F401  its library must be loaded to be found
    import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


class _Blas:
    """The linear algebra library's number of threads, which all threads of the process share."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._blocks = 0
        self._limit: Any = None

    def enter(self) -> None:
        with self._lock:
            if self._blocks == 0:
                _claim_thread_control()
                self._limit = _controller().limit(limits={"blas": 1})
            self._blocks += 1

    def leave(self) -> None:
        with self._lock:
            self._blocks -= 1
            if self._blocks == 0:
                _claim_thread_control()
                self._limit.restore_original_limits()
                _claim_thread_control()


def _claim_thread_control() -> None:
    # threadpoolctl heeds the first thread alone that set a number, and ignores the others without a word.
    from threadpoolctl import OpenBLASController

    OpenBLASController.clear_controlling_thread(force=True)


_blas = _Blas()


@contextmanager
def one_thread() -> Iterator[None]:
    """Let numpy, scipy and torch compute on one thread inside the block; after it all is as it was.

    Our matrices are so small that more threads gain nothing, wait for one another where other processes
    are at work, and give other last digits on machines with another number of processors. Blocks may
    lie within one another, and overlap in several threads.
    """
    torch = sys.modules.get("torch")
    before = torch.get_num_threads() if torch is not None else 1
    _blas.enter()
    try:
        with _controller().limit(limits={"openmp": 1}):
            if torch is not None and before != 1:
                torch.set_num_threads(1)
            try:
                yield
            finally:
                if torch is not None and before != 1:
                    torch.set_num_threads(before)
    finally:
        _blas.leave()
