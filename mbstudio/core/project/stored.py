"""What an HDF5 file held, as plain records, and the questions that readers ask of it.

Whoever reads a part says what it must be: kind, axes, length, finite. What is not is named and goes no
further, so that also a file with a right seal brings nothing into a project that no project can hold.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

Kind = TypeVar("Kind", bool, int, float, str)


class ContentError(ValueError):
    """Something in a file that is missing or cannot be; the message names it."""


@dataclass(frozen=True)
class Stored:
    """A group of a file: attributes, groups and datasets, all in memory.

    Attributes
    ----------
    groups : mapping of str to mapping
        The attributes of every group of the file, by its whole name without the first slash.
    arrays : mapping of str to array
        Every dataset that was read; texts as objects.
    array_attributes : mapping of str to mapping
    path : str
        Name of this group; empty for the root.
    """

    groups: Mapping[str, Mapping[str, Any]]
    arrays: Mapping[str, np.ndarray]
    array_attributes: Mapping[str, Mapping[str, Any]]
    path: str = ""

    def __contains__(self, name: str) -> bool:
        place = self._place(name)
        return place in self.groups or place in self.arrays

    def group(self, name: str) -> Stored:
        """Return a group in this one."""
        if self._place(name) not in self.groups:
            raise ContentError(f"{self._place(name)} is missing")
        return Stored(self.groups, self.arrays, self.array_attributes, self._place(name))

    def names(self) -> list[str]:
        """Return the names of the datasets right in this group."""
        start = f"{self.path}/" if self.path else ""
        inside = [place[len(start) :] for place in self.arrays if place.startswith(start)]
        return [name for name in inside if "/" not in name]

    # ---- datasets ------------------------------------------------------------------------------

    def array(self, name: str) -> np.ndarray:
        """Return a dataset, whatever it holds."""
        if self._place(name) not in self.arrays:
            raise ContentError(f"{self._place(name)} is missing")
        return self.arrays[self._place(name)]

    def numbers(
        self, name: str, kinds: str = "iuf", axes: int = 1, rows: int | None = None, *, finite: bool = True
    ) -> np.ndarray:
        """Return a dataset of numbers, or truth values (kind 'b').

        Parameters
        ----------
        name : str
        kinds : str
            Letters of NumPy's kinds that it may be of.
        axes : int
        rows : int, optional
            Its length along the first axis.
        finite : bool
            Whether real numbers must be finite.

        Raises
        ------
        ContentError
            If it is missing or something else.
        """
        found = self.array(name)
        place = self._place(name)
        if found.dtype.kind not in kinds:
            raise ContentError(f"{place} holds values of another kind ({found.dtype})")
        if found.ndim != axes or (rows is not None and len(found) != rows):
            wanted = f"{axes} axes" if rows is None else f"{axes} axes and {rows} rows"
            raise ContentError(f"{place} has the shape {found.shape} where {wanted} are due")
        if found.dtype.kind == "b" and found.size and found.view(np.uint8).max() > 1:
            raise ContentError(f"{place} holds truth values that are neither true nor false")
        if finite and found.dtype.kind == "f" and not np.isfinite(found).all():
            raise ContentError(f"{place} holds numbers that are not finite")
        return found

    def texts(self, name: str, rows: int | None = None) -> list[str]:
        """Return a dataset of texts, one axis."""
        found = self.array(name)
        if found.dtype != object or found.ndim != 1 or (rows is not None and len(found) != rows):
            raise ContentError(f"{self._place(name)} is no list of {'' if rows is None else rows} texts")
        return [str(text) for text in found]

    def text(self, name: str) -> str:
        """Return a dataset that is a single text."""
        found = self.array(name)
        if found.dtype != object or found.ndim != 0:
            raise ContentError(f"{self._place(name)} is no text")
        return str(found[()])

    def entries(self, name: str) -> dict[str, Any]:
        """Return a dataset that is a single text of JSON with names and values."""
        return json_entries(self.text(name), self._place(name))

    # ---- attributes ----------------------------------------------------------------------------

    def attributes(self, name: str = "") -> Mapping[str, Any]:
        """Return the attributes of this group, or of a group or dataset in it."""
        place = self._place(name) if name else self.path
        if place not in self.groups and place not in self.array_attributes:
            raise ContentError(f"{place} is missing")
        return self.groups[place] if place in self.groups else self.array_attributes[place]

    def attribute(self, name: str, kind: type[Kind], default: Kind | None = None, *, of: str = "") -> Kind:
        """Return an attribute of this kind, of this group or of what lies in it by the name `of`.

        Raises
        ------
        ContentError
            If it is of another kind, or missing without a default.
        """
        found = self.attributes(of).get(name, default)
        if kind is float and type(found) is int:
            found = float(found)
        if type(found) is not kind:
            place = (self._place(of) if of else self.path) or "the root"
            raise ContentError(f"attribute {name} of {place} is missing or of another kind ({found!r:.80})")
        return found

    def tuple_of(self, name: str, kind: type[Kind], length: int, *, of: str = "") -> tuple[Kind, ...]:
        """Return an attribute of so many values of a kind, the numbers finite."""
        found = self.attributes(of).get(name)
        values = found if isinstance(found, list) else []
        if len(values) != length or not all(
            type(value) is kind or (kind is float and type(value) is int) for value in values
        ):
            raise ContentError(
                f"attribute {name} of {self._place(of)} is not {length} values as they are due"
            )
        if kind is float and not all(map(math.isfinite, values)):
            raise ContentError(f"attribute {name} of {self._place(of)} holds numbers that are not finite")
        return tuple(kind(value) for value in values)

    def _place(self, name: str) -> str:
        return f"{self.path}/{name}" if self.path and name else self.path or name


def json_entries(text: str, place: str) -> dict[str, Any]:
    """Return the names and values of a JSON text that a file holds at a place.

    Raises
    ------
    ContentError
        If it is something else.
    """
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        raise ContentError(f"{place} is no JSON") from None
    if not isinstance(found, dict):
        raise ContentError(f"{place} holds no names with values")
    return found
