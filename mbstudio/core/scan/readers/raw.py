"""RAW: bare voxels in a file that says nothing about itself; what lies beside it, or its name, may."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions, require_grey_volume
from mbstudio.core.scan.readers.pixels import plain_numbers
from mbstudio.core.scan.readers.side_cars import voreen
from mbstudio.core.scan.readers.side_cars.beside import is_described, read_beside
from mbstudio.core.scan.readers.side_cars.layout import open_layout
from mbstudio.core.scan.readers.side_cars.names import read_by_name, says_shape


def read(path: Path, options: ReadOptions) -> Reading:
    """Map a RAW file into memory: as stated, or else as a side-car, or else as its name describes it.

    Raises
    ------
    ScanError
        If nothing says shape and type of the voxels, or the file is shorter or longer than that.
    """
    if options.shape is None:
        described = _described(path, options)
        if described is not None:
            return described
    if options.shape is None or options.dtype is None:
        raise ScanError(
            f"{path} is a RAW file, which does not describe itself, and nothing beside it does: "
            "give shape=(z, y, x) and dtype, for example shape=(400, 512, 512), dtype='uint16'."
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


def describes_itself(path: Path) -> bool:
    """Return whether a RAW file's name, or a file beside it, seems to say shape and type of its voxels."""
    try:
        return says_shape(path) or _is_description(path) or is_described(path)
    except (ScanError, OSError):
        return True  # something is there that cannot be read: opening the file says what


def _described(path: Path, options: ReadOptions) -> Reading | None:
    if _is_description(path):
        layout = voreen.describe(path)
        assert layout is not None
        return open_layout(layout, options)
    return read_beside(path, options) or read_by_name(path, options)


def _is_description(path: Path) -> bool:
    return path.suffix.lower() == ".dat" and path.is_file() and voreen.is_description(path)


FAMILY = Family("RAW voxels", (".raw", ".bin", ".vol", ".dat"), read)
