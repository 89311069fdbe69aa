"""How many processes may work at once."""

from __future__ import annotations

import os

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
