"""Writing a file so that either the old or the new one is there, whatever happens."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary file beside `path`; it takes the place of `path` when the block ends well.

    The file is flushed to the disk before it is renamed, and its folder after, so that a power
    cut leaves either the old file or the new one. When the block raises, the temporary file is
    removed and `path` is as it was. A symbolic link stays one: the file it points to is replaced.

    Raises
    ------
    OSError
        If the folder cannot be written or the disk is full.
    """
    target = path.resolve()
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    # Not tempfile.mkstemp: its files are private to the user, and a project is often shared.
    os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    try:
        if target.exists():
            temporary.chmod(target.stat().st_mode & 0o777)
        yield temporary
        flush_to_disk(temporary)
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    if os.name != "nt":  # Windows has no handle on a folder to flush
        flush_to_disk(target.parent)


def flush_to_disk(path: Path) -> None:
    """Wait until a file or folder lies on the disk."""
    # Windows flushes only what is open for writing; folders open only for reading.
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
