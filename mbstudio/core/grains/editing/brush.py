"""The round brush: painting, erasing and filling, in space or in one slice."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

from scipy import ndimage

from mbstudio.core.errors import EditError
from mbstudio.core.grains.editing.boxes import Voxel
from mbstudio.core.grains.editing.stroke_voxels import Point, find_under_stroke, say_beyond
from mbstudio.core.grains.editing.workbench import Workbench

Over = Literal["void", "everything"]
"""What a brush paints over: only what is no grain, or grains too."""

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
    box, under = find_under_stroke(bench.shape, bench.voxel_size, centres, radius, axis)
    seen = bench.seen(box)
    if not (under & seen).any():
        raise EditError(say_beyond(centres))
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
    box, under = find_under_stroke(bench.shape, bench.voxel_size, centres, radius, axis)
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
