"""RAW: bare voxels in a file that says nothing about itself."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions, require_grey_volume
from mbstudio.core.scan.readers.pixels import plain_numbers


def read(path: Path, options: ReadOptions) -> Reading:
    """Map a RAW file of stated shape (z, y, x) and dtype into memory.

    Raises
    ------
    ScanError
        If shape or dtype is not stated, or the file is shorter or longer than they say.
    """
    if options.shape is None or options.dtype is None:
        raise ScanError(
            f"{path} is a RAW file, which does not describe itself: give shape=(z, y, x) and dtype, "
            "for example shape=(400, 512, 512), dtype='uint16'."
        )
    shape = tuple(int(count) for count in options.shape)
    if len(shape) != 3 or min(shape) < 1:
        raise ScanError(
            f"The shape {shape} given for {path} is impossible: give three positive numbers (z, y, x)."
        )
    if options.header_bytes < 0:
        raise ScanError(f"header_bytes={options.header_bytes} for {path} is impossible: give 0 or more.")
    dtype = options.dtype
    if dtype.itemsize > 1 and options.big_endian:
        dtype = dtype.newbyteorder(">")
    require_grey_volume(shape, dtype, path)
    needed = options.header_bytes + math.prod(shape) * dtype.itemsize
    present = path.stat().st_size
    if present < needed:
        raise ScanError(
            f"{path} has {present:,} bytes, but shape {shape} of {dtype.name} with a header of "
            f"{options.header_bytes} needs {needed:,}: "
            "check shape, dtype and header_bytes, or copy the file again."
        )
    if present > needed:
        raise ScanError(
            f"{path} has {present:,} bytes, {present - needed:,} more than shape {shape} of {dtype.name} "
            "needs: check shape and dtype, or give the surplus as header_bytes if it precedes the voxels."
        )
    return Reading(
        plain_numbers(np.memmap(path, dtype=dtype, mode="r", offset=options.header_bytes, shape=shape))
    )


FAMILY = Family("RAW voxels", (".raw", ".bin", ".vol", ".dat"), read)
