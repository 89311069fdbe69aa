"""Locks of the operating system on open files: they go with the process that holds them, however it ends."""

from __future__ import annotations

import errno
import sys
from typing import IO

# Where a file system has no locks to give, as some network drives do not.
_NO_LOCKS = {errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL}
_FAR = 2**30


def try_lock(stream: IO[bytes]) -> bool | None:
    """Lock an open file against all other programs, and against other openings of it in this one.

    Returns
    -------
    bool or None
        True if it is locked until it is closed, False if somebody else holds it, None if the file
        system knows no locks.

    Raises
    ------
    OSError
        If it cannot be tried.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            # Windows keeps others from reading what is locked: a byte far behind the end is not missed.
            stream.seek(_FAR)
            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if isinstance(error, BlockingIOError | PermissionError):
            return False
        if error.errno in _NO_LOCKS:
            return None
        raise
    return True
