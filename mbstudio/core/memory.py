"""How much memory the machine has left."""

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
