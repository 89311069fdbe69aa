"""Messages between a process and the children that it started: a JSON head, then raw arrays."""

from __future__ import annotations

import json
import os
import struct
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

_LENGTH = struct.Struct("<Q")
_ROOT = str(Path(__file__).resolve().parents[3])
"""Folder that holds this very package ``mbstudio``."""


def child_command(module: str) -> list[str]:
    """Return the command that runs ``serve()`` of a module of mbstudio in another Python."""
    return [sys.executable, "-P", "-c", f"from {module} import serve; serve()"]


def child_environment(**variables: str) -> dict[str, str]:
    """Return an environment in which a child finds this same mbstudio, installed or not."""
    paths = os.pathsep.join(path for path in (_ROOT, os.environ.get("PYTHONPATH", "")) if path)
    return {**os.environ, **variables, "PYTHONPATH": paths}


def send(stream: BinaryIO, head: Mapping[str, Any], arrays: Mapping[str, np.ndarray] | None = None) -> None:
    """Write one message to a pipe."""
    solid = {name: np.ascontiguousarray(array) for name, array in (arrays or {}).items()}
    layout = [[name, array.dtype.str, list(array.shape)] for name, array in solid.items()]
    text = json.dumps({"head": head, "arrays": layout}, default=_plain).encode()
    stream.write(_LENGTH.pack(len(text)) + text)
    for array in solid.values():
        stream.write(array.tobytes())
    stream.flush()


def receive(stream: BinaryIO) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read one message from a pipe; EOFError where the other side has gone."""
    (length,) = _LENGTH.unpack(_exactly(stream, _LENGTH.size))
    message = json.loads(_exactly(stream, length))
    arrays = {}
    for name, kind, shape in message["arrays"]:
        dtype = np.dtype(kind)
        count = int(np.prod(shape, dtype=np.int64))
        arrays[name] = np.frombuffer(_exactly(stream, count * dtype.itemsize), dtype).reshape(shape)
    return message["head"], arrays


def answer_requests(answer: Callable[[BinaryIO, dict[str, Any], dict[str, np.ndarray]], None]) -> None:
    """Let ``answer(stream, head, arrays)`` answer each message on stdin, until the caller closes the pipe."""
    # Whatever prints must not end up between the messages.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    requests = sys.stdin.buffer
    while True:
        try:
            head, arrays = receive(requests)
        except EOFError:
            return
        answer(answers, head, arrays)


def _exactly(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        raise EOFError("the other side has gone")
    return data


def _plain(value: object) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} cannot be sent to another process: give a number, a text or a list.")
