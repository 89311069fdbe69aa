"""Reading an HDF5 file into :class:`~mbstudio.core.project.stored.Stored`, where it can harm nothing.

A file that this person's mbstudio wrote and whose seal is whole is read in this process. Any other goes to
the program :mod:`mbstudio.core.project.hdf5_walk`, with bounds on its memory and time; HDF5 sees nothing of
it in this process. Both ways take the same steps and find the same.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from types import TracebackType
from typing import IO, Any, BinaryIO, Protocol

import numpy as np

from mbstudio.core.errors import ProjectError
from mbstudio.core.memory import free_memory
from mbstudio.core.project import hdf5_walk
from mbstudio.core.project.stored import Stored

SECONDS = 30
"""Longest time in which the reading program may say nothing."""

_LONGEST_JSON = 2**30


class _Source(Protocol):
    """Where the pieces of a file come from, in the order of `hdf5_walk`."""

    def entries(self) -> Any:
        """Return the next piece, which is JSON."""

    def block(self, length: int) -> bytes | bytearray | memoryview:
        """Return the next piece, of so many bytes."""


def read_stored(
    stream: BinaryIO,
    wanted: str,
    path: Path,
    accept: Callable[[Mapping[str, Any]], None],
    *,
    trusted: bool = False,
) -> Stored:
    """Read groups, attributes and the wanted datasets of a file.

    Parameters
    ----------
    stream : binary file
        A file that the system knows by a handle.
    wanted : str
        A dataset, or with a minus sign before it all datasets but this one.
    path : Path
        What messages call it.
    accept : callable
        Given the attributes of the root before anything else is read; it raises to refuse the file.
    trusted : bool
        Whether this person's mbstudio wrote the file.

    Raises
    ------
    ProjectError
        If the file holds something that mbstudio never writes, or more than there is memory for.
    """
    way: AbstractContextManager[_Source]
    way = nullcontext(_Here(stream, wanted)) if trusted else _Elsewhere(stream, wanted, path)
    try:
        with way as source:
            return _assemble(source, path, accept)
    except hdf5_walk.RefusedError as error:
        raise _refusal(path, str(error)) from None


def _assemble(source: _Source, path: Path, accept: Callable[[Mapping[str, Any]], None]) -> Stored:
    accept(source.entries())
    told = source.entries()
    arrays = told["arrays"]
    needed = sum(
        math.prod(arrays[name]["shape"]) * np.dtype(arrays[name]["dtype"] or object).itemsize
        for name in told["wanted"]
    )
    left = free_memory()
    if left is not None and needed > left:
        raise ProjectError(
            f"{path} holds {needed / 2**30:.1f} GiB, and this machine has {left / 2**30:.1f} GiB of memory "
            "left: close other programs, or open it on a larger machine."
        )
    read = {name: _read_array(source, arrays[name]) for name in told["wanted"]}
    if source.block(len(hdf5_walk.END)) != hdf5_walk.END:
        raise _refusal(path, "it does not end where it should")
    return Stored(told["groups"], read, {name: about["attributes"] for name, about in arrays.items()})


def _read_array(source: _Source, about: Mapping[str, Any]) -> np.ndarray:
    shape = tuple(about["shape"])
    chunks = None if about["chunks"] is None else tuple(about["chunks"])
    dtype = np.dtype(about["dtype"] or object)
    array = np.empty(shape, dtype)
    for part in hdf5_walk.blocks(shape, chunks, 0 if dtype.hasobject else dtype.itemsize):
        target = array[part]
        size = np.shape(target)
        if not dtype.hasobject:
            block = np.frombuffer(source.block(math.prod(size) * dtype.itemsize), dtype)
        else:
            block = np.empty(math.prod(size), object)
            block[:] = source.entries()
        array[part] = block.reshape(size)
    return array


class _Here:
    """The pieces of a file that is read in this process."""

    def __init__(self, stream: BinaryIO, wanted: str) -> None:
        self._pieces = hdf5_walk.walk(stream, wanted)

    def entries(self) -> Any:
        return json.loads(bytes(next(self._pieces)[8:]))

    def block(self, length: int) -> bytes | memoryview:
        piece = next(self._pieces)
        if len(piece) != length:
            raise hdf5_walk.RefusedError("a dataset is not as long as it should be")
        return piece


class _Elsewhere:
    """The pieces of a file that a program of its own reads; it is ended when it says nothing any more."""

    def __init__(self, stream: BinaryIO, wanted: str, path: Path) -> None:
        self._path = path
        stream.seek(0)
        search = os.pathsep.join(entry for entry in sys.path if entry)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-S", hdf5_walk.__file__, wanted],
                stdin=stream,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                # No plug-ins: a file would be unpacked by a filter that it names itself.
                env={
                    **os.environ,
                    "PYTHONPATH": search,
                    "HDF5_PLUGIN_PRELOAD": "::",
                    "OPENBLAS_NUM_THREADS": "1",
                },
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            raise ProjectError(
                f"{path} was not written by your mbstudio, and the program that reads such files safely "
                f"cannot be started ({error}): install mbstudio into a Python of its own."
            ) from error
        self._heard = time.monotonic()
        self._was_late = False
        self._over = threading.Event()
        self._watch = threading.Thread(target=self._end_if_silent, name="Reading a project", daemon=True)

    def __enter__(self) -> _Elsewhere:
        self._watch.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._process.kill()
        self._process.wait()
        self._watch.join()
        for pipe in (self._process.stdout, self._process.stderr):
            _open(pipe).close()

    def entries(self) -> Any:
        length = int.from_bytes(self.block(8), "big")
        if length > _LONGEST_JSON:
            raise _refusal(self._path, "its texts are too long")
        return json.loads(self.block(length))

    def block(self, length: int) -> bytearray:
        content = bytearray(length)
        view = memoryview(content)
        while view:
            count = _open(self._process.stdout).readinto(view)  # type: ignore[attr-defined]
            if not count:
                raise _refusal(self._path, self._reason())
            self._heard = time.monotonic()
            view = view[count:]
        return content

    def _end_if_silent(self) -> None:
        while not self._over.wait(0.5):
            if time.monotonic() - self._heard > SECONDS:
                self._was_late = True
                self._process.kill()
                return

    def _reason(self) -> str:
        """Return why the program said nothing more."""
        told = _open(self._process.stderr).read().decode("utf-8", "replace").strip()
        code = self._process.wait()
        if self._was_late:
            return f"reading it came to no end within {SECONDS} s"
        if code == hdf5_walk.REFUSED:
            return told
        return f"reading it ended the program that tried (code {code}{': ' if told else ''}{told[-200:]})"


def _open(pipe: IO[bytes] | None) -> IO[bytes]:
    assert pipe is not None  # Popen was asked for it
    return pipe


def _refusal(path: Path, reason: str) -> ProjectError:
    return ProjectError(
        f"{path} is not an mbstudio project, or it is damaged ({reason}). Nothing of it was taken: "
        "open a copy that was saved earlier, or copy it here again."
    )
