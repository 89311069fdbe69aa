"""The XML of a VTK image: its grid and its arrays, and where in the file their numbers lie."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.parsers import expat

from mbstudio.core.errors import ScanError

_CHUNK = 1 << 20
_MOST_ARRAYS = 10_000
_TAG_END = re.compile(rb"""(?:[^>"']|"[^"]*"|'[^']*')*>""")


@dataclass(frozen=True)
class StoredArray:
    """An array of a file.

    Attributes
    ----------
    name : str
    place : str
        ``PointData`` or ``CellData``.
    attributes : mapping
        As the XML has them.
    begin, end : int
        Where its text lies in the file, if that is there.
    """

    name: str
    place: str
    attributes: Mapping[str, str]
    begin: int = 0
    end: int = 0

    @property
    def components(self) -> str:
        return self.attributes.get("NumberOfComponents", "1")


@dataclass(frozen=True)
class Layout:
    """What the XML of a file says.

    Attributes
    ----------
    file, image : mapping
        Attributes of ``VTKFile`` and ``ImageData``.
    pieces : tuple of str
        The extent of each piece.
    arrays : tuple of StoredArray
    appended : int
        Where appended data begins; 0 where there is none.
    appended_encoding : str
    """

    file: Mapping[str, str]
    image: Mapping[str, str]
    pieces: tuple[str, ...]
    arrays: tuple[StoredArray, ...]
    appended: int = 0
    appended_encoding: str = "raw"


class _Appended(Exception):
    """The appended data was reached, behind which there is no XML."""


class _Parser:
    """Follows the elements of a file without keeping their text."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.StartDoctypeDeclHandler = self._refuse
        self._stack: list[str] = []
        self._open: tuple[str, str, dict[str, str], int] | None = None
        self._inside = 0
        self.file: dict[str, str] = {}
        self.image: dict[str, str] = {}
        self.pieces: list[str] = []
        self.found: list[tuple[str, str, dict[str, str], int, int]] = []
        self.appended: tuple[int, str] | None = None

    def follow(self) -> None:
        """Read up to the appended data, or to the end."""
        with self._path.open("rb") as stream:
            while chunk := stream.read(_CHUNK):
                self._parser.Parse(chunk, False)
            self._parser.Parse(b"", True)

    def _refuse(self, *_: Any) -> None:
        raise ScanError(f"{self._path} declares a document type, as no VTK file does: export it again.")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        parent = self._stack[-1] if self._stack else ""
        if not self._stack:
            self.file = {"": name, **attributes}
        elif name == "ImageData" and len(self._stack) == 1:
            self.image = attributes
        elif name == "Piece" and parent == "ImageData":
            self.pieces.append(attributes.get("Extent", ""))
        elif name in ("DataArray", "Array") and parent in ("PointData", "CellData"):
            self._open = (parent, attributes.get("Name", ""), attributes, len(self._stack))
            self._inside = self._parser.CurrentByteIndex
        elif name == "AppendedData" and len(self._stack) == 1:
            self.appended = (self._parser.CurrentByteIndex, attributes.get("encoding", "raw"))
            raise _Appended
        self._stack.append(name)

    def _end(self, _name: str) -> None:
        self._stack.pop()
        if self._open is None:
            return
        place, title, attributes, depth = self._open
        here = self._parser.CurrentByteIndex
        if len(self._stack) > depth:
            self._inside = here  # what stands within an array before its numbers, such as InformationKey
            return
        self.found.append((place, title, attributes, self._inside, here))
        if len(self.found) > _MOST_ARRAYS:
            raise ScanError(
                f"{self._path} holds more than {_MOST_ARRAYS:,} arrays: export the one that is meant."
            )
        self._open = None


def read_layout(path: Path) -> Layout:
    """Return what a file holds, by its XML alone.

    Raises
    ------
    ScanError
        If it is no XML of VTK, or cut off.
    """
    parser = _Parser(path)
    try:
        parser.follow()
    except _Appended:
        pass
    except (expat.ExpatError, ValueError) as error:
        if not parser.file or parser.file[""] != "VTKFile":
            raise ScanError(
                f"{path} is not an XML file of VTK, although its name ends so: export it again."
            ) from error
        raise ScanError(
            f"{path} cannot be read as VTK image ({error}): it is damaged or cut off; copy or "
            "export it again."
        ) from error
    kind = parser.file.get("type", "")
    if parser.file.get("") != "VTKFile":
        raise ScanError(f"{path} is not an XML file of VTK, although its name ends so: export it again.")
    if kind.startswith("P") and kind != "PolyData":
        raise ScanError(f"{path} names pieces in other files ({kind}): save it as one .vti file.")
    if kind != "ImageData":
        raise ScanError(
            f"{path} holds no image but {kind or 'data of no type'}: resample it to an image (.vti)."
        )
    with path.open("rb") as stream:
        arrays = tuple(
            StoredArray(name, place, attributes, _behind_tag(stream, begin), end)
            for place, name, attributes, begin, end in parser.found
        )
        appended, encoding = parser.appended or (0, "raw")
        if appended:
            appended = _behind_tag(stream, appended)
            appended += _to_underscore(stream, appended, path)
    return Layout(parser.file, parser.image, tuple(parser.pieces), arrays, appended, encoding)


def _behind_tag(stream: Any, begin: int) -> int:
    """Return where the text behind a tag begins."""
    stream.seek(begin)
    head = stream.read(_CHUNK)
    found = _TAG_END.match(head)
    return begin + (found.end() if found else len(head))


def _to_underscore(stream: Any, begin: int, path: Path) -> int:
    """Return how many bytes lie up to behind the underscore with which appended data begins."""
    stream.seek(begin)
    head = stream.read(4096)
    blank = head[: len(head) - len(head.lstrip())]
    if head[len(blank) : len(blank) + 1] != b"_":
        raise ScanError(
            f"{path} holds no appended data where it should: it is damaged or cut off; export it again."
        )
    return len(blank) + 1
