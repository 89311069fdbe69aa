"""What a scan's voxels must offer, whether they lie in memory or on disk."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np


class VoxelArray(Protocol):
    """What a scan's voxels must offer: enough of an array to be sliced without reading all."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def dtype(self) -> np.dtype[Any]: ...
    @property
    def ndim(self) -> int: ...
    def __getitem__(self, key: Any) -> Any: ...
    def __array__(self, dtype: Any = None, /, *, copy: bool | None = None) -> np.ndarray: ...
