"""Edits as records: what was done, to which grains, and where these lay.

A record is plain numbers and words, so that a project keeps it, and knows places inside the grains that it
was about, so that it can be made again after another segmentation.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

from mbstudio.core.errors import EditError
from mbstudio.core.grains.editing import brush, joining, new_grain, parting, reshaping
from mbstudio.core.grains.editing.boxes import Voxel, holds
from mbstudio.core.grains.editing.brush import Over
from mbstudio.core.grains.editing.stroke_voxels import Point
from mbstudio.core.grains.editing.workbench import Workbench
from mbstudio.core.translation import mark

_MOST_PLACES = 1_000_000


@dataclass(frozen=True, kw_only=True)
class Edit(ABC):
    """One correction of grains by hand.

    Attributes
    ----------
    labels : tuple of int
        The grains that it is about, by the numbers that they had.
    anchors : tuple of (z, y, x)
        A voxel inside each of them, as they were before.
    is_remark : bool
        Whether it says something of grains and changes nothing about them.
    """

    kind: ClassVar[str]
    title: ClassVar[str]
    is_remark: ClassVar[bool] = False
    labels: tuple[int, ...] = ()
    anchors: tuple[Voxel, ...] = ()

    @abstractmethod
    def make(self, bench: Workbench) -> Edit:
        """Make the edit on a workbench and return the record of it.

        Raises
        ------
        EditError
            If it cannot be made.
        """

    @property
    def needs_scan(self) -> bool:
        """Whether it looks at grey values."""
        return False

    def to_record(self) -> dict[str, Any]:
        """Return the edit for JSON."""
        return {
            "kind": self.kind,
            **{field.name: _plain(getattr(self, field.name)) for field in fields(self)},
        }

    def described(self) -> str:
        """Return what it does, in words."""
        named = f" {', '.join(map(str, self.labels))}" if self.labels else ""
        return f"{self.title}{named}"

    def _anchored(self, bench: Workbench) -> Edit:
        """Return the record with places inside its grains, which must be there."""
        bench.require(self.labels)
        return replace(self, anchors=tuple(bench.anchor(label) for label in self.labels))


@dataclass(frozen=True, kw_only=True)
class Merge(Edit):
    """Makes grains one; `apart` closes gaps between them."""

    kind, title = "merge", mark("Merge grains")
    apart: bool = False

    def make(self, bench: Workbench) -> Edit:
        done = self._anchored(bench)
        joining.merge_grains(bench, self.labels, self.apart)
        return done


@dataclass(frozen=True, kw_only=True)
class Split(Edit):
    """Parts a grain by seeds; `by_grey` looks at the scan too."""

    kind, title = "split", mark("Split grain")
    seeds: tuple[Voxel, ...]
    by_grey: bool = False

    @property
    def needs_scan(self) -> bool:
        return self.by_grey

    def make(self, bench: Workbench) -> Edit:
        done = self._anchored(bench)
        parting.split_by_seeds(bench, one_label(self), self.seeds, self.by_grey)
        return done


@dataclass(frozen=True, kw_only=True)
class SplitAlong(Edit):
    """Parts a grain along a line that was drawn looking along an axis."""

    kind, title = "split along", mark("Split grain along a line")
    points: tuple[Point, ...]
    axis: int = 0

    def make(self, bench: Workbench) -> Edit:
        done = self._anchored(bench)
        parting.split_along_line(bench, one_label(self), self.points, self.axis)
        return done


@dataclass(frozen=True, kw_only=True)
class Delete(Edit):
    """Takes grains away."""

    kind, title = "delete", mark("Delete grains")

    def make(self, bench: Workbench) -> Edit:
        done = self._anchored(bench)
        for label in dict.fromkeys(self.labels):
            bench.remove(label)
        return done


@dataclass(frozen=True, kw_only=True)
class Exclude(Edit):
    """Leaves grains out of all that follows, without changing them."""

    kind, title = "exclude", mark("Exclude grains")

    def make(self, bench: Workbench) -> Edit:
        done = self._anchored(bench)
        bench.set_excluded(self.labels, True)
        return done


@dataclass(frozen=True, kw_only=True)
class Include(Edit):
    """Takes grains in again that were excluded."""

    kind, title = "include", mark("Include grains")

    def make(self, bench: Workbench) -> Edit:
        done = self._anchored(bench)
        bench.set_excluded(self.labels, False)
        return done


@dataclass(frozen=True, kw_only=True)
class Accept(Edit):
    """Marks grains as looked at and right: they are not shown as suspicious until they change."""

    kind, title = "accept", mark("Accept grains")
    is_remark = True

    def make(self, bench: Workbench) -> Edit:
        done = self._anchored(bench)
        bench.accept(self.labels)
        return done


@dataclass(frozen=True, kw_only=True)
class Paint(Edit):
    """Gives the voxels under a stroke to a grain; to a new one if there is no label."""

    kind, title = "paint", mark("Paint")
    centres: tuple[Point, ...]
    radius: float
    over: Over = "void"
    axis: int | None = None

    def make(self, bench: Workbench) -> Edit:
        done = self._anchored(bench)
        label = one_label(self) if self.labels else bench.new_label()
        brush.paint(bench, label, self.centres, self.radius, self.over, self.axis)
        return done


@dataclass(frozen=True, kw_only=True)
class Erase(Edit):
    """Takes the voxels under a stroke from a grain; from all if there is no label."""

    kind, title = "erase", mark("Erase")
    centres: tuple[Point, ...]
    radius: float
    axis: int | None = None

    def make(self, bench: Workbench) -> Edit:
        done = self._anchored(bench)
        brush.erase(bench, one_label(self) if self.labels else None, self.centres, self.radius, self.axis)
        return done


@dataclass(frozen=True, kw_only=True)
class Fill(Edit):
    """Gives void that a grain encloses in a slice to it."""

    kind, title = "fill", mark("Fill")
    at: Voxel
    axis: int = 0

    def make(self, bench: Workbench) -> Edit:
        done = self._anchored(bench)
        brush.fill(bench, one_label(self), self.at, self.axis)
        return done


@dataclass(frozen=True, kw_only=True)
class Grow(Edit):
    """Adds the void about grains to them."""

    kind, title = "grow", mark("Grow grains")
    by: float = 1.0

    def make(self, bench: Workbench) -> Edit:
        return self._each(bench, lambda label: reshaping.grow(bench, label, self.by))

    def _each(self, bench: Workbench, change: Callable[[int], None]) -> Edit:
        done = self._anchored(bench)
        for label in dict.fromkeys(self.labels):
            change(label)
        return done


@dataclass(frozen=True, kw_only=True)
class Shrink(Grow):
    """Takes the outermost voxels from grains."""

    kind, title = "shrink", mark("Shrink grains")

    def make(self, bench: Workbench) -> Edit:
        return self._each(bench, lambda label: reshaping.shrink(bench, label, self.by))


@dataclass(frozen=True, kw_only=True)
class Smooth(Edit):
    """Smooths the outlines of grains."""

    kind, title = "smooth", mark("Smooth grains")
    sigma: float = 1.0

    def make(self, bench: Workbench) -> Edit:
        done = self._anchored(bench)
        for label in dict.fromkeys(self.labels):
            reshaping.smooth(bench, label, self.sigma)
        return done


@dataclass(frozen=True, kw_only=True)
class FillHoles(Edit):
    """Gives grains the void that they enclose."""

    kind, title = "fill holes", mark("Fill holes of grains")

    def make(self, bench: Workbench) -> Edit:
        done = self._anchored(bench)
        for label in dict.fromkeys(self.labels):
            reshaping.fill_holes(bench, label)
        return done


@dataclass(frozen=True, kw_only=True)
class NewGrain(Edit):
    """Makes a grain of what hangs together with a voxel on its side of a threshold."""

    kind, title = "new grain", mark("New grain")
    at: Voxel
    threshold: float | None = None

    @property
    def needs_scan(self) -> bool:
        return True

    def make(self, bench: Workbench) -> Edit:
        return replace(self, threshold=new_grain.flood_from(bench, self.at, self.threshold))


KINDS: Mapping[str, type[Edit]] = {
    kind.kind: kind
    for kind in (
        Merge, Split, SplitAlong, Delete, Exclude, Include, Accept, Paint, Erase, Fill, Grow, Shrink, Smooth,
        FillHoles, NewGrain,
    )
}  # fmt: skip


def one_label(edit: Edit) -> int:
    """Return the grain that an edit is about; EditError if it is about none or several."""
    if len(edit.labels) != 1:
        raise EditError(f"{edit.title}: name one grain, not {len(edit.labels)}.")
    return edit.labels[0]


def labels_of(given: int | Iterable[int]) -> tuple[int, ...]:
    """Return labels as whole numbers; EditError if there are none."""
    labels = tuple(int(label) for label in ([given] if isinstance(given, int) else given))
    if not labels:
        raise EditError("Name one grain or more.")
    return labels


def voxel_of(given: Sequence[float]) -> Voxel:
    """Return a voxel (z, y, x) as whole numbers.

    Raises
    ------
    EditError
        If it is not three whole numbers.
    """
    values = [float(value) for value in given]
    if len(values) != 3 or not all(math.isfinite(value) and value == round(value) for value in values):
        raise EditError(f"{tuple(given)} is no voxel: give three whole numbers z, y, x.")
    return int(values[0]), int(values[1]), int(values[2])


def point_of(given: Sequence[float]) -> Point:
    """Return a place (z, y, x) in voxels; EditError if it is not three finite numbers."""
    values = [float(value) for value in given]
    if len(values) != 3 or not all(map(math.isfinite, values)):
        raise EditError(f"{tuple(given)} is no place: give three numbers z, y, x.")
    return values[0], values[1], values[2]


def read_edit(record: Mapping[str, Any], shape: Sequence[int] | None = None) -> Edit:
    """Return the edit that a record of :meth:`Edit.to_record` describes.

    Parameters
    ----------
    record : mapping
    shape : sequence of int, optional
        (Z, Y, X) of the scan, in which the places of its grains must lie.

    Raises
    ------
    EditError
        If it is no such record.
    """
    kind = KINDS.get(str(record.get("kind")))
    if kind is None:
        raise EditError(f"'{record.get('kind')}' is no kind of edit: update mbstudio to read it.")
    names = {field.name for field in fields(kind)}
    unknown = set(record) - names - {"kind"}
    if unknown:
        raise EditError(f"An edit of kind '{kind.kind}' has no '{min(unknown)}': update mbstudio to read it.")
    try:
        values = {name: _READERS[name](record[name]) for name in names & set(record)}
        edit = kind(**values)
    except (TypeError, ValueError, OverflowError) as error:
        raise EditError(f"An edit of kind '{kind.kind}' is damaged: {error}.") from error
    if edit.anchors and len(edit.anchors) != len(edit.labels):
        raise EditError(f"An edit of kind '{kind.kind}' is damaged: it has not one place a grain.")
    if shape is not None and not all(holds(shape, anchor) for anchor in edit.anchors):
        raise EditError(f"An edit of kind '{kind.kind}' is damaged: its places lie outside the scan.")
    return edit


def _plain(value: Any) -> Any:
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _each_of(read: Callable[[Any], Any]) -> Callable[[Any], tuple[Any, ...]]:
    def read_all(values: Any) -> tuple[Any, ...]:
        if not isinstance(values, list | tuple) or len(values) > _MOST_PLACES:
            raise ValueError("what should be a list is none")
        return tuple(read(value) for value in values)

    return read_all


def _label(value: Any) -> int:
    if type(value) is not int or value < 1:
        raise ValueError(f"{value!r} is no number of a grain")
    return value


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is no number")
    return float(value)


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"{value!r} is neither true nor false")
    return value


def _axis(value: Any) -> int | None:
    if value is None or (type(value) is int and value in (0, 1, 2)):
        return value
    raise ValueError(f"{value!r} is no axis")


def _over(value: Any) -> str:
    if value not in ("void", "everything"):
        raise ValueError(f"{value!r} cannot be painted over")
    return str(value)


_READERS: Mapping[str, Callable[[Any], Any]] = {
    "labels": _each_of(_label),
    "anchors": _each_of(voxel_of),
    "seeds": _each_of(voxel_of),
    "points": _each_of(point_of),
    "centres": _each_of(point_of),
    "at": voxel_of,
    "apart": _flag,
    "by_grey": _flag,
    "by": _number,
    "radius": _number,
    "sigma": _number,
    "threshold": lambda value: None if value is None else _number(value),
    "axis": _axis,
    "over": _over,
}
