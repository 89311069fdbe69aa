"""Lines of ``key = value`` under headings, as most side-cars have."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.family import require_file
from mbstudio.core.scan.readers.text import plain_text

# No side-car is longer: what is, is another file of that ending.
_LARGEST = 2**22
_MOST_VOXELS_ALONG_AN_AXIS = 10**7
_WHOLE = re.compile(r"[+-]?[0-9]{1,18}(?:\.0*)?")
_REAL = re.compile(r"[+-]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[eE][+-]?[0-9]{1,4})?")


@dataclass(frozen=True)
class KeyValues:
    """What a side-car says.

    Attributes
    ----------
    path : Path
    entries : tuple of (str, str, str)
        Section, key and value of each line, the first two in small letters; a block in braces stands
        before the section, as in ``volume1/file1``.
    """

    path: Path
    entries: tuple[tuple[str, str, str], ...]

    def values(self, key: str, section: str = "") -> tuple[str, ...]:
        """Return what a key says in all sections, or in those whose name ends so."""
        return tuple(
            value for where, name, value in self.entries if name == key.lower() and where.endswith(section)
        )

    def value(self, key: str, section: str = "") -> str | None:
        """Return the one value of a key, None if there is none.

        Raises
        ------
        ScanError
            If it has different values.
        """
        found = list(dict.fromkeys(self.values(key, section)))
        if len(found) > 1:
            raise ScanError(
                f"{self.path} gives {key} as {found[0]} and as {found[1]}: correct it, or state "
                "shape and dtype."
            )
        return found[0] if found else None

    def text(self, key: str, section: str = "") -> str:
        """Return the value of a key; ScanError if it is not there."""
        value = self.value(key, section)
        if value is None:
            raise ScanError(f"{self.path} does not say {key}: export it again, or state shape and dtype.")
        return value

    def count(self, key: str, section: str = "") -> int:
        """Return the number of voxels along an axis that a key states."""
        return self.counts(self.text(key, section).split(), key)[0]

    def counts(self, words: Iterable[str], key: str) -> tuple[int, ...]:
        """Return words as numbers of voxels along axes."""
        words = tuple(words)
        numbers = tuple(whole_number(word) for word in words)
        if not numbers or any(
            number is None or not 1 <= number <= _MOST_VOXELS_ALONG_AN_AXIS for number in numbers
        ):
            raise ScanError(
                f"{self.path} gives {key} as '{' '.join(words)}', which is not a number of voxels: "
                "correct it, or state shape and dtype."
            )
        return tuple(number for number in numbers if number is not None)

    def length(self, key: str, section: str = "") -> float | None:
        """Return the length that a key states, None where it says nothing or zero.

        Raises
        ------
        ScanError
            If it is no number, or negative.
        """
        value = self.value(key, section)
        if value is None or not value.strip():
            return None
        number = real_number(value)
        if number is None or number < 0:
            raise ScanError(f"{self.path} gives {key} as '{value}', which is not a length: correct it.")
        return number or None

    def skipped_bytes(self, key: str, section: str = "") -> int:
        """Return the bytes before the first voxel that a key states, 0 where it says nothing."""
        value = self.value(key, section)
        if value is None:
            return 0
        number = whole_number(value)
        if number is None or number < 0:
            raise ScanError(
                f"{self.path} gives {key} as '{value}', which is not a number of bytes: correct it."
            )
        return number

    def as_metadata(self) -> dict[str, str]:
        """Return all entries as ``section/key``."""
        return {f"{where}/{key}" if where else key: value for where, key, value in self.entries}


def read_key_values(path: Path, separator: str = "=") -> KeyValues:
    """Read a side-car of ``key = value`` lines.

    Raises
    ------
    ScanError
        If the file is none: too long, binary, or not there.
    """
    return KeyValues(path, tuple(_entries(read_text(path), separator)))


def read_text(path: Path) -> str:
    """Return the text of a side-car; ScanError if it is no text of that length."""
    require_file(path)
    if path.stat().st_size > _LARGEST:
        raise ScanError(f"{path} is too long for a description of voxels ({path.stat().st_size:,} bytes).")
    text = plain_text(path.read_bytes())
    if "\0" in text:
        raise ScanError(f"{path} is not the text that describes voxels, although its name ends so.")
    return text


def _entries(text: str, separator: str) -> Iterator[tuple[str, str, str]]:
    block = section = ""
    for line in text.splitlines():
        line = line.strip()
        if line.startswith("{") and line.endswith("}"):
            block, section = line[1:-1].strip().lower(), ""
        elif line.startswith("[") and line.endswith("]"):
            section = line[1:-1].strip().lower()
        else:
            key, found, value = line.partition(separator)
            if found and key.strip():
                yield "/".join(filter(None, (block, section))), key.strip().lower(), value.strip()


def whole_number(text: str) -> int | None:
    """Return a whole number as programs write it, None if it is none."""
    text = text.strip()
    return int(text.partition(".")[0]) if _WHOLE.fullmatch(text) else None


def real_number(text: str) -> float | None:
    """Return a finite number, with a point or a comma, None if it is none."""
    text = text.strip()
    if not _REAL.fullmatch(text):
        return None
    number = float(text.replace(",", "."))
    return number if np.isfinite(number) else None
