"""NPY: numpy's own array file, memory-mapped."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions, require_grey_volume


def read(path: Path, options: ReadOptions) -> Reading:
    """Map an NPY file into memory; pickled objects are refused.

    Raises
    ------
    ScanError
        If the file is truncated, no array file, or no grey volume.
    """
    try:
        voxels = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise ScanError(
            f"{path} cannot be read as an NPY array ({error}): save it again with numpy.save."
        ) from error
    require_grey_volume(voxels.shape, voxels.dtype, path)
    return Reading(voxels)


FAMILY = Family("NumPy array", (".npy",), read)
