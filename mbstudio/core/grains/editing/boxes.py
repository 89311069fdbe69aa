"""Boxes of voxels: about grains, places and strokes, within a volume."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from mbstudio.core.grains.editing.label_volume import Box

Voxel = tuple[int, int, int]
"""Indices (z, y, x) of a voxel."""


def box_of_row(row: Sequence[int] | Int[np.ndarray, "6"]) -> Box:
    """Return the box of a table's columns z0, z1, y0, y1, x0, x1."""
    z0, z1, y0, y1, x0, x1 = (int(end) for end in row)
    return slice(z0, z1), slice(y0, y1), slice(x0, x1)


def joined(boxes: Iterable[Box]) -> Box:
    """Return the smallest box that holds some boxes, at least one."""
    every = list(boxes)
    z, y, x = (
        slice(min(box[axis].start for box in every), max(box[axis].stop for box in every))
        for axis in range(3)
    )
    return z, y, x


def widened(box: Box, margin: int, shape: Sequence[int]) -> Box:
    """Return a box with a margin about it, as far as the volume reaches."""
    z, y, x = (
        slice(max(part.start - margin, 0), min(part.stop + margin, count))
        for part, count in zip(box, shape, strict=True)
    )
    return z, y, x


def box_about(places: Float[np.ndarray, "n 3"], margin: float, shape: Sequence[int]) -> Box | None:
    """Return the box of all voxels within a distance of places along each axis; None if none is inside."""
    low = np.maximum(np.ceil(places.min(axis=0) - margin), 0).astype(int)
    high = np.minimum(np.floor(places.max(axis=0) + margin) + 1, shape).astype(int)
    if (low >= high).any():
        return None
    z, y, x = (slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    return z, y, x


def within(inner: Box, outer: Box) -> Box:
    """Return a box in the indices of a larger one."""
    z, y, x = (
        slice(part.start - start.start, part.stop - start.start)
        for part, start in zip(inner, outer, strict=True)
    )
    return z, y, x


def crop_to(mask: Bool[np.ndarray, "z y x"], box: Box) -> Box | None:
    """Return the smallest box about the true voxels of a mask that covers `box`; None if there are none."""
    found = []
    for axis, part in enumerate(box):
        others = tuple(other for other in range(3) if other != axis)
        hits = np.flatnonzero(mask.any(axis=others))
        if not len(hits):
            return None
        found.append(slice(part.start + int(hits[0]), part.start + int(hits[-1]) + 1))
    return found[0], found[1], found[2]


def holds(shape: Sequence[int], voxel: Sequence[float]) -> bool:
    """Whether a voxel lies inside a volume."""
    return all(0 <= at < count for at, count in zip(voxel, shape, strict=True))
