"""A region of a scan's voxels, and the means of blocks of them, read slab by slab."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from jaxtyping import Shaped

from mbstudio.core.scan.excerpt import Counts
from mbstudio.core.scan.field_of_view import FieldOfView, find_field_of_view
from mbstudio.core.scan.slice_stack import Block, SliceStack
from mbstudio.core.scan.voxel_array import VoxelArray

# Voxels are averaged in slabs of about so many bytes of double precision.
_SLAB_BYTES = 64 << 20


def region(voxels: VoxelArray, block: Block) -> VoxelArray:
    """Return the voxels of a block, as a view where they lie in memory or are mapped, else yet unread."""
    if isinstance(voxels, np.memmap):
        return _mapped_region(voxels, block)
    if isinstance(voxels, np.ndarray):
        return voxels[block]
    z, y, x = block

    def read_block(part: Block) -> np.ndarray:
        inside = (_within(z, part[0]), _within(y, part[1]), _within(x, part[2]))
        return np.ascontiguousarray(voxels[inside])

    shape = (z.stop - z.start, y.stop - y.start, x.stop - x.start)
    return SliceStack.of_blocks(read_block, shape, voxels.dtype)


def _within(outer: slice, inner: slice) -> slice:
    return slice(outer.start + inner.start, outer.start + inner.stop)


def _mapped_region(voxels: np.memmap, block: Block) -> np.ndarray:
    """Return a view of mapped voxels; a map of its own if they lie one behind the other."""
    view = voxels[block]
    z, y, x = block
    rows = (slice(0, voxels.shape[1]), slice(0, voxels.shape[2]))
    if (y, x) == rows and voxels.flags.c_contiguous and voxels.filename is not None:
        offset = voxels.offset + z.start * voxels.strides[0]
        return np.memmap(voxels.filename, voxels.dtype, "r", offset, view.shape)
    # A view of a map would name the place of the map, not its own.
    return view.view(np.ndarray)


def block_means(voxels: VoxelArray, factors: Counts) -> VoxelArray:
    """Return the means of blocks of voxels, computed when they are asked for.

    Parameters
    ----------
    voxels : VoxelArray, shape (Z, Y, X)
        Of whole blocks.
    factors : tuple of int
        Voxels of a block along z, y, x.

    Returns
    -------
    VoxelArray
        Of the same type: means of whole numbers are rounded, halves to the even number. A block
        with a voxel outside the field of view is outside, with the value that pads the box there;
        one with a voxel that is no finite number is none.
    """
    view = find_field_of_view(voxels)
    shape = tuple(count // factor for count, factor in zip(voxels.shape, factors, strict=True))
    unseen = _unseen_blocks(view, factors, shape)

    def read_block(part: Block) -> np.ndarray:
        means = np.empty([one.stop - one.start for one in part], voxels.dtype)
        _, fy, fx = factors
        row = (part[1].stop - part[1].start) * fy * (part[2].stop - part[2].start) * fx * factors[0] * 8
        step = max(1, _SLAB_BYTES // row)
        for first in range(part[0].start, part[0].stop, step):
            last = min(first + step, part[0].stop)
            slab = (slice(first, last), part[1], part[2])
            inside = tuple(
                slice(one.start * factor, one.stop * factor)
                for one, factor in zip(slab, factors, strict=True)
            )
            target = means[first - part[0].start : last - part[0].start]
            target[...] = _mean(np.asarray(voxels[inside]), factors)
            if unseen is not None:
                target[unseen[slab]] = view.padding
        return means

    return SliceStack.of_blocks(read_block, (shape[0], shape[1], shape[2]), voxels.dtype)


def _unseen_blocks(view: FieldOfView, factors: Counts, shape: tuple[int, ...]) -> np.ndarray | None:
    """Return which blocks hold a voxel outside the field of view, None where there is no outside."""
    if view.is_whole_box:
        return None
    beside = [axis for axis in range(3) if axis != view.axis]
    (fa, na), (fb, nb) = ((factors[axis], shape[axis]) for axis in beside)
    seen = view.footprint.reshape(na, fa, nb, fb).all(axis=(1, 3))
    unseen: np.ndarray = np.broadcast_to(np.expand_dims(~seen, view.axis), shape)
    return unseen


def _mean(block: Shaped[np.ndarray, "Z Y X"], factors: Counts) -> Shaped[np.ndarray, "z y x"]:
    """Return the means of whole blocks, in the type of the voxels."""
    nz, ny, nx = (count // factor for count, factor in zip(block.shape, factors, strict=True))
    fz, fy, fx = factors
    parted = block.reshape(nz, fz, ny, fy, nx, fx)
    # An infinite voxel makes its block infinite or no number: outside, as it was.
    with np.errstate(invalid="ignore", over="ignore"):
        means: np.ndarray = parted.mean(axis=(1, 3, 5), dtype=np.float64)
    if block.dtype.kind in "iu":
        np.rint(means, out=means)
    return means.astype(block.dtype)


def is_mapped(voxels: VoxelArray) -> bool:
    """Return whether voxels lie on disk and are mapped into memory, or are a part of such."""
    while isinstance(voxels, np.ndarray):
        if isinstance(voxels, np.memmap):
            return True
        voxels = voxels.base  # type: ignore[assignment]
    return False


def in_memory_bytes(shape: Counts, dtype: np.dtype[Any]) -> int:
    """Return the bytes that voxels take in memory."""
    return math.prod(shape) * dtype.itemsize
