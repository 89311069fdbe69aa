"""An append-only file of records that outlives its writer: what was appended whole is there afterwards.

The file begins with a line of text. Records follow, each a head of 20 bytes (a mark, the length of what it
holds, its number, and the CRC-32 of these), a SHA-256 of 32 bytes, and what it holds. The SHA-256 covers the
head and that of the first record, which names the journal, so that a record of another journal, a record
that was moved and any bit that flipped are recognised. What follows the last whole record and can be the
beginning of one was being written when the writer ended: it never counted and is dropped.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mbstudio.core.errors import JournalError
from mbstudio.core.locking import try_lock
from mbstudio.core.replacement import replacing

_BEGIN = b"MetaBall Studio, journal 1\n"
_MARK = b"\xa7rec"
_HEAD = struct.Struct("<4sIQI")
_CHECKED = _HEAD.size - 4  # bytes of the head that its CRC covers
_DIGEST = 32
MOST_BYTES = 16 << 20
"""What one record can hold."""
MOST_IN_FILE = 4 << 30
_MOST_CANDIDATES = 10_000  # marks that are tried behind damage: more are no accident


@dataclass(frozen=True)
class Record:
    """One record.

    Attributes
    ----------
    content : bytes
    digest : bytes
        SHA-256 that no other record of any journal has.
    """

    content: bytes
    digest: bytes


@dataclass(frozen=True)
class Contents:
    """What a journal holds.

    Attributes
    ----------
    header : bytes
        The first record: what the journal belongs to.
    records : tuple of Record
        All others that are whole, in their order.
    damaged : int
        How many places are not as they were written; one place can have cost several records.
    """

    header: bytes
    records: tuple[Record, ...]
    damaged: int


def read_journal(path: Path) -> Contents | None:
    """Read a journal; None if there is none.

    Raises
    ------
    JournalError
        If the file is no journal, its beginning is damaged, or it cannot be read.
    """
    try:
        if not os.path.lexists(path):
            return None
        if not path.is_file() or path.stat().st_size > MOST_IN_FILE:
            raise JournalError(f"{path} is no journal of finished grains: move it elsewhere.")
        data = path.read_bytes()
    except FileNotFoundError:  # removed just now
        return None
    except OSError as error:
        raise JournalError(f"{path} cannot be read ({error.strerror or error}).") from error
    first = _whole_at(data, len(_BEGIN), b"") if data.startswith(_BEGIN) else None
    if first is None or first[0] != 0:
        raise JournalError(
            f"{path} is no journal of finished grains, or its beginning is damaged: nothing of it was read. "
            "Move it elsewhere."
        )
    _, header, end = first
    return _read_on(data, header, end)


def _read_on(data: bytes, header: Record, place: int) -> Contents:
    records: list[Record] = []
    damaged, following = 0, 1
    while place < len(data):
        found = _whole_at(data, place, header.digest)
        if found is None:
            if _is_torn(data, place):
                break
            damaged += 1
            place = _next_whole(data, place + 1, header.digest)
            continue
        number, record, place = found
        if number > following and damaged == 0:  # cut out, with nothing left in its place
            damaged += 1
        if number >= following:  # a copy of one that was read says nothing new
            records.append(record)
            following = number + 1
    return Contents(header.content, tuple(records), damaged)


def _whole_at(data: bytes, place: int, key: bytes) -> tuple[int, Record, int] | None:
    """Return number, record and end of the whole record at a place, if there is one."""
    head = data[place : place + _HEAD.size]
    length, number = _read_head(head) or (-1, 0)
    start = place + _HEAD.size + _DIGEST
    if length < 0 or start + length > len(data):
        return None
    digest, content = data[start - _DIGEST : start], data[start : start + length]
    if _digest(key, head, content) != digest:
        return None
    return number, Record(content, digest), start + length


def _read_head(head: bytes) -> tuple[int, int] | None:
    """Return length and number of a head that is whole."""
    if len(head) < _HEAD.size:
        return None
    mark, length, number, checksum = _HEAD.unpack(head)
    if mark != _MARK or length > MOST_BYTES or zlib.crc32(head[:_CHECKED]) != checksum:
        return None
    return length, number


def _is_torn(data: bytes, place: int) -> bool:
    """Return whether what lies from here to the end can be what a writer that ended had begun."""
    rest = data[place : place + _HEAD.size]
    if len(rest) < _HEAD.size:
        return True
    told = _read_head(rest)
    if told is not None:
        return place + _HEAD.size + _DIGEST + told[0] > len(data)
    return not any(data[place:])  # room that the system gave before it lost its power


def _next_whole(data: bytes, place: int, key: bytes) -> int:
    """Return where the next whole record begins, or the end."""
    for _ in range(_MOST_CANDIDATES):
        place = data.find(_MARK, place)
        if place < 0:
            break
        if _whole_at(data, place, key) is not None:
            return place
        place += 1
    return len(data)


def _digest(key: bytes, head: bytes, content: bytes) -> bytes:
    return hashlib.sha256(key + head[:_CHECKED] + content).digest()


def _frame(content: bytes, number: int, key: bytes) -> tuple[bytes, bytes]:
    """Return a record as it lies in the file, and its digest."""
    if len(content) > MOST_BYTES:
        raise JournalError(f"A record of {len(content)} bytes is too long for a journal.")
    checked = _HEAD.pack(_MARK, len(content), number, 0)[:_CHECKED]
    head = checked + struct.pack("<I", zlib.crc32(checked))
    digest = _digest(key, head, content)
    return head + digest + content, digest


class JournalWriter:
    """Appends to a journal; make it with :meth:`create`.

    What :meth:`append` has written outlives the process at once, and a failure of power or system from the
    next :meth:`sync` on.
    """

    def __init__(self, path: Path, stream: BinaryIO, key: bytes, following: int, end: int) -> None:
        self.path = path
        self._stream, self._key, self._following, self._end = stream, key, following, end

    @classmethod
    def create(cls, path: Path, header: bytes, contents: Sequence[bytes] = ()) -> JournalWriter:
        """Begin a journal in place of what lies there; it is whole from its first moment on.

        Parameters
        ----------
        path : Path
        header : bytes
            What it belongs to.
        contents : sequence of bytes
            What it holds from the beginning.

        Raises
        ------
        OSError
            If it cannot be written; what lay there stays.
        """
        first, key = _frame(header, 0, b"")
        frames = [_BEGIN, first]
        frames += [_frame(content, number, key)[0] for number, content in enumerate(contents, start=1)]
        with replacing(path) as temporary, temporary.open("wb") as stream:
            stream.writelines(frames)
        opened = path.open("r+b", buffering=0)
        return cls(path, opened, key, len(contents) + 1, opened.seek(0, os.SEEK_END))

    def append(self, content: bytes) -> bytes:
        """Write a record and return its digest.

        Raises
        ------
        OSError
            If the disk is full or gone: then nothing of the record stays.
        JournalError
            If it is too long.
        """
        frame, digest = _frame(content, self._following, self._key)
        try:
            self._stream.seek(self._end)
            rest = memoryview(frame)
            while rest:
                rest = rest[self._stream.write(rest) :]
        except BaseException:
            with contextlib.suppress(OSError):  # otherwise it is overwritten next, or dropped as torn
                self._stream.truncate(self._end)
            raise
        self._end += len(frame)
        self._following += 1
        return digest

    def sync(self) -> None:
        """Wait until all that was appended lies on the disk; OSError if it does not get there."""
        os.fsync(self._stream.fileno())

    def lock(self) -> bool | None:
        """Lock the file against other programs until it is closed; returns what `try_lock` does."""
        return try_lock(self._stream)

    def close(self) -> None:
        """Let go of the file."""
        self._stream.close()
