"""How much memory the machine has left, and bytes as people read them."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def free_memory() -> int | None:
    """Return the bytes of memory that new data can take without swapping; None where that is unknown."""
    if sys.platform == "win32":
        import ctypes

        class Status(ctypes.Structure):
            """What Windows fills in: MEMORYSTATUSEX."""

            _fields_ = (
                ("length", ctypes.c_uint32),
                ("load", ctypes.c_uint32),
                ("total", ctypes.c_uint64),
                ("free", ctypes.c_uint64),
                ("others", ctypes.c_uint64 * 5),
            )

        status = Status(length=ctypes.sizeof(Status))
        found = ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status))
        return int(status.free) if found else None
    try:
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):  # macOS has neither
        return None


def readable_bytes(count: float) -> str:
    """Return a number of bytes as ``448 MB``: three digits, in steps of a thousand."""
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= 0.9995 * size:
            value = count / size
            digits = 0 if value >= 99.95 else 1 if value >= 9.995 else 2
            return f"{value:.{digits}f} {unit}"
    return f"{count:.0f} bytes"
