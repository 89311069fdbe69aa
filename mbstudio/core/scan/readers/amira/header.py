"""The text before the voxels of an AmiraMesh file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.text import plain_text

# Avizo keeps colours and the history of the data in the header.
_LARGEST = 2**24
_DEEPEST = 32
# Longer lines are colours; of what is wanted, none is so long.
_LONGEST_LINE = 10_000
_FIRST_LINE = re.compile(rb"#\s*(?:AmiraMesh|Avizo)\b[^\n]*", re.IGNORECASE)
_FIRST_DATA = re.compile(rb"\n@1[^\n]*\n")
# Blanks alone, and no line ends: a header of blank lines must not be gone through again from each of them.
_LATTICE = re.compile(r"^[ \t]*define[ \t]+Lattice\b([^\n]*)$", re.MULTILINE | re.IGNORECASE)
_DEFINED = re.compile(r"^[ \t]*define[ \t]+(\w{1,40})", re.MULTILINE | re.IGNORECASE)
# Possessive: a long word must not be tried again from each of its letters.
_FIELD = re.compile(
    r"^[ \t]*+Lattice[ \t]*+\{[ \t]*+(?P<type>\w++)[ \t]*+(?:\[[ \t]*+(?P<samples>\d{1,4})[ \t]*+\])?+[ \t]*+"
    r"(?P<name>[^\s{}]++)[ \t]*+\}[ \t]*+=?+[ \t]*+(?:\w++[ \t]*+\([ \t]*+)?+@(?P<number>\d{1,6})[ \t]*+"
    r"\)?[ \t]*+"
    r"(?:\([ \t]*+(?P<packing>\w++)[ \t]*+(?:,[ \t]*+(?P<length>\d{1,18}))?[ \t]*+\))?",
    re.MULTILINE | re.IGNORECASE,
)
_TOKEN = re.compile(r'"(?:[^"\\\n]|\\.)*"|[{}]|\n|[^\s{}"]+|"')


@dataclass(frozen=True)
class Field:
    """One value for each voxel: its type, how many of them, and where and how they are stored."""

    kind: str
    samples: int
    name: str
    number: int
    packing: str | None
    length: int | None


@dataclass(frozen=True)
class AmiraHeader:
    """What an AmiraMesh file says before its data.

    Attributes
    ----------
    order : str
        ``<`` or ``>``, or ``a`` where numbers are written out as text.
    shape : tuple of int
        Voxels along z, y, x.
    fields : tuple of Field
        In the order in which they are declared.
    parameters : dict
        By their names in small letters, as ``units/coordinates``.
    materials : tuple of str
        Names of the materials of labels, that of the surroundings first.
    data_start : int
        The byte behind the line ``@1``.
    """

    order: str
    shape: tuple[int, int, int]
    fields: tuple[Field, ...]
    parameters: dict[str, str]
    materials: tuple[str, ...]
    data_start: int

    def numbers(self, name: str, count: int) -> np.ndarray | None:
        """Return so many finite numbers that a parameter gives, None if it does not."""
        words = self.parameters.get(name, "").replace(",", " ").split()
        try:
            numbers = np.array([float(word) for word in words])
        except ValueError:
            return None
        return numbers if len(numbers) == count and np.isfinite(numbers).all() else None


def begins_as_amira(path: Path) -> bool:
    """Return whether a file begins as AmiraMesh, whatever its ending."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return _FIRST_LINE.match(stream.read(64)) is not None


def read_header(path: Path) -> AmiraHeader:
    """Read what stands before the data.

    Raises
    ------
    ScanError
        If it is no AmiraMesh, holds no lattice of three axes, or is incomplete.
    """
    with path.open("rb") as stream:
        content = stream.read(_LARGEST)
    first = _FIRST_LINE.match(content)
    if first is None:
        raise ScanError(f"{path} is not an AmiraMesh file, although its name ends so: export it again.")
    data = _FIRST_DATA.search(content)
    text = plain_text(content[: data.start() if data else len(content)]).replace("\r", "\n")
    parameters, materials = _parameters(text)
    lattice = _LATTICE.search(text)
    if lattice is None:
        kind = parameters.get("contenttype", "").strip('"') or ", ".join(_DEFINED.findall(text)) or "nothing"
        raise ScanError(
            f"{path} holds no voxels (no Lattice) but {kind}: export the image or the labels themselves."
        )
    words = lattice[1].split()
    if len(words) != 3 or not all(word.isascii() and word.isdigit() and len(word) < 10 for word in words):
        raise ScanError(
            f"{path} has {len(words)} axes (define Lattice {lattice[1].strip()[:60]}), but a scan has three "
            "numbers of voxels: export one volume."
        )
    if data is None:
        raise ScanError(
            f"{path} ends before its data (no line '@1'): it is cut off; copy or export it again."
        )
    fields = tuple(
        Field(
            match["type"].lower(),
            int(match["samples"] or 1),
            match["name"],
            int(match["number"]),
            match["packing"],
            int(match["length"]) if match["length"] else None,
        )
        for match in _FIELD.finditer(text)
    )
    x, y, z = (int(word) for word in words)
    return AmiraHeader(_order(first[0], path), (z, y, x), fields, parameters, materials, data.end())


def _order(line: bytes, path: Path) -> str:
    words = line.upper().split()
    if b"ASCII" in words:
        return "a"
    if b"BINARY-LITTLE-ENDIAN" in words:
        return "<"
    if b"BINARY" in words or b"BINARY-BIG-ENDIAN" in words:
        return ">"
    raise ScanError(
        f"{path} does not say in its first line how its numbers are written (BINARY-LITTLE-ENDIAN, BINARY or "
        "ASCII): export it again."
    )


def _parameters(text: str) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the parameters, and the names in the block Materials."""
    found: dict[str, str] = {}
    materials: list[str] = []
    place: list[str] = []
    line: list[str] = []

    def end_line() -> None:
        if place[:1] == ["parameters"] and len(line) > 1:
            found.setdefault("/".join([*place[1:], line[0].lower()]), " ".join(line[1:]).rstrip(",").strip())
        line.clear()

    lines = "\n".join(row[:_LONGEST_LINE] for row in text.splitlines() if not row.lstrip().startswith("#"))
    waits = False  # a name may stand in the line before its brace
    for match in _TOKEN.finditer(lines):
        token = match[0]
        if token == "{":
            name = " ".join(line).strip(',"')
            line.clear()
            place.append(name.lower())
            if place[:-1] == ["parameters", "materials"]:
                materials.append(name)
            if len(place) > _DEEPEST:
                break
        elif token == "}":
            end_line()
            if place:
                place.pop()
        elif token == "\n":
            if len(line) > 1:
                end_line()
        else:
            if waits:
                line.clear()
            line.append(token)
        waits = token == "\n" and bool(line)
    return found, tuple(materials)
