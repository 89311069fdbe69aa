"""Answers of processes that outlive the program: the same work, begun again, goes on where it was ended.

A task that a pool hands out is a message, and its answer depends on nothing else. So an answer can be found
again by the SHA-256 of its question, whatever else has changed. Answers lie in a journal
(:mod:`mbstudio.core.journal_file`) beside the output, each with a mark that only the person's own mbstudio
can make; what anybody else has put there is not used.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from mbstudio.core.batch.messages import Message, receive, send
from mbstudio.core.errors import Cancelled, JournalError, MbstudioError
from mbstudio.core.journal_file import MOST_BYTES, JournalWriter, Record, read_journal
from mbstudio.core.locking import try_lock
from mbstudio.core.own_files import NO_MARK, is_own, mark_of
from mbstudio.core.version import __version__

log = logging.getLogger(__name__)

_KEY = 32
_MARK = len(NO_MARK)
_SYNC_AFTER = 0.5
_CURRENT: ContextVar[KeptAnswers | None] = ContextVar("kept_answers", default=None)


class KeptAnswers:
    """The answers that are there, and those to come; make it with :func:`keeping_answers`.

    Attributes
    ----------
    path : Path
    found : int
        How many answers an earlier run had left.
    trouble : OSError or None
        Why answers are no longer kept, if they are not.
    stays : bool
        Whether they stay though the work came to its end.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.trouble: OSError | None = None
        self.stays = False
        self._guard = threading.Lock()
        records = _own_records(path)
        self._answers = {record.content[:_KEY]: record.content[_KEY + _MARK :] for record in records}
        self.found = len(self._answers)
        self._writer = JournalWriter.create(path, _header(), [record.content for record in records])
        self._writer.lock()
        self._synced = time.monotonic()

    def find(self, question: bytes) -> Message | None:
        """Return the answer to a question, None if it is not there."""
        packed = self._answers.get(question)
        if packed is None:
            return None
        try:
            return receive(io.BytesIO(packed))
        except (EOFError, ValueError, TypeError, KeyError) as error:
            log.warning("%s holds an answer that cannot be read: %s", self.path, error)
            return None

    def keep(self, question: bytes, answer: Message) -> None:
        """Write an answer; where the disk is full, no more are written, and the work goes on."""
        packed = io.BytesIO()
        send(packed, *answer)
        content = packed.getvalue()
        if len(content) > MOST_BYTES - _KEY - _MARK:
            return
        mark = mark_of(_digest_of(question, content)).encode("ascii")
        with self._guard:
            if self.trouble is not None:
                return
            try:
                self._writer.append(question + mark + content)
                if time.monotonic() - self._synced > _SYNC_AFTER:
                    self._writer.sync()
                    self._synced = time.monotonic()
            except OSError as error:
                self.trouble = error
                log.warning("%s cannot be written: %s", self.path, error)

    def close(self) -> None:
        """Let go; what is there stays."""
        with self._guard:
            try:
                self._writer.sync()
            except OSError as error:
                log.warning("%s cannot be written: %s", self.path, error)
            self._writer.close()


def question_of(job: type, message: Message) -> bytes:
    """Return what tells a packed task of a job from all others."""
    head, arrays = message
    digest = hashlib.sha256(f"{job.__module__}:{job.__qualname__}\n".encode())
    layout = [[name, array.dtype.str, list(array.shape)] for name, array in arrays.items()]
    digest.update(json.dumps([head, layout], default=str, sort_keys=True).encode())
    for array in arrays.values():
        digest.update(array.tobytes())
    return digest.digest()


def current_answers() -> KeptAnswers | None:
    """Return where pools that are made now keep their answers."""
    return _CURRENT.get()


@contextmanager
def keeping_answers(path: Path) -> Iterator[KeptAnswers | None]:
    """Let pools that are made in this block keep their answers in a file, and use those that are there.

    The file is removed when the block ends without an error, as its output holds them all then, and where the
    work is refused. Gives None where nothing can be kept, because the folder cannot be written or another
    program uses the file.
    """
    kept = _open(path)
    token = _CURRENT.set(kept)
    try:
        yield kept
    except BaseException as error:
        if kept is not None:
            kept.close()
            # What was refused would be refused again, but for a disk that has room by then.
            refused = isinstance(error, MbstudioError) and not isinstance(error, Cancelled)
            if refused and not isinstance(error.__cause__, OSError):
                path.unlink(missing_ok=True)
        raise
    finally:
        _CURRENT.reset(token)
    if kept is not None:
        kept.close()
        if not kept.stays:
            path.unlink(missing_ok=True)


def _open(path: Path) -> KeptAnswers | None:
    try:
        if path.exists():
            with path.open("r+b") as stream:
                if try_lock(stream) is False:
                    return None
        return KeptAnswers(path)
    except OSError as error:
        log.warning("%s cannot be kept: %s", path, error)
        return None


def _header() -> bytes:
    return json.dumps({"kind": "answers", "written_by": __version__}).encode("ascii")


def _own_records(path: Path) -> list[Record]:
    """Return the whole records that this person's mbstudio of this version has written."""
    try:
        contents = read_journal(path)
    except JournalError as error:
        log.warning("%s", error)
        return []
    if contents is None or contents.header != _header():
        return []
    return [record for record in contents.records if _is_own(record.content)]


def _is_own(content: bytes) -> bool:
    question, mark, packed = content[:_KEY], content[_KEY : _KEY + _MARK], content[_KEY + _MARK :]
    return is_own(_digest_of(question, packed), mark.decode("ascii", "replace"))


def _digest_of(question: bytes, packed: bytes) -> str:
    return hashlib.sha256(question + packed).hexdigest()
