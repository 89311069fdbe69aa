"""Which machine this is, and whether a process on it is running."""

from __future__ import annotations

import os
import socket
import sys

HOST = socket.gethostname()


def is_running(process: int) -> bool:
    """Return whether there is a process of this number on this machine, of whatever program."""
    if process <= 0:
        return False
    if sys.platform == "win32":  # there os.kill ends the process
        import ctypes

        kernel = ctypes.windll.kernel32
        handle = kernel.OpenProcess(0x1000, False, process)  # PROCESS_QUERY_LIMITED_INFORMATION
        if not handle:
            return bool(kernel.GetLastError() == 5)  # access denied: it is another person's
        code = ctypes.c_uint32()
        found = kernel.GetExitCodeProcess(handle, ctypes.byref(code))
        kernel.CloseHandle(handle)
        return bool(found) and code.value == 259  # STILL_ACTIVE
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
