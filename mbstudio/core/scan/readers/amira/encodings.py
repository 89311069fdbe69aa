"""The ways in which AmiraMesh packs its numbers: HxByteRLE, HxZip and text."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.compiled import compiled
from mbstudio.core.errors import ScanError


def unzipped(content: bytes, needed: int, path: Path) -> np.ndarray:
    """Return the bytes of a zlib stream, which must be as many as needed; its checksum is compared.

    Raises
    ------
    ScanError
        If it is damaged, or holds more or fewer.
    """
    try:
        inflate = zlib.decompressobj()
        # One more than needed, so that more is noticed and not inflated.
        out = inflate.decompress(content, needed + 1)
    except zlib.error as error:
        raise ScanError(f"{path} is damaged: its packed voxels cannot be unpacked ({error}).") from error
    if len(out) != needed or not inflate.eof:
        some = "more" if len(out) > needed else "fewer"
        raise ScanError(
            f"{path} holds {some} packed voxels than its header states ({needed:,} bytes): "
            "it is damaged or cut off; copy or export it again."
        )
    return np.frombuffer(out, np.uint8)


def unrolled(content: bytes, needed: int, path: Path) -> np.ndarray:
    """Return the bytes of runs (HxByteRLE), which must be as many as needed.

    Raises
    ------
    ScanError
        If they are more or fewer.
    """
    out = np.empty(needed, np.uint8)
    count = int(_unroll(np.frombuffer(content, np.uint8), out))
    if count != needed:
        raise ScanError(
            f"{path} holds {'more' if count > needed else 'fewer'} packed voxels than its header states "
            f"({needed:,}): it is damaged or cut off; copy or export it again."
        )
    return out


@compiled()
def _unroll(packed: np.ndarray, out: np.ndarray) -> int:
    """Fill `out`; return how many bytes the runs hold, or one more than `out` if they hold too many."""
    place, count = 0, 0
    while place < len(packed):
        control = packed[place]
        length = int(control & 0x7F)
        place += 1
        if count + length > len(out):
            return len(out) + 1
        if control & 0x80:
            if place + length > len(packed):
                return -1
            for index in range(length):
                out[count + index] = packed[place + index]
            place += length
        else:
            if place >= len(packed):
                return -1
            for index in range(length):
                out[count + index] = packed[place]
            place += 1
        count += length
    return count


def written_out(content: bytes, count: int, dtype: np.dtype[Any], path: Path) -> np.ndarray:
    """Return numbers that are written as text, which must be as many as `count`.

    Raises
    ------
    ScanError
        If they are more or fewer, or no numbers of that type.
    """
    words = content.split(None, count)
    if len(words) != count:
        held = "more" if len(words) > count else f"{len(words):,}"
        raise ScanError(
            f"{path} holds {held} numbers, where its header states {count:,}: it is damaged or cut off; "
            "copy or export it again."
        )
    try:
        if dtype.kind == "f":
            return np.array(words).astype(dtype)
        numbers = np.array(words).astype(np.int64)
    except (ValueError, OverflowError) as error:
        raise ScanError(
            f"{path} holds what is no number ({error}): it is damaged; copy or export it again."
        ) from error
    kind = np.iinfo(dtype)
    if len(numbers) and (numbers.min() < kind.min or numbers.max() > kind.max):
        raise ScanError(f"{path} holds numbers outside its type {dtype.name}: export it again.")
    return numbers.astype(dtype)
