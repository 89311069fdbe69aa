"""Writing a file so that either the old or the new one is there, whatever happens."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import secrets
import shutil
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mbstudio.core.processes import HOST, is_running

_DAY = 24 * 3600.0
# Machine, process, chance: by these the next save knows what a killed one has left.
_BESIDE = re.compile(r"\..+\.(?:(?P<host>[0-9a-f]{8})-(?P<process>\d{1,10})-)?[0-9a-f]{8}\.part")
_ASIDE = re.compile(r"\.(?P<name>.+)\.(?:(?P<host>[0-9a-f]{8})-(?P<process>\d{1,10})-)?[0-9a-f]{8}\.old")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary file beside `path`; it takes the place of `path` when the block ends well.

    The file is flushed to the disk before it is renamed, and its folder after, so that a power
    cut leaves either the old file or the new one. When the block raises, the temporary file is
    removed and `path` is as it was. A symbolic link stays one: the file it points to is replaced.
    What killed programs have left in the folder is removed first.

    Raises
    ------
    OSError
        If the folder cannot be written or the disk is full; it names `path`.
    """
    target = path.resolve()
    remove_leftovers(target.parent)
    temporary = name_beside(target)
    # Not tempfile.mkstemp: its files are private to the user, and a project is often shared.
    os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    try:
        if target.exists():
            temporary.chmod(target.stat().st_mode & 0o777)
        yield temporary
        flush_to_disk(temporary)
        temporary.replace(target)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise _naming(path, temporary, error) from error
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    flush_folder(target.parent)


def _naming(path: Path, temporary: Path, error: OSError) -> OSError:
    """Return an error of the system that names the file which somebody knows, not the one beside it."""
    of_another = error.filename is not None and not str(error.filename).startswith(str(temporary))
    if error.errno is None or of_another:
        return error
    return OSError(error.errno, error.strerror or os.strerror(error.errno), str(path))


def name_beside(path: Path) -> Path:
    """Return a name for what is not whole yet, beside its place; `remove_leftovers` knows it again."""
    return path.with_name(f".{path.name}.{_host()}-{os.getpid()}-{secrets.token_hex(4)}.part")


def name_aside(path: Path) -> Path:
    """Return a name for what makes room for something new, beside its place; `find_aside` knows it again.

    It is not cleared away by itself: until the new one is in its place, it is the only one.
    """
    return name_beside(path).with_suffix(".old")


def find_aside(path: Path) -> list[Path]:
    """Return what a program that was killed had moved aside to make room at `path`."""
    found = []
    with contextlib.suppress(OSError):
        for entry in os.scandir(path.parent):
            match = _ASIDE.fullmatch(entry.name)
            if match is not None and match["name"] == path.name and _is_left(match, entry):
                found.append(Path(entry.path))
    return sorted(found)


def restore_folder(path: Path) -> None:
    """Bring a folder back that was moved aside by a program that was killed before the new one was there.

    Raises
    ------
    OSError
        If it cannot be moved.
    """
    target = path.resolve()
    for aside in find_aside(target):
        if target.exists():
            shutil.rmtree(aside, ignore_errors=True)
        else:
            aside.rename(target)


def remove_leftovers(folder: Path) -> None:
    """Remove what programs that were killed while they wrote have left in a folder.

    Only names of `name_beside` count, of a process on this machine that has ended, or of any after a day.
    What cannot be removed stays: the write that follows tells what is wrong with the folder.
    """
    with contextlib.suppress(OSError):
        for entry in os.scandir(folder):
            match = _BESIDE.fullmatch(entry.name)
            if match is None or not _is_left(match, entry):
                continue
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path, ignore_errors=True)
            else:
                Path(entry.path).unlink(missing_ok=True)


def _host() -> str:
    return f"{zlib.crc32(HOST.encode('utf-8', 'surrogateescape')):08x}"


def _is_left(match: re.Match[str], entry: os.DirEntry[str]) -> bool:
    if match["host"] == _host() and not is_running(int(match["process"])):
        return True
    return time.time() - entry.stat(follow_symlinks=False).st_mtime > _DAY


@contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """Give a temporary folder beside `path`; it takes the place of `path` when the block ends well.

    A folder that is there already is moved aside, and removed once the new one is in its place. When
    the block raises, the temporary folder is removed and `path` is as it was.

    Raises
    ------
    OSError
        If the folder cannot be written or the disk is full.
    """
    target = path.resolve()
    restore_folder(target)
    remove_leftovers(target.parent)
    temporary = name_beside(target)
    temporary.mkdir()
    try:
        yield temporary
        for file in temporary.rglob("*"):
            flush_to_disk(file)
        if target.exists():
            old = name_aside(target)
            target.rename(old)
            try:
                temporary.rename(target)
            except OSError:
                old.rename(target)
                raise
            shutil.rmtree(old)
        else:
            temporary.rename(target)
    except OSError as error:
        shutil.rmtree(temporary, ignore_errors=True)
        raise _naming(path, temporary, error) from error
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    flush_folder(target.parent)


def flush_folder(folder: Path) -> None:
    """Wait until it lies on the disk which files a folder holds."""
    if os.name != "nt":  # Windows has no handle on a folder to flush
        flush_to_disk(folder)


def free_name(path: Path) -> Path:
    """Return a name beside `path` that nothing has: the same with the first free number behind it."""
    return next(
        place for number in itertools.count(1) if not os.path.lexists(place := Path(f"{path}.{number}"))
    )


def flush_to_disk(path: Path) -> None:
    """Wait until a file or folder lies on the disk."""
    # Windows flushes only what is open for writing; folders open only for reading.
    if path.is_dir() and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
