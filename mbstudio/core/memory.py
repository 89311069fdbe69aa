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
                left = int(line.split()[1]) * 1024
                allowed = left_in_control_groups()
                return left if allowed is None else min(left, allowed)
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):  # macOS has neither
        return None


def left_in_control_groups(
    root: Path = Path("/sys/fs/cgroup"), own: Path = Path("/proc/self/cgroup")
) -> int | None:
    """Return the bytes that the container or job of this process may still take; None without a limit.

    Parameters
    ----------
    root : Path
        Where Linux shows its control groups, of version 1 or 2.
    own : Path
        The groups of this process.
    """
    try:
        lines = own.read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    left: list[int] = []
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers == "":
            left += _left_along(root, path, ("memory.max", "memory.current", "inactive_file"))
        elif "memory" in controllers.split(","):
            names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
            left += _left_along(root / "memory", path, names)
    return min(left) if left else None


def _left_along(root: Path, path: str, names: tuple[str, str, str]) -> list[int]:
    """Return what is left in a group and in those around it, where they have a limit."""
    most, taken, reclaimable = names
    group = root / path.strip("/")
    found = []
    for folder in (group, *group.parents):
        try:
            limit, used = ((folder / name).read_text(encoding="ascii").strip() for name in (most, taken))
            stat = dict(
                line.split() for line in (folder / "memory.stat").read_text(encoding="ascii").splitlines()
            )
            if limit != "max":
                # Pages of files are given back when they are needed.
                found.append(max(0, int(limit) - int(used) + int(stat.get(reclaimable, 0))))
        except (OSError, ValueError):  # a container does not see the groups around its own
            pass
        if folder == root:
            break
    return found


def readable_bytes(count: float, digits: int = 3) -> str:
    """Return a number of bytes with so many digits, in steps of a thousand: ``448 MB``, ``1.07 GB``."""
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size * (1 - 0.5 * 10.0**-digits):
            value = count / size
            before = len(str(int(value * (1 + 0.5 * 10.0**-digits))))
            return f"{value:.{max(0, digits - before)}f} {unit}"
    return f"{count:.0f} bytes"
