"""One writer at a time: a lock beside a project file that says who works on it.

``sand.mbs.lock`` is locked by the operating system as long as its holder lives, and holds who that is as
JSON. Where the system's lock is free, its holder has ended, however that happened. Two kinds of drives do not
carry such locks from machine to machine, or know none at all: there what the file says decides, and a holder
on another machine counts as alive until the file is removed.
"""

from __future__ import annotations

import contextlib
import getpass
import json
import os
import weakref
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import IO

from mbstudio.core.errors import ProjectError, ProjectLockedError
from mbstudio.core.locking import try_lock
from mbstudio.core.processes import HOST, is_running

_ATTEMPTS = 20
_LONGEST = 4096


@dataclass(frozen=True)
class Holder:
    """Who works on a project.

    Attributes
    ----------
    program : str
        "the window", "mbstudio fit" or the like.
    user, host : str
    process : int
        Its number on that machine.
    since : str
        Date and time in UTC.
    """

    program: str
    user: str
    host: str
    process: int
    since: str

    @classmethod
    def this_one(cls, program: str) -> Holder:
        """Return who this process is."""
        try:
            user = getpass.getuser()
        except (KeyError, OSError):  # a container without names
            user = "somebody"
        return cls(program, user, HOST, os.getpid(), datetime.now(UTC).isoformat(timespec="seconds"))

    @property
    def words(self) -> str:
        """Who that is, for a message."""
        where = "" if self.host == HOST else f" on {self.host}"
        return f"{self.program} of {self.user}{where} (process {self.process}, since {self.since})"

    @property
    def may_live(self) -> bool:
        """Whether it still runs, as far as that can be told from here."""
        return self.host != HOST or is_running(self.process)


class ProjectLock:
    """The lock of one project file; make it with :meth:`take`.

    Attributes
    ----------
    path : Path
        The project file.
    """

    def __init__(self, path: Path, stream: IO[bytes]) -> None:
        self.path = path
        # Also where it is forgotten, and at the end of the program.
        self._let_go = weakref.finalize(self, _release, path, stream)

    @classmethod
    def take(cls, path: Path, program: str) -> ProjectLock:
        """Lock a project file, which need not exist yet, for writing.

        Raises
        ------
        ProjectLockedError
            If another program works on it; the message says which.
        ProjectError
            If its folder is missing or cannot be written.
        """
        place = _lock_file(path)
        try:
            for _ in range(_ATTEMPTS):
                stream = place.open("a+b")
                try:
                    taken = _is_taken(stream, place, path)
                except BaseException:
                    stream.close()
                    raise
                if not taken:  # its holder removed it just now
                    stream.close()
                    continue
                lock = cls(path.resolve(), stream)
                try:
                    _write(stream, Holder.this_one(program))
                except BaseException:  # a full disk
                    lock.release()
                    raise
                return lock
        except OSError as error:
            raise ProjectError(
                f"{path} cannot be saved ({error.strerror or error}): choose another folder, or make room."
            ) from error
        raise ProjectError(f"{path} is being saved by others all the time: try again.")

    def covers(self, path: Path) -> bool:
        """Return whether this is the lock of a file."""
        return path.resolve() == self.path

    def release(self) -> None:
        """Let others write; more than once does no harm."""
        self._let_go()

    def __enter__(self) -> ProjectLock:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def _release(path: Path, stream: IO[bytes]) -> None:
    with contextlib.suppress(OSError):  # a drive that is gone: the lock went with it
        stream.truncate(0)
        if os.name != "nt":  # while it is held, so that nobody's lock is removed but ours
            _lock_file(path).unlink(missing_ok=True)
    stream.close()
    if os.name == "nt":  # there an open file cannot be removed, not even by another holder
        with contextlib.suppress(OSError):
            _lock_file(path).unlink(missing_ok=True)


def _lock_file(path: Path) -> Path:
    target = path.resolve()
    return target.with_name(f"{target.name}.lock")


def _is_taken(stream: IO[bytes], place: Path, path: Path) -> bool:
    """Return whether the file is locked now; False if it is no longer the one of that name."""
    locked = try_lock(stream)
    holder = _read(stream)
    if locked is False:
        raise _refusal(path, holder)
    try:
        if not os.path.samestat(os.fstat(stream.fileno()), place.stat()):
            return False
    except FileNotFoundError:
        return False
    # The system's lock is free: on this machine that means that its holder has ended.
    if holder is not None and (holder.host != HOST or (locked is None and holder.may_live)):
        raise _refusal(path, holder)
    return True


def _read(stream: IO[bytes]) -> Holder | None:
    try:
        stream.seek(0)
        told = json.loads(stream.read(_LONGEST))
        return Holder(
            **{name: str(told[name]) for name in ("program", "user", "host", "since")},
            process=int(told["process"]),
        )
    except (LookupError, OSError, OverflowError, RecursionError, TypeError, ValueError):
        return None  # nothing, or half of it: whoever wrote it is just beginning or has ended


def _write(stream: IO[bytes], holder: Holder) -> None:
    stream.seek(0)
    stream.truncate(0)
    stream.write(json.dumps(asdict(holder)).encode("utf-8"))
    stream.flush()


def _refusal(path: Path, holder: Holder | None) -> ProjectLockedError:
    who = "another program" if holder is None else holder.words
    cure = ""
    if holder is not None and holder.host != HOST:
        cure = f" If nobody works on it there any more, remove {_lock_file(path).name}."
    return ProjectLockedError(
        f"{path} is in use: {who} works on it. Close it there first, or save under another name.{cure}"
    )
