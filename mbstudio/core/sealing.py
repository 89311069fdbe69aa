"""Seals: a file carries the SHA-256 of all its bytes, compared before anything of it is understood.

A binary file begins with a header of 512 bytes, the user block that HDF5 leaves to programs. It names the
length of the file, the SHA-256 of all that follows, and the SHA-256 of the header itself, with zeros in that
place. A JSON file carries the SHA-256 of its whole text, with zeros in that place, as its first entry. Thus a
bit that flips anywhere, a missing end or bytes that were added are noticed.

A seal tells of damage, not of malice: anybody can seal a file.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
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
    rb"bytes (?P<length>\d{1,18})\nsha256 of the bytes after the first 512 (?P<digest>[0-9a-f]{64})\n"
    rb"mark (?P<mark>[0-9a-f]{64})\nsha256 of these 512 bytes (?P<header>[0-9a-f]{64})\n\0*"
)
_JSON_SEAL = re.compile(rb'\{\s*"seal": "(?P<digest>[0-9a-f]{64})"')
_JSON_CLAIM = re.compile(rb'\{\s*"seal"')


class BrokenSealError(ValueError):
    """A sealed file that is not what was written; the message says what differs."""


@dataclass(frozen=True)
class Seal:
    """What the header of a sealed binary file says.

    Attributes
    ----------
    digest : str
        SHA-256 of the bytes after the header, 64 hexadecimal digits.
    length : int
        Bytes of the whole file.
    saved : str
        When it was written: date and time in UTC.
    version : str
        The mbstudio that wrote it.
    mark : str
        64 digits by which who wrote the file knows it again; zeros for none.
    header : str
        SHA-256 of the header: no other file has the same.
    """

    digest: str
    length: int
    saved: str
    version: str
    mark: str
    header: str


def seal_image(image: bytearray | memoryview, mark_of: Callable[[str], str] | None = None) -> None:
    """Write the header into the first 512 bytes of a file that is still in memory.

    Parameters
    ----------
    image : bytearray or memoryview
    mark_of : callable, optional
        Makes the mark, 64 hexadecimal digits, of the digest.
    """
    saved = datetime.now(UTC).isoformat(timespec="seconds")
    digest = hashlib.sha256(memoryview(image)[HEADER_BYTES:]).hexdigest()
    mark = _BLANK.decode("ascii") if mark_of is None else mark_of(digest)
    lines = (
        f"MetaBall Studio, seal 1\nsaved {saved} by mbstudio {__version__}\nbytes {len(image)}\n"
        f"sha256 of the bytes after the first 512 {digest}\nmark {mark}\nsha256 of these 512 bytes "
    ).encode("ascii")
    header = (lines + _BLANK + b"\n").ljust(HEADER_BYTES, b"\0")
    image[:HEADER_BYTES] = header.replace(
        lines + _BLANK, lines + hashlib.sha256(header).hexdigest().encode("ascii")
    )


def read_seal(head: bytes) -> Seal | None:
    """Return what the first 512 bytes of a file say of its seal; None if they are no whole header.

    The bytes that follow are not compared yet: see :func:`check_seal`.
    """
    match = _HEADER.fullmatch(head)
    if match is None:
        return None
    blank = head[: match.start("header")] + _BLANK + head[match.end("header") :]
    if hashlib.sha256(blank).hexdigest().encode("ascii") != match["header"]:
        return None
    found = {name: match[name].decode("ascii") for name in ("digest", "saved", "version", "mark", "header")}
    return Seal(length=int(match["length"]), **found)


def check_seal(stream: BinaryIO, seal: Seal) -> None:
    """Compare a file with its seal.

    Raises
    ------
    BrokenSealError
        If it is not what was written.
    """
    length = stream.seek(0, 2)
    if length != seal.length:
        more = "bytes were added to it" if length > seal.length else "its end is missing"
        raise BrokenSealError(f"it has {length} bytes and was written with {seal.length}: {more}")
    stream.seek(HEADER_BYTES)
    digest = hashlib.sha256()
    while block := stream.read(_BLOCK):
        digest.update(block)
    if digest.hexdigest() != seal.digest:
        raise BrokenSealError("its bytes are not those that were written")


def seal_json(entries: dict[str, Any]) -> bytes:
    """Return entries as the content of a JSON file (UTF-8) that carries its seal as its first entry, `seal`.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    sealed = {"seal": _BLANK.decode("ascii"), **{key: entries[key] for key in entries if key != "seal"}}
    text = json.dumps(sealed, indent=1, allow_nan=False)
    content = text.encode("utf-8")
    return content.replace(_BLANK, hashlib.sha256(content).hexdigest().encode("ascii"), 1)


def check_json(content: bytes) -> bool:
    """Compare the content of a JSON file with its seal; return whether it carries one.

    Raises
    ------
    BrokenSealError
        If it carries one and is not what was written.
    """
    if _JSON_CLAIM.match(content) is None:
        return False
    match = _JSON_SEAL.match(content)
    if match is None:
        raise BrokenSealError("its seal is none")
    blank = content[: match.start("digest")] + _BLANK + content[match.end("digest") :]
    if hashlib.sha256(blank).hexdigest().encode("ascii") != match["digest"]:
        raise BrokenSealError("its bytes are not those that were written")
    return True
