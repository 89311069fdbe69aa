"""Strokes of a brush that say of what kind voxels are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Int64

from mbstudio.core.errors import ClassifierError, EditError
from mbstudio.core.grains.editing.stroke_voxels import Point, find_under_stroke
from mbstudio.core.translation import mark
from mbstudio.core.units import VoxelSize

Kind = Literal["void", "grain", "mineral", "border"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""What voxels can be: void, grain, grain of a second mineral, border where two grains touch."""
TITLES: Mapping[str, str] = {
    "void": mark("Void"),
    "grain": mark("Grain"),
    "mineral": mark("Second mineral"),
    "border": mark("Border between grains"),
    "": mark("Take strokes away"),
}
_MOST_PLACES = 100_000


@dataclass(frozen=True)
class Stroke:
    """One stroke of a round brush.

    Attributes
    ----------
    kind : str
        One of `KINDS`; empty to take away what was painted there before.
    centres : tuple of (z, y, x)
        Where the brush has been, in voxels; between one and the next it moved straight.
    radius : float
        In voxels of the smallest edge.
    axis : int or None
        The axis across which the slice lies that was painted in; None for a ball in space.

    Raises
    ------
    ClassifierError
        If there is no such kind or brush, or no place.
    """

    kind: str
    centres: tuple[Point, ...]
    radius: float = 1.5
    axis: int | None = 0

    def __post_init__(self) -> None:
        if self.kind not in TITLES:
            raise ClassifierError(f"'{self.kind}' is no kind of voxel: use {', '.join(KINDS)}.")
        centres = tuple((float(z), float(y), float(x)) for z, y, x in self.centres)
        if not centres or not all(math.isfinite(value) for place in centres for value in place):
            raise ClassifierError("A stroke needs one place (z, y, x) or more, in finite numbers.")
        object.__setattr__(self, "centres", centres)

    def to_record(self) -> dict[str, Any]:
        """Return the stroke for JSON."""
        return {
            "kind": self.kind,
            "centres": [list(place) for place in self.centres],
            "radius": self.radius,
            "axis": self.axis,
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Stroke:
        """Return the stroke of a record of `to_record`.

        Raises
        ------
        ClassifierError
            If it is none.
        """
        centres, radius, axis = record.get("centres"), record.get("radius"), record.get("axis")
        if (
            not isinstance(centres, list)
            or not 1 <= len(centres) <= _MOST_PLACES
            or not all(isinstance(place, list) and len(place) == 3 for place in centres)
            or not all(_is_number(value) for place in centres for value in place)
            or not _is_number(radius)
            or not (axis is None or (type(axis) is int and axis in (0, 1, 2)))
        ):
            raise ClassifierError("A stroke of the brush is damaged: paint it anew.")
        return cls(
            str(record.get("kind")),
            tuple((float(z), float(y), float(x)) for z, y, x in centres),
            float(record["radius"]),
            axis,
        )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def voxels_of(
    strokes: Sequence[Stroke], shape: tuple[int, int, int], voxel_size: VoxelSize
) -> tuple[Int64[np.ndarray, " n"], Int64[np.ndarray, " n"]]:
    """Return the flat indices of all painted voxels, ascending, and the number of the kind of each.

    Where strokes cross, the last counts.

    Raises
    ------
    ClassifierError
        If a stroke lies outside the scan.
    """
    indices, kinds = [], []
    for number, stroke in enumerate(strokes, start=1):
        try:
            box, under = find_under_stroke(shape, voxel_size, stroke.centres, stroke.radius, stroke.axis)
        except EditError as error:
            raise ClassifierError(f"Stroke {number} ({stroke.kind or 'erase'}): {error}") from error
        at = np.nonzero(under)
        if not len(at[0]):
            z, y, x = stroke.centres[0]
            raise ClassifierError(
                f"Stroke {number} ({stroke.kind or 'erase'}) at (z, y, x) = ({z:g}, {y:g}, {x:g}) lies "
                "outside the scan: paint within it."
            )
        places = [index + part.start for index, part in zip(at, box, strict=True)]
        flat = np.ravel_multi_index(tuple(places), shape)
        indices.append(flat)
        kinds.append(np.full(len(flat), KINDS.index(stroke.kind) if stroke.kind else -1))
    if not indices:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    # The last stroke over a voxel is the first from behind.
    every, of_kind = np.concatenate(indices)[::-1], np.concatenate(kinds)[::-1]
    found, first = np.unique(every, return_index=True)
    kept = of_kind[first] >= 0
    return found[kept].astype(np.int64), of_kind[first][kept].astype(np.int64)
