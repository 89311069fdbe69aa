"""The runs (HxByteRLE) in which AmiraMesh packs its labels."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbstudio.core.compiled import compiled
from mbstudio.core.errors import ScanError


def unrolled(content: bytes, needed: int, path: Path) -> np.ndarray:
    """Return the bytes of runs (HxByteRLE), which must be as many as needed.

    Raises
    ------
    ScanError
        If they are more or fewer.
    """
    out = np.empty(needed, np.uint8)
    count = int(_unroll(np.frombuffer(content, np.uint8), out))
    if count != needed:
        raise ScanError(
            f"{path} holds {'more' if count > needed else 'fewer'} packed voxels than its header states "
            f"({needed:,}): it is damaged or cut off; copy or export it again."
        )
    return out


@compiled()
def _unroll(packed: np.ndarray, out: np.ndarray) -> int:
    """Fill `out`; return how many bytes the runs hold, or one more than `out` if they hold too many."""
    place, count = 0, 0
    while place < len(packed):
        control = packed[place]
        length = int(control & 0x7F)
        place += 1
        if count + length > len(out):
            return len(out) + 1
        if control & 0x80:
            if place + length > len(packed):
                return -1
            for index in range(length):
                out[count + index] = packed[place + index]
            place += length
        else:
            if place >= len(packed):
                return -1
            for index in range(length):
                out[count + index] = packed[place]
            place += 1
        count += length
    return count
