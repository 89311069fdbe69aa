"""Seals: the SHA-256 of a whole file, written into the file itself.

The 64 hexadecimal digits stand at a known place of the file, and they are those of the file with zeros in
that place. Every byte counts, those of the seal too, so that a bit that flips anywhere, a missing end or
bytes that were added are noticed before anything of the file is understood.

A binary file carries the seal in a header of 512 bytes, the user block that HDF5 leaves to programs; a JSON
file carries it as its first entry. A seal tells of damage, not of malice: anybody can seal a file.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, BinaryIO

from mbstudio.core.version import __version__

HEADER_BYTES = 512
"""Length of the header of a binary file."""

_BLANK = b"0" * 64
_BLOCK = 2**20
_HEADER = re.compile(
    rb"MetaBall Studio, seal 1\nsaved (?P<saved>[\d:+T-]{1,40}) by mbstudio (?P<version>[\w.+]{1,40})\n"
    rb"bytes (?P<length>\d{1,18})\nsha256 (?P<digest>[0-9a-f]{64})\n\0*"
)
_JSON_SEAL = re.compile(rb'\{\s*"seal": "(?P<digest>[0-9a-f]{64})"')


class BrokenSealError(ValueError):
    """A sealed file that is not what was written; the message says what differs."""


@dataclass(frozen=True)
class Seal:
    """What the header of a sealed binary file says.

    Attributes
    ----------
    digest : str
        SHA-256 of the file, 64 hexadecimal digits.
    length : int
        Bytes of the file.
    saved : str
        When it was written: date and time in UTC.
    version : str
        The mbstudio that wrote it.
    place : int
        Where the digits begin.
    """

    digest: str
    length: int
    saved: str
    version: str
    place: int


def seal_image(image: bytearray | memoryview) -> None:
    """Write header and seal into the first 512 bytes of a file that is still in memory."""
    saved = datetime.now(UTC).isoformat(timespec="seconds")
    lines = f"MetaBall Studio, seal 1\nsaved {saved} by mbstudio {__version__}\nbytes {len(image)}\nsha256 "
    head = lines.encode("ascii")
    image[:HEADER_BYTES] = (head + _BLANK + b"\n").ljust(HEADER_BYTES, b"\0")
    digest = hashlib.sha256(image).hexdigest().encode("ascii")
    image[len(head) : len(head) + len(digest)] = digest


def read_seal(head: bytes) -> Seal | None:
    """Return what the first 512 bytes of a file say of its seal; None if they are no header.

    Nothing is compared yet: see :func:`check_seal`.
    """
    match = _HEADER.fullmatch(head)
    if match is None:
        return None
    saved, version = match["saved"].decode("ascii"), match["version"].decode("ascii")
    return Seal(match["digest"].decode("ascii"), int(match["length"]), saved, version, match.start("digest"))


def check_seal(stream: BinaryIO, seal: Seal) -> None:
    """Compare a file, from its beginning, with its seal.

    Raises
    ------
    BrokenSealError
        If it is not what was written.
    """
    length = stream.seek(0, 2)
    if length != seal.length:
        more = "bytes were added to it" if length > seal.length else "its end is missing"
        raise BrokenSealError(f"it has {length} bytes and was written with {seal.length}: {more}")
    stream.seek(0)
    head = bytearray(stream.read(HEADER_BYTES))
    head[seal.place : seal.place + len(_BLANK)] = _BLANK
    digest = hashlib.sha256(head)
    while block := stream.read(_BLOCK):
        digest.update(block)
    if digest.hexdigest() != seal.digest:
        raise BrokenSealError("its bytes are not those that were written")


def seal_json(entries: dict[str, Any]) -> bytes:
    """Return entries as the content of a JSON file (UTF-8) that carries its seal as its first entry.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    text = json.dumps({"seal": _BLANK.decode("ascii"), **entries}, indent=1, allow_nan=False)
    content = text.encode("utf-8")
    return content.replace(_BLANK, hashlib.sha256(content).hexdigest().encode("ascii"), 1)


def check_json(content: bytes) -> bool:
    """Compare the content of a JSON file with its seal; return whether it carries one.

    Raises
    ------
    BrokenSealError
        If it carries one and is not what was written.
    """
    match = _JSON_SEAL.match(content)
    if match is None:
        return False
    blank = content[: match.start("digest")] + _BLANK + content[match.end("digest") :]
    if hashlib.sha256(blank).hexdigest().encode("ascii") != match["digest"]:
        raise BrokenSealError("its bytes are not those that were written")
    return True
