"""The round brush: painting, erasing and filling, in space or in one slice."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from mbstudio.core.errors import EditError
from mbstudio.core.grains.editing.boxes import Voxel, box_about
from mbstudio.core.grains.editing.label_volume import Box
from mbstudio.core.grains.editing.workbench import Workbench

Point = tuple[float, float, float]
"""A place (z, y, x) in voxels."""

Over = Literal["void", "everything"]
"""What a brush paints over: only what is no grain, or grains too."""

_LARGEST_RADIUS = 256.0
AXES = "zyx"


def paint(
    bench: Workbench, label: int, centres: Sequence[Point], radius: float, over: Over, axis: int | None
) -> None:
    """Give the voxels under a stroke to a grain.

    Parameters
    ----------
    label : int
        The grain, or a new number for a new one.
    centres : sequence of (z, y, x)
        Where the brush has been; between one and the next it moved straight.
    radius : float
        In voxels of the smallest edge.
    over : {"void", "everything"}
    axis : int or None
        The axis across which the slice lies that is painted in; None to paint in space.

    Raises
    ------
    EditError
        If nothing of the stroke lies within the field of view, or nothing changes.
    """
    if over not in get_args(Over):
        raise EditError(f"over='{over}' is not known: use 'void' or 'everything'.")
    box, under = _under_stroke(bench, centres, radius, axis)
    seen = bench.seen(box)
    if not (under & seen).any():
        raise EditError(_beyond(centres))
    values = bench.read(box).copy()
    values[under & seen & ((values == 0) | (over == "everything"))] = label
    if not bench.write(box, values):
        raise EditError("The stroke changes nothing: paint where other voxels are, or over everything.")


def erase(
    bench: Workbench, label: int | None, centres: Sequence[Point], radius: float, axis: int | None
) -> None:
    """Take the voxels under a stroke from a grain, or (with no label) from every grain; see `paint`."""
    if label is not None:
        bench.require((label,))
    box, under = _under_stroke(bench, centres, radius, axis)
    values = bench.read(box).copy()
    values[under & ((values == label) | (label is None))] = 0
    if not bench.write(box, values):
        what = "a grain" if label is None else f"grain {label}"
        raise EditError(f"The stroke touches no voxel of {what}: move it there.")


def fill(bench: Workbench, label: int, at: Voxel, axis: int) -> None:
    """Give the void about a place in a slice to the grain that encloses it there.

    Raises
    ------
    EditError
        If there is no void at the place, or the grain does not enclose it in the slice.
    """
    bench.require((label,))
    if axis not in (0, 1, 2):
        raise EditError(f"axis={axis} is none: give 0, 1 or 2 for z, y or x.")
    if bench.label_at(at, "The place to fill at") != 0:
        raise EditError(
            f"There is no void to fill at (z, y, x) = {tuple(at)}: choose a place outside grains."
        )
    z, y, x = (
        slice(at[axis], at[axis] + 1) if other == axis else part
        for other, part in enumerate(bench.box_with_margin(label, 1))
    )
    box = (z, y, x)
    values = bench.read(box).copy()
    place = tuple(index - part.start for index, part in zip(at, box, strict=True))
    leak = f"Grain {label} does not enclose (z, y, x) = {tuple(at)} in this slice: close its outline first."
    if not all(0 <= index < count for index, count in zip(place, values.shape, strict=True)):
        raise EditError(leak)
    void, _ = ndimage.label(values == 0)
    hole = void == void[place]
    for other in {0, 1, 2} - {axis}:
        if hole.take(0, other).any() or hole.take(-1, other).any():
            raise EditError(leak)
    values[hole & bench.seen(box)] = label
    bench.write(box, values)


def _under_stroke(
    bench: Workbench, centres: Sequence[Point], radius: float, axis: int | None
) -> tuple[Box, Bool[np.ndarray, "z y x"]]:
    """Return a box of voxels, and which of them lie under a stroke."""
    if not 0 < radius <= _LARGEST_RADIUS:
        raise EditError(f"A brush of radius {radius} is impossible: give 0 to {_LARGEST_RADIUS:g} voxels.")
    if axis not in (None, 0, 1, 2):
        raise EditError(f"axis={axis} is none: give 0, 1 or 2 for z, y or x, or None to paint in space.")
    places = np.array(centres, dtype=float).reshape(-1, 3)
    if not len(places):
        raise EditError("A stroke needs one place or more where the brush has been.")
    shortest = min(bench.voxel_size.zyx)
    size = np.array(bench.voxel_size.zyx) / shortest
    if axis is not None:
        places[:, axis] = np.rint(places[0, axis])
    box = box_about(places, float(np.ceil(radius)), bench.shape)
    if box is None:
        raise EditError(_beyond(centres))
    under = np.zeros(tuple(part.stop - part.start for part in box), dtype=bool)
    corner = np.array([part.start for part in box])
    for start, end in pairwise(places) if len(places) > 1 else [(places[0], places[0])]:
        piece = box_about(np.array([start, end]), float(np.ceil(radius)), bench.shape)
        if piece is None:
            continue
        z, y, x = (slice(p.start - c, p.stop - c) for p, c in zip(piece, corner.tolist(), strict=True))
        under[z, y, x] |= _distance_to_way(piece, start, end, size) <= radius
    if axis is not None:
        at = int(places[0, axis])
        if not box[axis].start <= at < box[axis].stop:
            raise EditError(_beyond(centres))
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


def _beyond(centres: Sequence[Point]) -> str:
    z, y, x = centres[0]
    return (
        f"The stroke that begins at (z, y, x) = ({z:g}, {y:g}, {x:g}) lies beyond the field of view: "
        "paint where the scan has seen something."
    )
