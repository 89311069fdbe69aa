"""A volume made of slices that are read when they are asked for."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np

Block = tuple[slice, slice, slice]
# All voxels are read in blocks of about this size.
_BLOCK_BYTES = 64 << 20


class SliceStack:
    """Array-like volume over a function that reads one slice; the last few slices are kept.

    Parameters
    ----------
    read_slice : callable
        ``read_slice(index) -> array (Y, X)``; must check the shape itself.
    shape : tuple of int
        (Z, Y, X).
    dtype : numpy dtype
    kept : int
        Number of slices kept in memory.
    read_block : callable, optional
        ``read_block((z, y, x)) -> array``, for slices with both ends within the shape: a quicker
        way to many slices, or to a part of them.
    """

    def __init__(
        self,
        read_slice: Callable[[int], np.ndarray],
        shape: tuple[int, int, int],
        dtype: np.dtype[Any],
        kept: int = 16,
        read_block: Callable[[Block], np.ndarray] | None = None,
    ) -> None:
        self._read_slice = read_slice
        self._read_block = read_block
        self._shape = shape
        self._dtype = np.dtype(dtype)
        self._kept = kept
        self._cache: OrderedDict[int, np.ndarray] = OrderedDict()
        self._lock = Lock()

    @classmethod
    def of_blocks(
        cls, read_block: Callable[[Block], np.ndarray], shape: tuple[int, int, int], dtype: np.dtype[Any]
    ) -> SliceStack:
        """Return a stack over a function that reads any block of voxels (see `read_block` above)."""
        rows, columns = slice(0, shape[1]), slice(0, shape[2])

        def read_slice(index: int) -> np.ndarray:
            image: np.ndarray = read_block((slice(index, index + 1), rows, columns))[0]
            return image

        return cls(read_slice, shape, dtype, read_block=read_block)

    @property
    def shape(self) -> tuple[int, int, int]:
        return self._shape

    @property
    def dtype(self) -> np.dtype[Any]:
        return self._dtype

    @property
    def ndim(self) -> int:
        return 3

    @property
    def size(self) -> int:
        return self._shape[0] * self._shape[1] * self._shape[2]

    @property
    def nbytes(self) -> int:
        return self.size * self._dtype.itemsize

    def __len__(self) -> int:
        return self._shape[0]

    def _slice(self, index: int) -> np.ndarray:
        with self._lock:
            if index in self._cache:
                self._cache.move_to_end(index)
                return self._cache[index]
        image = self._read_slice(index)
        image.flags.writeable = False
        with self._lock:
            self._cache[index] = image
            while len(self._cache) > self._kept:
                self._cache.popitem(last=False)
        return image

    def __getitem__(self, key: Any) -> Any:
        """Index as numpy does; only the slices that the first index names are read."""
        keys = key if isinstance(key, tuple) else (key,)
        if any(part is None or (isinstance(part, np.ndarray) and part.ndim > 1) for part in keys):
            return np.asarray(self)[key]
        if keys and keys[0] is Ellipsis:
            keys = (slice(None),) * (4 - len(keys)) + keys[1:]
        block = self._block(keys)
        if block is not None and self._read_block is not None:
            return self._read_block(block)
        first, rest = (keys[0], keys[1:]) if keys else (slice(None), ())
        if isinstance(first, int | np.integer):
            index = int(first) + (self._shape[0] if first < 0 else 0)
            if not 0 <= index < self._shape[0]:
                raise IndexError(f"slice {first} is outside a stack of {self._shape[0]} slices")
            return self._slice(index)[rest]
        chosen = np.arange(self._shape[0])[first]
        if not len(chosen):
            return np.empty(self._shape, self._dtype)[:0][(slice(None), *rest)]
        return np.stack([self._slice(int(index))[rest] for index in chosen])

    def _block(self, keys: tuple[Any, ...]) -> Block | None:
        """Return keys that are slices without a step as slices with both ends; None if there are others."""
        parts = (*keys, *(slice(None),) * (3 - len(keys)))
        ends = []
        for part, count in zip(parts, self._shape, strict=True):
            if not isinstance(part, slice):
                return None
            start, stop, step = part.indices(count)
            if step != 1 or start >= stop:
                return None
            ends.append(slice(start, stop))
        z, y, x = ends
        return z, y, x

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        if copy is False:
            raise ValueError("A stack of slices on disk cannot become an array without copying.")
        volume = np.empty(self._shape, self._dtype if dtype is None else dtype)
        if self._read_block is not None:
            step = max(1, _BLOCK_BYTES // max(1, self.nbytes // self._shape[0]))
            for first in range(0, self._shape[0], step):
                volume[first : first + step] = self[first : first + step]
            return volume
        for index in range(self._shape[0]):
            volume[index] = self._read_slice(index)
        return volume
