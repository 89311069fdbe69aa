"""Messages between a pool and its processes: a JSON head, then raw arrays."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any, BinaryIO, Protocol

import numpy as np

_LENGTH = struct.Struct("<Q")
Head = dict[str, Any]
Arrays = dict[str, np.ndarray]
Message = tuple[Head, Arrays]
"""Plain values that JSON can hold, and arrays by name."""


class Report(Protocol):
    """Takes how far work has come, from 0 to 1, what is being done, and maybe arrays: how it looks now."""

    def __call__(self, share: float, message: str, arrays: Arrays | None = None, /) -> None: ...


def unheard(_share: float, _message: str, _arrays: Arrays | None = None, /) -> None:
    """Take a report that nobody asked for."""


def send(stream: BinaryIO, head: Mapping[str, Any], arrays: Mapping[str, np.ndarray] | None = None) -> None:
    """Write one message to a pipe."""
    solid = {name: np.ascontiguousarray(array) for name, array in (arrays or {}).items()}
    layout = [[name, array.dtype.str, list(array.shape)] for name, array in solid.items()]
    text = json.dumps({"head": head, "arrays": layout}, default=_plain).encode()
    stream.write(_LENGTH.pack(len(text)) + text)
    for array in solid.values():
        stream.write(array.tobytes())
    stream.flush()


def receive(stream: BinaryIO) -> Message:
    """Read one message from a pipe; EOFError where the other side has gone."""
    (length,) = _LENGTH.unpack(_read_exactly(stream, _LENGTH.size))
    message = json.loads(_read_exactly(stream, length))
    arrays = {}
    for name, kind, shape in message["arrays"]:
        dtype = np.dtype(kind)
        count = int(np.prod(shape, dtype=np.int64))
        arrays[name] = np.frombuffer(_read_exactly(stream, count * dtype.itemsize), dtype).reshape(shape)
    return message["head"], arrays


def _read_exactly(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        raise EOFError("the other side has gone")
    return data


def _plain(value: object) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} cannot be sent to another process: give a number, a text or a list.")
