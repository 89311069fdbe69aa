"""Unpacking voxels, never more of them than a header states, with every checksum compared."""

from __future__ import annotations

import bz2
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Shaped, UInt8

from mbstudio.core.errors import ScanError

_CHUNK = 2**20
# What zlib is told to expect: a zlib stream, a gzip one, or either.
_WINDOW = {"zlib": 15, "gzip": 31, "zlib or gzip": 47}


def unpacked(
    stream: BinaryIO, packing: str, needed: int, path: Path, length: int | None = None, *, spare: int = 0
) -> UInt8[np.ndarray, "n"]:
    """Return the bytes that a packed stream holds, which must be as many as needed.

    Parameters
    ----------
    stream : binary file
        At the first packed byte.
    packing : str
        ``zlib``, ``gzip``, ``zlib or gzip`` or ``bzip2``. Of the last three, several may follow each other.
    needed : int
        Bytes; no more than these are unpacked. The caller has seen to it that there is memory for them.
    path : Path
        The file to name in messages.
    length : int, optional
        How many packed bytes there are; else all to the end of the file.
    spare : int
        How many bytes may follow those that are needed. They are unpacked for the checksum behind them, and
        left out.

    Raises
    ------
    ScanError
        If it is damaged (a checksum is wrong) or cut off, or holds more or fewer bytes.
    """

    def begin() -> Any:
        return bz2.BZ2Decompressor() if packing == "bzip2" else zlib.decompressobj(_WINDOW[packing])

    out = np.empty(needed, np.uint8)
    inflate, done, left = begin(), 0, length
    ended, waiting, more = False, b"", 0
    try:
        while True:
            if not waiting and (ended or getattr(inflate, "needs_input", True)):
                waiting = stream.read(_CHUNK if left is None else min(_CHUNK, left))
                left = None if left is None else left - len(waiting)
                if not waiting:
                    break
            if ended:
                # Zeros and line ends behind a stream are filling; another stream goes on.
                waiting = waiting.lstrip(b"\0\r\n \t")
                if not waiting:
                    continue
                if packing == "zlib" or not _begins_again(waiting):
                    break
                inflate, ended = begin(), False
            # One more than needed, so that more is noticed and not unpacked.
            part = inflate.decompress(waiting, needed - done + 1 if done < needed else _CHUNK)
            used = min(len(part), needed - done)
            more += len(part) - used
            if more > spare:
                raise _wrong_length(path, "more", needed)
            out[done : done + used] = np.frombuffer(part, np.uint8, used)
            done += used
            ended = inflate.eof
            waiting = inflate.unused_data if ended else getattr(inflate, "unconsumed_tail", b"")
    except (zlib.error, OSError, EOFError, ValueError) as error:
        raise ScanError(
            f"{path} is damaged: its packed voxels cannot be unpacked ({error}); copy or export it again."
        ) from error
    if done < needed or not ended:
        raise _wrong_length(path, "fewer", needed)
    return out


def inflated(data: bytes, size: int, window: str) -> bytes:
    """Unpack up to one byte more than there should be, and compare the checksum that stands behind them.

    Parameters
    ----------
    data : bytes
    size : int
        Bytes that there should be.
    window : str
        ``zlib``, ``gzip`` or ``zlib or gzip``.

    Raises
    ------
    zlib.error
        If it is damaged, or cut off.
    """
    inflate = zlib.decompressobj(_WINDOW[window])
    content = inflate.decompress(data, size + 1)
    if len(content) <= size and not inflate.eof:
        raise zlib.error("it is cut off")
    return content


def _begins_again(content: bytes) -> bool:
    return content.startswith((b"\x1f\x8b", b"BZh"))


def _wrong_length(path: Path, which: str, needed: int) -> ScanError:
    return ScanError(
        f"{path} holds {which} packed voxels than its header states ({needed:,} bytes): "
        "it is damaged or cut off; copy or export it again."
    )


def written_out(
    content: bytes, count: int, dtype: np.dtype[Any], path: Path, *, exactly: bool = True
) -> Shaped[np.ndarray, "n"]:
    """Return numbers that are written as text, which must be as many as `count`.

    Raises
    ------
    ScanError
        If they are more or fewer, or no numbers of that type.
    """
    words = content.split(None, count)
    if len(words) < count or (exactly and len(words) > count):
        held = "more" if len(words) > count else f"{len(words):,}"
        raise ScanError(
            f"{path} holds {held} numbers, where its header states {count:,}: it is damaged or cut off; "
            "copy or export it again."
        )
    words = words[:count]
    try:
        if dtype.kind == "f":
            with np.errstate(over="raise"):
                return np.array(words).astype(dtype)
        numbers = np.array(words).astype(np.int64)
    except (ValueError, OverflowError, FloatingPointError) as error:
        raise ScanError(
            f"{path} holds something that is not a number of its type ({error}): it is damaged; "
            "copy or export it again."
        ) from error
    kind = np.iinfo(dtype)
    if len(numbers) and (numbers.min() < kind.min or numbers.max() > kind.max):
        raise ScanError(f"{path} holds numbers outside its type {dtype.name}: export it again.")
    return numbers.astype(dtype)
