"""Machine code that numba stores is never used after anything that went into it has changed.

numba compiles into a function what it calls and every constant that it reads, but looks at the function's
own file alone to see whether stored code still holds: after an update, code with old constants of another
file would give other numbers without a word. Here the name under which a function is stored stands for all
that went into it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
from numba import njit

_Function = TypeVar("_Function", bound=Callable[..., Any])

# Infinities must survive (f is infinite on a control point), so not plain ``fastmath=True``.
SAFE_MATH = {"reassoc", "contract", "arcp", "nsz", "afn"}
_PACKAGE = __name__.partition(".")[0]
_KEPT_DAYS = 30


def compiled(**options: Any) -> Callable[[_Function], _Function]:
    """Compile a function at its first call, to run without Python's lock, and store its machine code.

    Parameters
    ----------
    **options
        Passed to :func:`numba.njit`, such as ``fastmath`` and ``error_model``.
    """

    def compile_later(function: _Function) -> _Function:
        # numba makes the name of the file from this name.
        function.__qualname__ += f".{_digest(function.__module__)}"
        dispatcher = njit(cache=True, nogil=True, **options)(function)
        _remove_outdated(function.__module__, Path(dispatcher.stats.cache_path))
        return dispatcher  # type: ignore[no-any-return]

    return compile_later


@cache
def _digest(name: str) -> str:
    """Return a digest of a module and of all that its functions can have compiled into them.

    It is made when the module's first function is met: all that is imported is there by then.
    """
    module = sys.modules[name]
    parts = [Path(__file__).read_bytes(), Path(str(module.__file__)).read_bytes()]
    for word, value in sorted(vars(module).items()):
        if not word.startswith("__"):
            parts.append(f"{word}={_written(value, name)}".encode())
    return sha256(b"\0".join(parts)).hexdigest()[:12]


def _written(value: object, name: str) -> str:
    """Write a value of a module so that it reads otherwise wherever it would be compiled otherwise."""
    if isinstance(value, bool | int | float | complex | str | np.generic):
        return repr(value)
    if isinstance(value, tuple | set | frozenset):
        items = [_written(item, name) for item in value]
        return " ".join(items if isinstance(value, tuple) else sorted(items))
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}{sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, type) and issubclass(value, tuple):
        return repr(getattr(value, "_fields", ()))
    home = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
    may_be_compiled = isinstance(value, ModuleType) or hasattr(value, "py_func")
    if may_be_compiled and home != name and str(home).partition(".")[0] == _PACKAGE:
        return _digest(str(home))
    return ""


@cache
def _remove_outdated(name: str, folder: Path) -> None:
    """Remove what was stored of a module's other states and has not been written for a month."""
    oldest = time.time() - _KEPT_DAYS * 86400
    for path in folder.glob(f"{name.rpartition('.')[2]}.*.nb[ic]"):
        if _digest(name) not in path.name:
            with suppress(OSError):  # another process removes it too, or still reads it
                if path.stat().st_mtime < oldest:
                    path.unlink()
