"""Reads an HDF5 file of a stranger for :mod:`~mbstudio.core.scan.readers.hdf5.served_file`.

HDF5 can loop for ever on a file made to harm, take any amount of memory or end the process. So this file is
also a program, which is started with the name of the file and does what the lines of JSON on its standard
input ask for:

``{"do": "list"}``
    Tells all volumes of numbers that links within the file lead to.
``{"do": "find", "name": ...}``
    Tells what lies under a name.
``{"do": "read", "name": ..., "block": [[begin, end], ...]}``
    Sends a block of an array, piece by piece.

Each answer is JSON after its length in eight bytes; where it names a number of bytes, these follow. Whoever
asks bounds the time between two answers, this program its memory. It imports nothing of mbstudio, so that it
starts within a fifth of a second, and ends when nobody has asked for a while: the file is free again then.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any, BinaryIO

import h5py
import numpy as np

IDLE_SECONDS = 20
PIECE_BYTES = 32 * 2**20
"""About so much is sent at a time; whole chunks, so that none is unpacked twice."""

_MEMORY = 2 * 2**30
_OBJECTS = 200_000
_MOST_VALUES, _LONGEST_TEXT = 64, 64 * 1024
_SIGN_OF_LIFE = 2.0

Range = tuple[int, int]
Answer = tuple[dict[str, Any], bytes | memoryview]


class Server:
    """An open file and the answers about it.

    Parameters
    ----------
    path : str
    """

    def __init__(self, path: str) -> None:
        if not h5py.is_hdf5(path):
            raise ValueError("no HDF5")
        self._file = h5py.File(path, "r", locking=False)
        self._home = h5py.h5f.get_name(self._file.id)

    def answers(self, question: dict[str, Any]) -> Iterator[Answer]:
        """Yield the answers to a question: what they tell, and bytes that come with it."""
        if question["do"] == "list":
            yield from self._list()
        elif question["do"] == "find":
            yield {"found": self._find(question["name"])}, b""
        else:
            yield from self._read(question["name"], [(int(a), int(b)) for a, b in question["block"]])

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    def _list(self) -> Iterator[Answer]:
        found: dict[str, Any] = {}
        told, count = time.monotonic(), 0
        waiting = [("", self._file["/"])]
        seen = set()
        while waiting:
            place, group = waiting.pop()
            for name in group:
                link = group.get(name, getlink=True)
                if not isinstance(link, h5py.HardLink):
                    continue
                item, path = group[name], f"{place}/{name}" if place else name
                address = h5py.h5o.get_info(item.id).addr
                if address in seen:
                    continue
                seen.add(address)
                count += 1
                if count > _OBJECTS:
                    raise ValueError(f"it has more than {_OBJECTS} parts")
                if isinstance(item, h5py.Group):
                    waiting.append((path, item))
                elif isinstance(item, h5py.Dataset) and _is_volume(item):
                    found[path] = [int(n) for n in item.shape]
                if time.monotonic() - told > _SIGN_OF_LIFE:
                    told = time.monotonic()
                    yield {"going": count}, b""
        yield {"volumes": dict(sorted(found.items()))}, b""

    def _find(self, name: str) -> dict[str, Any] | None:
        link = self._file.get(name, getlink=True) if name.strip("/") else None
        if isinstance(link, h5py.ExternalLink):
            return {"kind": "elsewhere", "file": str(link.filename)}
        item = self._file.get(name)
        if item is None:
            return None
        if h5py.h5f.get_name(item.id) != self._home:  # a link on the way led there
            return {"kind": "elsewhere", "file": _shown(h5py.h5f.get_name(item.id))}
        told = {"name": item.name, "attributes": _attributes(item)}
        if not isinstance(item, h5py.Dataset):
            return told | {"kind": "group" if isinstance(item, h5py.Group) else "other"}
        layout = item.id.get_create_plist().get_layout()
        stored = None if item.is_virtual or item.external else int(item.id.get_storage_size())
        is_plain = layout == h5py.h5d.CONTIGUOUS and not item.compression and stored is not None
        return told | {
            "kind": "array",
            "dtype": item.dtype.str,
            "is_named": item.dtype.kind == "b" or bool(item.dtype.metadata),
            "shape": None if item.shape is None else [int(n) for n in item.shape],
            "stored": stored,
            "offset": item.id.get_offset() if is_plain else None,
        }

    def _read(self, name: str, block: list[Range]) -> Iterator[Answer]:
        dataset = self._file[name]
        if dataset.is_virtual or dataset.external or h5py.h5f.get_name(dataset.id) != self._home:
            raise ValueError("its data lie in another file")
        dtype = _plain(dataset.dtype)
        chunks = dataset.chunks or (1,) * len(block)
        _make_room_for(math.prod(chunks) * dtype.itemsize, int(dataset.id.get_storage_size()))
        for piece in pieces(block, chunks, dtype.itemsize):
            values = np.ascontiguousarray(dataset[tuple(slice(*ends) for ends in piece)])
            content = memoryview(values.view(dtype).reshape(-1).view(np.uint8))  # type: ignore[arg-type]
            yield {"piece": piece, "bytes": len(content)}, content
        yield {"end": True}, b""


def pieces(
    block: list[Range], chunks: tuple[int, ...], item: int, most: int = PIECE_BYTES
) -> Iterator[list[Range]]:
    """Yield the parts of a block that are read at a time, none of them through the midst of a chunk.

    Parameters
    ----------
    block : list of (int, int)
        Begin and end along each axis.
    chunks : tuple of int
    item : int
        Bytes of a value.
    most : int
        About the largest number of bytes of a part; one chunk is the least.
    """
    steps, lengths = list(chunks), [end - begin for begin, end in block]
    for axis in reversed(range(len(steps))):
        size = item * math.prod(map(min, steps, lengths))
        steps[axis] *= max(1, most // max(1, size))
    axes = []
    for step, (begin, end) in zip(steps, block, strict=True):
        ends = [begin, *range((begin // step + 1) * step, end, step), end]
        axes.append(list(itertools.pairwise(ends)))
    for piece in itertools.product(*axes):
        yield list(piece)


def _is_volume(item: h5py.Dataset) -> bool:
    return item.dtype.kind in "buif" and sum(count > 1 for count in item.shape or ()) >= 3


def _plain(dtype: np.dtype[Any]) -> np.dtype[Any]:
    if dtype.kind not in "buif":
        raise ValueError(f"it holds values of type {dtype}")
    return np.dtype(dtype.str)


def _attributes(item: h5py.Group | h5py.Dataset) -> dict[str, Any]:
    """Return the attributes that are numbers or texts, and short."""
    found: dict[str, Any] = {}
    for name in item.attrs:
        attribute = item.attrs.get_id(name)
        is_text = h5py.check_string_dtype(attribute.dtype) is not None
        if attribute.shape is None or not (is_text or attribute.dtype.kind in "buif"):
            continue
        if math.prod(attribute.shape) > _MOST_VALUES or attribute.dtype.itemsize > _LONGEST_TEXT:
            continue
        value = item.attrs[name]
        if isinstance(value, h5py.Empty):
            continue
        if isinstance(value, np.ndarray):
            found[name] = {"array": [_shown_value(one) for one in value.ravel().tolist()]}
        else:
            found[name] = _shown_value(value.item() if isinstance(value, np.generic) else value)
    return found


def _shown_value(value: Any) -> Any:
    if isinstance(value, bytes):
        return {"bytes": value[:_LONGEST_TEXT].hex()}
    return value[:_LONGEST_TEXT] if isinstance(value, str) else value


def _shown(name: bytes) -> str:
    return name.decode("utf-8", "replace")


def _make_room_for(chunk: int, stored: int) -> None:
    """Take more memory for chunks that are large and not more than a file of this size can hold."""
    if chunk <= _MEMORY // 8 or chunk > 1032 * stored:
        return
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY + 3 * chunk, hard))


def _bound_this_process() -> None:
    """Take no more memory than reading piece by piece needs; write no file."""
    try:
        import resource
    except ImportError:  # Windows: whoever asks bounds the time
        return
    for kind, bound in ((resource.RLIMIT_AS, _MEMORY), (resource.RLIMIT_FSIZE, 0), (resource.RLIMIT_CORE, 0)):
        hard = resource.getrlimit(kind)[1]
        # macOS refuses a bound on memory.
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(kind, (bound if hard == resource.RLIM_INFINITY else min(bound, hard), hard))


def _send(stream: BinaryIO, head: dict[str, Any], content: bytes | memoryview = b"") -> None:
    text = json.dumps(head).encode("ascii")
    stream.write(len(text).to_bytes(8, "big") + text)
    stream.write(content)
    stream.flush()


def main() -> None:
    """Answer what standard input asks until nobody asks any more."""
    _bound_this_process()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever prints must not end up between the answers
    server: Server | None = None
    while True:
        idle = threading.Timer(IDLE_SECONDS, os._exit, (0,))
        idle.daemon = True
        idle.start()
        line = sys.stdin.readline()
        idle.cancel()
        if not line:
            return
        try:
            server = server or Server(sys.argv[1])
            for head, content in server.answers(json.loads(line)):
                _send(answers, head, content)
        except MemoryError:
            _send(answers, {"error": "reading it takes more memory than any scan needs"})
        except Exception as error:  # whatever a damaged file leads to, it is refused
            _send(answers, {"error": str(error)[:500] or type(error).__name__})


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        main()
