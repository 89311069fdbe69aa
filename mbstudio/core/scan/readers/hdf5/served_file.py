"""An HDF5 file as another process tells of it: this one never has HDF5 look at a stranger's file."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from mbstudio.core.errors import ScanError

# Not imported: it would bring h5py along.
PROGRAM = Path(__file__).with_name("server.py")
SECONDS = 30
"""Longest time in which the other process may say nothing."""

_LONGEST_JSON = 2**28


@dataclass(frozen=True)
class Part:
    """What lies under a name in the file.

    Attributes
    ----------
    kind : str
        'group', 'array', 'elsewhere' for what lies in another file, or 'other'.
    name : str
    attributes : dict
        Numbers, texts, bytes, and arrays of these.
    dtype : numpy dtype
    shape : tuple of int or None
    stored : int or None
        Bytes in the file; None where an array lies in other files.
    offset : int or None
        Where an array lies in the file as it is in memory, if it does.
    is_named : bool
        Whether its numbers stand for words or truth values.
    file : str
        The other file.
    """

    kind: str
    name: str = ""
    attributes: dict[str, Any] = field(default_factory=dict)
    dtype: np.dtype[Any] = field(default_factory=lambda: np.dtype("u1"))
    shape: tuple[int, ...] | None = None
    stored: int | None = None
    offset: int | None = None
    is_named: bool = False
    file: str = ""

    @property
    def parent(self) -> str:
        """Name of the group that it lies in."""
        return self.name.rpartition("/")[0] or "/"


class ServedFile:
    """An HDF5 file that a process of its own reads.

    The process is started when something is asked, and again if it has ended meanwhile; it goes with this
    object.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._process: _Process | None = None

    def volumes(self) -> dict[str, tuple[int, ...]]:
        """Return shapes of the arrays of numbers that have three axes longer than one, by their names."""
        found = {}
        for answer, _ in self._ask({"do": "list"}):
            found = answer.get("volumes", {})
        return {str(name): tuple(map(int, shape)) for name, shape in found.items()}

    def find(self, name: str) -> Part | None:
        """Return what lies under a name; None if there is nothing."""
        told: Any = None
        for answer, _ in self._ask({"do": "find", "name": name}):
            told = answer["found"]
        if told is None:
            return None
        shape = told.get("shape")
        return Part(
            kind=str(told["kind"]),
            name=str(told.get("name", "")),
            attributes={key: _value(one) for key, one in told.get("attributes", {}).items()},
            dtype=_dtype(told["dtype"]) if "dtype" in told else np.dtype("u1"),
            shape=None if shape is None else tuple(map(int, shape)),
            stored=told.get("stored"),
            offset=told.get("offset"),
            is_named=bool(told.get("is_named")),
            file=str(told.get("file", "")),
        )

    def read(self, part: Part, block: tuple[slice, ...]) -> np.ndarray:
        """Return a block of an array; the ends of all slices lie within it."""
        begins = [one.start for one in block]
        values = np.empty([one.stop - one.start for one in block], part.dtype)
        missing = values.size
        question = {"do": "read", "name": part.name, "block": [[one.start, one.stop] for one in block]}
        for answer, content in self._ask(question):
            if "piece" not in answer:
                continue
            ends = [(a - begin, b - begin) for (a, b), begin in zip(answer["piece"], begins, strict=True)]
            target = values[tuple(slice(*pair) for pair in ends)]
            if len(content) != target.nbytes:
                raise self._damaged("a part of it is not as long as it should be")
            target[...] = np.frombuffer(content, part.dtype).reshape(target.shape)
            missing -= target.size
        if missing:
            raise self._damaged("it does not hold all that it claims to")
        return values

    def close(self) -> None:
        """End the process; the next question starts another."""
        with self._lock:
            self._forget_process()

    def _forget_process(self) -> None:
        if self._process is not None:
            self._process.end()
            self._process = None

    def _ask(self, question: dict[str, Any]) -> Iterator[tuple[dict[str, Any], bytes | bytearray]]:
        with self._lock:
            for is_last in (False, True):
                fresh = self._process is None
                if self._process is None:
                    self._process = _Process(self._path)
                    weakref.finalize(self, self._process.end)
                try:
                    first = self._process.ask(question)
                except _OverError as error:
                    # One that had waited for long may have ended in peace.
                    is_over = fresh or is_last or self._process.was_late
                    self._forget_process()
                    if is_over:
                        raise self._damaged(str(error)) from None
                    continue
                break
            try:
                yield from self._rest(first)
            except _OverError as error:
                self._forget_process()
                raise self._damaged(str(error)) from None
            except GeneratorExit:  # whoever asked did not wait for the end: nothing may come in between
                self._forget_process()
                raise

    def _rest(
        self, first: tuple[dict[str, Any], bytes | bytearray]
    ) -> Iterator[tuple[dict[str, Any], bytes | bytearray]]:
        answer, content = first
        while True:
            if "error" in answer:
                raise self._damaged(str(answer["error"]))
            yield answer, content
            if "piece" not in answer and "going" not in answer:
                return
            assert self._process is not None  # the lock is held
            answer, content = self._process.answer()

    def _damaged(self, reason: str) -> ScanError:
        reason = " ".join(reason.split())
        return ScanError(
            f"{self._path} cannot be read as HDF5 ({reason}): it is damaged or cut off; "
            "copy or export it again."
        )


class _OverError(Exception):
    """The process says nothing more; the message says why."""


class _Process:
    """The program that reads; it is ended when it says nothing for too long."""

    def __init__(self, path: Path) -> None:
        search = os.pathsep.join(entry for entry in sys.path if entry)
        try:
            self._program = subprocess.Popen(
                [sys.executable, "-P", "-S", str(PROGRAM), str(path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": search, "OPENBLAS_NUM_THREADS": "1"},
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            raise ScanError(
                f"{path} cannot be read: the program that reads HDF5 safely cannot be started ({error})."
            ) from error
        self.was_late = False

    def ask(self, question: dict[str, Any]) -> tuple[dict[str, Any], bytes | bytearray]:
        """Ask something and return the first answer."""
        try:
            pipe = _open(self._program.stdin)
            pipe.write((json.dumps(question) + "\n").encode("ascii"))
            pipe.flush()
        except OSError:
            raise _OverError("the program that reads it has ended") from None
        return self.answer()

    def answer(self) -> tuple[dict[str, Any], bytes | bytearray]:
        """Return the next answer with the bytes that belong to it."""
        watch = threading.Timer(SECONDS, self._end_late)
        watch.daemon = True
        watch.start()
        try:
            length = int.from_bytes(self._bytes(8), "big")
            if length > _LONGEST_JSON:
                raise _OverError("its texts are too long")
            told: dict[str, Any] = json.loads(self._bytes(length))
            return told, self._bytes(int(told.get("bytes", 0)))
        finally:
            watch.cancel()

    def end(self) -> None:
        """End the program."""
        self._program.kill()
        self._program.wait()
        for pipe in (self._program.stdin, self._program.stdout):
            _close(pipe)

    def _end_late(self) -> None:
        self.was_late = True
        self._program.kill()

    def _bytes(self, length: int) -> bytearray:
        content = bytearray(length)
        view = memoryview(content)
        while view:
            count = _open(self._program.stdout).readinto(view)  # type: ignore[attr-defined]
            if not count:
                raise _OverError(self._reason())
            view = view[count:]
        return content

    def _reason(self) -> str:
        code = self._program.wait()
        if self.was_late:
            return f"reading it came to no end within {SECONDS} s"
        return f"reading it ended the program that tried, code {code}"


def _open(pipe: IO[bytes] | None) -> IO[bytes]:
    assert pipe is not None  # Popen was asked for it
    return pipe


def _close(pipe: IO[bytes] | None) -> None:
    try:
        _open(pipe).close()
    except OSError:  # what was still to be written has nobody to read it
        return


def _dtype(words: str) -> np.dtype[Any]:
    """Return a type by its name; one that is no number becomes one byte of anything."""
    try:
        return np.dtype(words)
    except TypeError:
        return np.dtype("V1")


def _value(told: Any) -> Any:
    if isinstance(told, dict) and "bytes" in told:
        return bytes.fromhex(told["bytes"])
    if isinstance(told, dict):
        items = [_value(one) for one in told["array"]]
        if all(isinstance(one, int | float) for one in items):
            return np.array(items)
        found = np.empty(len(items), object)
        found[:] = items
        return found
    return told
