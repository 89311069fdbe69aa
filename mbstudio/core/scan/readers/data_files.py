"""Voxels in the files that a header names: raw, packed or as text, in one file or in several parts."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.family import is_there, require_file, require_memory, side_car
from mbstudio.core.scan.readers.unpacking import unpacked, written_out

# A number written as text takes about so many bytes until it is one.
_BYTES_OF_A_WORD = 60
_PATTERN = re.compile(r"(?P<front>[^%]*)%(?P<width>0?\d{0,2})d(?P<back>[^%]*?)\s+(?P<rest>[-+\d\s]+)")
_MOST_FILES = 10**5


@dataclass(frozen=True)
class Storage:
    """How the numbers lie in a file.

    Attributes
    ----------
    packing : str
        ``raw``, ``text``, or one of `unpacked`.
    dtype : numpy dtype
    start : int
        The byte at which they begin; -1 if they end with the file.
    skip : int
        Bytes to leave out before them, once unpacked.
    line_skip : int
        Lines to leave out behind `start`.
    length : int or None
        Packed bytes, where the header states them.
    """

    packing: str
    dtype: np.dtype[Any]
    start: int = 0
    skip: int = 0
    line_skip: int = 0
    length: int | None = None


def read_part(file: Path, shape: tuple[int, ...], how: Storage, header: Path) -> np.ndarray:
    """Return the numbers of one file, mapped where they are raw.

    Raises
    ------
    ScanError
        If the file is missing, damaged, or shorter than the header says.
    """
    require_data(file, header)
    needed, held = math.prod(shape) * how.dtype.itemsize, file.stat().st_size
    if min(shape, default=0) < 1:
        raise ScanError(f"{header} contains no voxels (shape {shape}): export the scan again.")
    start = _behind_lines(file, how) if how.line_skip else how.start
    if how.packing == "raw":
        first = held - needed if start < 0 else start + how.skip
        if first < 0 or first + needed > held:
            raise ScanError(
                f"{header} states {' x '.join(map(str, shape))} voxels (z, y, x) of {how.dtype.name}, "
                f"{needed:,} "
                f"bytes, but {file.name} holds {max(held - max(start, 0), 0):,}: it is cut off, or the "
                f"header "
                "is wrong."
            )
        return np.memmap(file, how.dtype, "r", first, shape)
    if start < 0:
        if how.length is None:
            raise ScanError(f"{header} does not say where its packed voxels begin: export it again.")
        start = held - how.length
    if start < 0 or (how.length is not None and start + how.length > held):
        raise ScanError(f"{header} states more packed bytes than {file.name} holds: it is cut off.")
    with file.open("rb") as stream:
        stream.seek(start)
        if how.packing == "text":
            require_memory(shape, _BYTES_OF_A_WORD, header, held)
            numbers = written_out(stream.read(), math.prod(shape), how.dtype, file, exactly=False)
            return numbers.reshape(shape)
        require_memory(shape, how.dtype.itemsize, header, held)
        content = unpacked(stream, how.packing, needed + how.skip, file, how.length)
    return content[how.skip :].view(how.dtype).reshape(shape)


def require_data(file: Path, header: Path) -> None:
    """Raise ScanError unless the file that a header names is there, and a regular one."""
    if not is_there(file):
        raise ScanError(
            f"{header} refers to the data file {file.name}, which is missing: put it into the same folder."
        )
    require_file(file)


def named_files(header: Path, names: Sequence[str], parts: int) -> tuple[Path, ...]:
    """Return the files beside a header that it names, of which `parts` voxels along z are shared out.

    Raises
    ------
    ScanError
        If one is missing or lies in another folder, or the voxels cannot be shared out evenly.
    """
    if not names or parts % len(names):
        raise ScanError(
            f"{header} names {len(names)} files for {parts} slices, which does not come out even: "
            "export it again, as one file."
        )
    files = tuple(side_car(header, name) for name in names)
    for file in files:
        require_data(file, header)
    return files


def numbered_names(header: Path, pattern: str) -> list[str]:
    """Return the names that a pattern such as ``slice%03d.raw 1 100 1`` stands for.

    Raises
    ------
    ScanError
        If it has not one number, in the form ``%03d``, and first, last and step behind it.
    """
    match = _PATTERN.fullmatch(pattern.strip())
    words = match["rest"].split() if match else []
    if match is not None and 3 <= len(words) <= 4 and all(re.fullmatch(r"-?\d{1,9}", word) for word in words):
        first, last, step = (int(word) for word in words[:3])
        numbers = range(first, last + (1 if step > 0 else -1), step) if step else range(0)
        if 0 < len(numbers) <= _MOST_FILES and min(first, last) >= 0:
            width, fill = int(match["width"] or 0), "0" if match["width"].startswith("0") else " "
            return [f"{match['front']}{str(number).rjust(width, fill)}{match['back']}" for number in numbers]
    raise ScanError(
        f"{header} names its files by '{pattern}', which is not read: a name with one number such as "
        f"%03d, and "
        "first, last and step behind it."
    )


def _behind_lines(file: Path, how: Storage) -> int:
    with file.open("rb") as stream:
        stream.seek(max(how.start, 0))
        for _ in range(how.line_skip):
            if not stream.readline(2**20):
                break
        return stream.tell()
