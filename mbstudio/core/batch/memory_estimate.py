"""How much memory a segmentation will take, before it begins.

The numbers are measured (docs/benchmarks.md). At most five records of four bytes a voxel are held at a time:
grey values in single precision, masks, distances to the surface, the order of the flooding, labels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mbstudio.core.memory import free_memory, readable_bytes
from mbstudio.core.scan.scan import Scan

# Bytes per voxel at the highest point, beside the scan's own; a little above the largest that was measured.
BYTES_PER_VOXEL = 20
# The order of the flooding is twice as wide where there are more voxels than four bytes can number.
_WIDE_ORDER, _WIDER = 2**31, 4
# What every segmentation takes, however small the scan: what it loads, and the judging of the grains.
_AT_LEAST = 220_000_000
# From this share of the free memory on it is worth telling.
_WORTH_TELLING = 0.25


@dataclass(frozen=True)
class MemoryNeed:
    """What a segmentation will take, and what there is.

    Attributes
    ----------
    needed : int
        Bytes at the highest point, estimated.
    free : int or None
        Bytes that new data can take; None where the system does not say.
    """

    needed: int
    free: int | None

    @property
    def fits(self) -> bool:
        return self.free is None or self.needed <= self.free

    @property
    def is_worth_telling(self) -> bool:
        """Whether a good part of the free memory will be taken."""
        return self.free is not None and self.needed > _WORTH_TELLING * self.free

    def describe(self) -> str:
        """Return both in words, without a verb before and a full stop behind."""
        needed = f"about {readable_bytes(self.needed, 2)} of memory"
        return needed if self.free is None else f"{needed}, {readable_bytes(self.free, 2)} are free"


def segmentation_bytes(shape: tuple[int, ...], dtype: np.dtype[np.generic], *, in_memory: bool = True) -> int:
    """Return the bytes that finding the grains of a scan takes beyond what is held already.

    Parameters
    ----------
    shape : tuple of int
        Number of voxels along z, y, x.
    dtype : numpy dtype
        Type of a voxel.
    in_memory : bool
        Whether the voxels are in memory already, or mapped: these the system lets go of by itself.
    """
    # Impulses, and voxels that are no numbers, are replaced in a copy.
    copies = 1 if in_memory else 2
    count = math.prod(shape)
    each = BYTES_PER_VOXEL + copies * dtype.itemsize + (_WIDER if count >= _WIDE_ORDER else 0)
    return _AT_LEAST + count * each


def need_of_segmentation(scan: Scan) -> MemoryNeed:
    """Return what finding the grains of a scan will take, and what is free now."""
    lazy = not isinstance(scan.voxels, np.ndarray)
    needed = segmentation_bytes(scan.shape, np.dtype(scan.voxels.dtype), in_memory=not lazy)
    return MemoryNeed(needed, free_memory())
