"""NPY: numpy's own array file, memory-mapped."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.family import (
    Family,
    Reading,
    ReadOptions,
    memory_refusal,
    require_grey_volume,
)
from mbstudio.core.scan.readers.pixels import PixelMeaning, decode, plain_numbers


def read(path: Path, options: ReadOptions) -> Reading:
    """Map an NPY file into memory; pickled objects are refused.

    Raises
    ------
    ScanError
        If the file is truncated, no array file, or no grey volume.
    """
    if path.name.endswith("_seg.npy"):
        raise ScanError(
            f"{path} is a Cellpose file, a pickle that could run any code and is never opened: "
            "save the masks as TIFF (File > Save masks as TIFF, *_cp_masks.tif) and open that."
        )
    try:
        voxels = np.load(path, mmap_mode="r", allow_pickle=False)
    except MemoryError as error:
        raise memory_refusal(path) from error
    except Exception as error:  # of a wrong header, numpy raises errors of many unrelated types
        if "allow_pickle" in str(error) or "Object arrays" in str(error):
            raise ScanError(
                f"{path} contains pickled objects, which could run any code and are never opened: "
                "save the plain array with numpy.save."
            ) from error
        raise ScanError(
            f"{path} cannot be read as an NPY array ({error}): save it again with numpy.save."
        ) from error
    if voxels.ndim == 4 and voxels.shape[-1] in (2, 3, 4):
        voxels = decode(voxels, PixelMeaning(samples=voxels.shape[-1]), path, numbers=options.numbers)
    while voxels.ndim > 3 and 1 in voxels.shape:
        voxels = voxels.reshape([count for axis, count in enumerate(voxels.shape)
                                 if axis != voxels.shape.index(1)])  # fmt: skip
    require_grey_volume(voxels.shape, voxels.dtype, path)
    return Reading(plain_numbers(voxels))


FAMILY = Family("NumPy array", (".npy",), read)
