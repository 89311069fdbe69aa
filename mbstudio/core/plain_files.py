"""Small files of text, JSON and NumPy arrays, read with suspicion: bounded in size, with one kind of error.

What is in them is then for the caller to check, by kind and range, as for anything that comes from outside.
"""

from __future__ import annotations

import json
import math
import stat
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

MOST_BYTES = 256 << 20
_MOST_ARRAYS = 1000
_DEEPEST = 60


class PlainFileError(ValueError):
    """A file that cannot be read as what it should be; the message says why, in part of a sentence."""


def read_plain_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Return the content of a regular file.

    Raises
    ------
    PlainFileError
        If it cannot be read, is no regular file, or is longer than `most` bytes.
    """
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            raise PlainFileError("it is no regular file")
        if found.st_size > most:
            raise PlainFileError(f"it is {found.st_size >> 20} MiB long, and may have {most >> 20}")
        return path.read_bytes()
    except OSError as error:
        raise PlainFileError(error.strerror or str(error)) from error


def read_plain_text(path: Path, most: int = MOST_BYTES) -> str:
    """Return the text of a file in UTF-8; errors as `read_plain_bytes`, and for what is no text."""
    try:
        return read_plain_bytes(path, most).decode("utf-8")
    except UnicodeDecodeError as error:
        raise PlainFileError("it is no text in UTF-8") from error


def parse_json(content: bytes | str) -> Any:
    """Return what JSON says, numbers that are not finite refused.

    Raises
    ------
    PlainFileError
        If it is no JSON, nested too deeply, or names a number that is not finite, or one of too many digits.
    """
    try:
        found = json.loads(content, parse_constant=_refuse, parse_float=_finite)
    except RecursionError:
        raise PlainFileError("it is nested too deeply") from None
    except PlainFileError:
        raise
    except ValueError as error:
        raise PlainFileError(_first_line(error)) from None
    _require_shallow(found)
    return found


def _require_shallow(found: Any) -> None:
    """Refuse what Python can read, but not every function that walks through it."""
    level = [found]
    for _ in range(_DEEPEST):
        level = [
            inner
            for holder in level
            if isinstance(holder, list | dict)
            for inner in (holder.values() if isinstance(holder, dict) else holder)
        ]
        if not level:
            return
    raise PlainFileError("it is nested too deeply")


def read_json(path: Path, most: int = MOST_BYTES) -> Any:
    """Return what a JSON file says; errors as `read_plain_bytes` and `parse_json`."""
    return parse_json(read_plain_bytes(path, most))


def read_npz(path: Path, most: int = 2 * MOST_BYTES) -> dict[str, np.ndarray]:
    """Return the arrays of an .npz file by name, each compared with its CRC-32.

    Parameters
    ----------
    path : Path
    most : int
        Bytes that all arrays together may have, unpacked.

    Raises
    ------
    PlainFileError
        If it cannot be read, is damaged, holds objects, or claims more than that.
    """
    require_regular(path)
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            names = [entry.filename for entry in entries]
            if len(entries) > _MOST_ARRAYS or len(set(names)) != len(names):
                raise PlainFileError("it holds too many arrays, or one twice")
            if sum(entry.file_size for entry in entries) > most:
                raise PlainFileError(f"it would unpack to more than {most >> 20} MiB")
            return {entry.filename.removesuffix(".npy"): _array(archive, entry) for entry in entries}
    except PlainFileError:
        raise
    except OSError as error:
        raise PlainFileError(error.strerror or _first_line(error)) from error
    except (
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        LookupError,
        MemoryError,
        NotImplementedError,
        OverflowError,
        RecursionError,
        RuntimeError,
        SyntaxError,
        tokenize.TokenError,
        TypeError,
        ValueError,
    ) as error:
        # Whatever zipfile and NumPy raise on bytes that are no archive of arrays.
        raise PlainFileError(_first_line(error)) from error


def require_regular(path: Path) -> None:
    """Refuse pipes, devices and folders, which would be read for ever or not at all."""
    try:
        regular = stat.S_ISREG(path.stat().st_mode)
    except OSError as error:
        raise PlainFileError(error.strerror or str(error)) from error
    if not regular:
        raise PlainFileError("it is no regular file")


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> np.ndarray:
    with archive.open(entry) as stream:
        version = np.lib.format.read_magic(stream)
        reader = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        if version not in reader:
            raise PlainFileError(f"'{entry.filename}' is in a version of NumPy's format that is not known")
        shape, by_columns, kind = reader[version](stream)
        if kind.hasobject or kind.itemsize == 0:
            raise PlainFileError(f"'{entry.filename}' holds objects or nothing, which are not read")
        wanted = math.prod(shape) * kind.itemsize
        # What is declared is held against what is there before memory is taken.
        if wanted > entry.file_size or wanted < 0:
            raise PlainFileError(f"'{entry.filename}' is cut off")
        content = stream.read()
    if len(content) != wanted:
        raise PlainFileError(f"'{entry.filename}' has {len(content)} bytes and should have {wanted}")
    return np.frombuffer(content, kind).reshape(shape, order="F" if by_columns else "C")


def _refuse(word: str) -> float:
    raise PlainFileError(f"it names the number {word}, which is not finite")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise PlainFileError(f"it names the number {text[:40]}, which is not finite")
    return value


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]
