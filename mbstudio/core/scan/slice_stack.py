"""A volume made of slices that are read when they are asked for."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np


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
    """

    def __init__(
        self,
        read_slice: Callable[[int], np.ndarray],
        shape: tuple[int, int, int],
        dtype: np.dtype[Any],
        kept: int = 16,
    ) -> None:
        self._read_slice = read_slice
        self._shape = shape
        self._dtype = np.dtype(dtype)
        self._kept = kept
        self._cache: OrderedDict[int, np.ndarray] = OrderedDict()
        self._lock = Lock()

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

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        if copy is False:
            raise ValueError("A stack of slices on disk cannot become an array without a copy.")
        volume = np.empty(self._shape, self._dtype if dtype is None else dtype)
        for index in range(self._shape[0]):
            volume[index] = self._read_slice(index)
        return volume
