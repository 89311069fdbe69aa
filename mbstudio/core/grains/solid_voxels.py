"""The voxels of grains as a scan of two grey values, so that grains without a scan can be cut like one."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Int

from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.scan.scan import Scan

VOID, SOLID = 0, 1


class SolidVoxels:
    """1 in grains and 0 beside them, found where it is asked for: the label volume may be large."""

    dtype = np.dtype(np.uint8)
    ndim = 3

    def __init__(self, labels: Int[np.ndarray, "Z Y X"]) -> None:
        self._labels = labels

    @property
    def shape(self) -> tuple[int, ...]:
        return self._labels.shape

    def __getitem__(self, key: Any) -> Any:
        return np.where(np.asarray(self._labels[key]) > 0, np.uint8(SOLID), np.uint8(VOID))

    def __array__(self, dtype: Any = None, /, *, copy: bool | None = None) -> np.ndarray:
        voxels: np.ndarray = self[:]
        return voxels if dtype is None else voxels.astype(dtype)


def solid_as_scan(grains: GrainSet) -> Scan:
    """Return the voxels of grains in place of the scan that they do not have."""
    return Scan(SolidVoxels(grains.labels), grains.voxel_size, grains.origin)
