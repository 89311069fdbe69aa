"""Which voxels lie under the stroke of a round brush."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from mbstudio.core.errors import EditError
from mbstudio.core.grains.editing.boxes import box_about
from mbstudio.core.grains.editing.label_volume import Box
from mbstudio.core.units import VoxelSize

Point = tuple[float, float, float]
"""A place (z, y, x) in voxels."""

LARGEST_RADIUS = 256.0


def find_under_stroke(
    shape: Sequence[int], voxel_size: VoxelSize, centres: Sequence[Point], radius: float, axis: int | None
) -> tuple[Box, Bool[np.ndarray, "z y x"]]:
    """Return a box of voxels, and which of them lie under a stroke.

    Parameters
    ----------
    shape : sequence of int
        (Z, Y, X) of the scan.
    voxel_size : VoxelSize
    centres : sequence of (z, y, x)
        Where the brush has been; between one and the next it moved straight.
    radius : float
        In voxels of the smallest edge.
    axis : int or None
        The axis across which the slice lies that is painted in; None to paint in space.

    Raises
    ------
    EditError
        If there is no such brush, or all of the stroke lies beyond the scan.
    """
    if not 0 < radius <= LARGEST_RADIUS:
        raise EditError(f"A brush of radius {radius} is impossible: give 0 to {LARGEST_RADIUS:g} voxels.")
    if axis not in (None, 0, 1, 2):
        raise EditError(f"axis={axis} is none: give 0, 1 or 2 for z, y or x, or None to paint in space.")
    places = np.array(centres, dtype=float).reshape(-1, 3)
    if not len(places):
        raise EditError("A stroke needs one place or more where the brush has been.")
    shortest = min(voxel_size.zyx)
    size = np.array(voxel_size.zyx) / shortest
    if axis is not None:
        places[:, axis] = np.rint(places[0, axis])
    box = box_about(places, float(np.ceil(radius)), shape)
    if box is None:
        raise EditError(say_beyond(centres))
    under = np.zeros(tuple(part.stop - part.start for part in box), dtype=bool)
    corner = np.array([part.start for part in box])
    for start, end in pairwise(places) if len(places) > 1 else [(places[0], places[0])]:
        piece = box_about(np.array([start, end]), float(np.ceil(radius)), shape)
        if piece is None:
            continue
        z, y, x = (slice(p.start - c, p.stop - c) for p, c in zip(piece, corner.tolist(), strict=True))
        under[z, y, x] |= _distance_to_way(piece, start, end, size) <= radius
    if axis is not None:
        at = int(places[0, axis])
        if not box[axis].start <= at < box[axis].stop:
            raise EditError(say_beyond(centres))
        flat = np.zeros_like(under)
        layer = tuple(
            slice(at - box[axis].start, at - box[axis].start + 1) if k == axis else slice(None)
            for k in range(3)
        )
        flat[layer] = under[layer]
        under = flat
    return box, under


def _distance_to_way(
    box: Box, start: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"], size: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "z y x"]:
    """Return the distance of voxels to the straight way between two places, in the smallest edge."""
    along = (end - start) * size
    length = float(along @ along)
    offsets = [
        ((np.arange(part.start, part.stop) - at) * edge).reshape([-1 if k == axis else 1 for k in range(3)])
        for axis, (part, at, edge) in enumerate(zip(box, start, size, strict=True))
    ]
    share: np.ndarray | float = 0.0
    if length > 0:
        share = np.clip(
            sum(offset * step for offset, step in zip(offsets, along, strict=True)) / length, 0.0, 1.0
        )
    squares = [(offset - share * step) ** 2 for offset, step in zip(offsets, along, strict=True)]
    distance: np.ndarray = np.sqrt(squares[0] + squares[1] + squares[2])
    return distance


def say_beyond(centres: Sequence[Point]) -> str:
    """Return what to say of a stroke that lies beyond what was scanned."""
    z, y, x = centres[0]
    return (
        f"The stroke that begins at (z, y, x) = ({z:g}, {y:g}, {x:g}) lies beyond the field of view: "
        "paint where the scan has seen something."
    )
