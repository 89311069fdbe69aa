"""A label volume of which versions share all blocks of voxels that do not differ."""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Mapping
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Int

Box = tuple[slice, slice, slice]
"""A box of voxels along z, y, x; both ends of each slice are given, the second is left out."""

_EDGE = 16  # voxels: a version holds what it changed in blocks of 16 KiB


class LabelVolume:
    """Labels of voxels that never change: writing gives another volume.

    It holds the array that it began as and the blocks in which it differs from it, so that the many versions
    that editing makes cost little memory each. It is read like an array of three axes, by whole numbers and
    slices without steps back.

    Parameters
    ----------
    base : int array, shape (Z, Y, X)
        Made read-only; nobody may write to it any more.
    blocks, family
        Used by `written`.

    Attributes
    ----------
    family : object
        The same for all versions that were made of one volume by writing.
    """

    def __init__(
        self,
        base: Int[np.ndarray, "Z Y X"],
        blocks: Mapping[tuple[int, int, int], np.ndarray] | None = None,
        family: object | None = None,
    ) -> None:
        base.flags.writeable = False
        self._base = base
        self.family = family if family is not None else object()
        self._blocks = blocks if blocks is not None else MappingProxyType({})
        self._whole: weakref.ref[np.ndarray] | None = None
        self._kept: np.ndarray | None = None  # the whole, until another version is made of this one

    @property
    def shape(self) -> tuple[int, int, int]:
        nz, ny, nx = self._base.shape
        return nz, ny, nx

    @property
    def ndim(self) -> int:
        return 3

    @property
    def size(self) -> int:
        return self._base.size

    @property
    def dtype(self) -> np.dtype[Any]:
        return self._base.dtype

    @property
    def changed_bytes(self) -> int:
        """How much memory the blocks take in which this differs from the array that it began as."""
        return sum(block.nbytes for block in self._blocks.values())

    def __getitem__(self, key: Any) -> Any:
        """Return one label, or a new read-only array of those in a box or section."""
        keys = key if isinstance(key, tuple) else (key,)
        keys = (*keys, *(slice(None),) * (3 - len(keys)))
        box: list[slice] = []
        rest: list[slice | int] = []
        for part, count in zip(keys, self.shape, strict=True):
            if isinstance(part, slice):
                start, stop, step = part.indices(count)
                if step < 1:
                    raise IndexError(f"Labels are read forwards only, not by steps of {step}.")
                box.append(slice(start, max(start, stop)))
                rest.append(slice(None, None, step))
            else:
                index = int(part)
                if not -count <= index < count:
                    raise IndexError(f"Index {index} is outside an axis of {count} voxels.")
                box.append(slice(index % count, index % count + 1))
                rest.append(0)
        return self.read((box[0], box[1], box[2]))[tuple(rest)]

    def __array__(self, dtype: Any = None, /, *, copy: bool | None = None) -> np.ndarray:
        whole = self.whole()
        if dtype is not None and np.dtype(dtype) != whole.dtype:
            return whole.astype(dtype)
        return whole.copy() if copy else whole

    def read(self, box: Box) -> Int[np.ndarray, "z y x"]:
        """Return the labels in a box that lies inside the volume, as an array of their own if any differ.

        What is returned is read-only.
        """
        found = self._base[box]
        covering = self._covering(box)
        if covering:
            found = found.copy()
            for corner in covering:
                block = self._blocks[corner]
                into, of = _overlap(corner, block.shape, box)
                found[into] = block[of]
            found.flags.writeable = False
        return found

    def whole(self) -> Int[np.ndarray, "Z Y X"]:
        """Return all labels as one read-only array.

        It is kept until another version is made of this one: of a row of versions, only the last takes the
        memory of a whole.
        """
        if not self._blocks:
            return self._base
        found = self._whole() if self._whole is not None else None
        if found is None:
            found = self.read((slice(0, self.shape[0]), slice(0, self.shape[1]), slice(0, self.shape[2])))
            self._whole, self._kept = weakref.ref(found), found
        return found

    def written(self, box: Box, values: Int[np.ndarray, "z y x"]) -> LabelVolume:
        """Return the volume with other labels in a box; blocks in which nothing changes are shared."""
        self._kept = None
        highest = int(values.max(initial=0))
        if highest > np.iinfo(self.dtype).max:
            wider = np.int64 if highest >= 2**31 else np.int32
            return LabelVolume(self.whole().astype(wider), family=self.family).written(box, values)
        differing = values != self.read(box)
        blocks = dict(self._blocks)
        for corner in _corners(box):
            shape = _block_shape(corner, self.shape)
            into, of = _overlap(tuple(part.start for part in box), values.shape, _box_at(corner, shape))
            if not differing[of].any():
                continue
            block = blocks[corner].copy() if corner in blocks else self._base[_box_at(corner, shape)].copy()
            block[into] = values[of]
            block.flags.writeable = False
            blocks[corner] = block
        return LabelVolume(self._base, MappingProxyType(blocks), self.family)

    def _covering(self, box: Box) -> list[tuple[int, int, int]]:
        """Return the corners of this version's own blocks that reach into a box."""
        if not self._blocks:
            return []
        ranges = _ranges(box)
        if len(ranges[0]) * len(ranges[1]) * len(ranges[2]) <= len(self._blocks):
            return [corner for corner in product(*ranges) if corner in self._blocks]
        return [
            corner
            for corner in self._blocks
            if all(at in along for at, along in zip(corner, ranges, strict=True))
        ]


def _ranges(box: Box) -> tuple[range, range, range]:
    z, y, x = (range(part.start - part.start % _EDGE, part.stop, _EDGE) for part in box)
    return z, y, x


def _corners(box: Box) -> Iterator[tuple[int, int, int]]:
    return product(*_ranges(box))


def _block_shape(corner: tuple[int, ...], shape: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(min(_EDGE, count - at) for at, count in zip(corner, shape, strict=True))


def _box_at(corner: tuple[int, ...], shape: tuple[int, ...]) -> Box:
    z, y, x = (slice(at, at + count) for at, count in zip(corner, shape, strict=True))
    return z, y, x


def _overlap(corner: tuple[int, ...], shape: tuple[int, ...], box: Box) -> tuple[Box, Box]:
    """Return where what lies at a corner overlaps with a box: within the box, and within itself."""
    into, of = [], []
    for at, count, part in zip(corner, shape, box, strict=True):
        start, stop = max(at, part.start), min(at + count, part.stop)
        into.append(slice(start - part.start, stop - part.start))
        of.append(slice(start - at, stop - at))
    return (into[0], into[1], into[2]), (of[0], of[1], of[2])
