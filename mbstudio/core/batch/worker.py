"""The process that fits one grain after another for :func:`mbstudio.core.batch.fit_many`.

It talks in length-prefixed pickles over its standard input and output, so that it needs nothing
of the caller's ``__main__`` and works from a window's thread, a test or a bare script alike.
"""

from __future__ import annotations

import pickle
import struct
from dataclasses import dataclass, replace
from typing import Any, BinaryIO

import numpy as np

from mbstudio.core.errors import MbstudioError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.units import VoxelSize

_HEADER = struct.Struct("<Q")


@dataclass(frozen=True, eq=False)
class Task:
    """One grain to fit: its mask as packed bits, and what to do with it."""

    bits: bytes
    shape: tuple[int, int, int]
    voxel_size: VoxelSize
    origin: tuple[float, float, float]
    label: int | None
    touches_border: bool
    name: str
    n: int
    method: str
    seed: int
    options: dict[str, Any]

    @classmethod
    def of(cls, grain: Grain, n: int, method: str, seed: int, options: dict[str, Any]) -> Task:
        mask = np.asarray(grain.mask).astype(bool)
        shape = (mask.shape[0], mask.shape[1], mask.shape[2])
        return cls(
            np.packbits(mask).tobytes(), shape, grain.voxel_size, grain.origin, grain.label,
            grain.touches_border, grain.name, n, method, seed, options,
        )  # fmt: skip

    def grain(self) -> Grain:
        bits = np.unpackbits(np.frombuffer(self.bits, dtype=np.uint8), count=int(np.prod(self.shape)))
        return Grain(
            bits.reshape(self.shape).astype(bool),
            self.voxel_size,
            self.origin,
            self.label,
            self.touches_border,
            self.name,
        )


def send(stream: BinaryIO, message: object) -> None:
    """Write one message to a pipe."""
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    stream.write(_HEADER.pack(len(data)))
    stream.write(data)
    stream.flush()


def receive(stream: BinaryIO) -> Any:
    """Read one message from a pipe; EOFError where the other side has gone."""
    header = stream.read(_HEADER.size)
    if len(header) < _HEADER.size:
        raise EOFError("the other side has gone")
    (size,) = _HEADER.unpack(header)
    data = stream.read(size)
    if len(data) < size:
        raise EOFError("the other side has gone")
    return pickle.loads(data)


def run_task(
    grain: Grain, n: int, method: str, seed: int, options: dict[str, Any]
) -> tuple[FitResult | None, str | None]:
    """Fit one grain; return the result, or what went wrong: one bad grain must not end a batch.

    A grain that holds at least half of n control points, but not n, gets as many as it can hold:
    a scan always has fragments among its grains.
    """
    from mbstudio.core.imaging import fit
    from mbstudio.core.imaging.run import TooManyControlPoints

    try:
        try:
            return fit(grain, n, method, seed, **options), None  # type: ignore[arg-type]
        except TooManyControlPoints as error:
            if 2 * error.most < n:
                raise
            result = fit(grain, error.most, method, seed, **options)  # type: ignore[arg-type]
            return replace(result, n=n), None
    except MbstudioError as error:
        return None, str(error)
    except (ArithmeticError, ValueError, IndexError, MemoryError, RuntimeError) as error:
        return None, f"Grain '{grain.name}' could not be fitted: {type(error).__name__}: {error}."


def serve() -> None:
    """Fit grains until the caller closes the pipe."""
    import os
    import sys

    # Whatever prints must not end up between the messages.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    requests = sys.stdin.buffer
    while True:
        try:
            task = receive(requests)
        except EOFError:
            return
        send(answers, run_task(task.grain(), task.n, task.method, task.seed, task.options))
