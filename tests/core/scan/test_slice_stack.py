"""The lazy stack reads only what is asked for and indexes as numpy does."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mbstudio.core.scan.slice_stack import SliceStack


@pytest.fixture
def stack() -> tuple[SliceStack, np.ndarray, list[int]]:
    volume = np.arange(6 * 4 * 5).reshape(6, 4, 5)
    reads: list[int] = []

    def read_slice(index: int) -> np.ndarray:
        reads.append(index)
        return volume[index].copy()

    return SliceStack(read_slice, (6, 4, 5), volume.dtype, kept=2), volume, reads


@pytest.mark.parametrize(
    "key",
    [2, -1, slice(1, 4), slice(None, None, -2), (3, 1), (3, slice(1, 3), 2), (slice(None), 2, 2), (..., 1),
     (Ellipsis,), (2, ..., 1), ([0, 5], 1), (slice(4, 4),), np.array([1, 3])],
)  # fmt: skip
def test_indexing_is_numpys(stack: tuple[SliceStack, np.ndarray, list[int]], key: Any) -> None:
    lazy, volume, _ = stack
    np.testing.assert_array_equal(lazy[key], volume[key])


def test_one_slice_is_read_once(stack: tuple[SliceStack, np.ndarray, list[int]]) -> None:
    lazy, _, reads = stack
    lazy[3]
    lazy[3, 1]
    assert reads == [3]
    assert not lazy[3].flags.writeable
    lazy[0]
    lazy[1]
    lazy[3]
    assert reads == [3, 0, 1, 3]  # two slices are kept


def test_the_whole_as_an_array(stack: tuple[SliceStack, np.ndarray, list[int]]) -> None:
    lazy, volume, _ = stack
    np.testing.assert_array_equal(np.asarray(lazy), volume)
    assert np.asarray(lazy, dtype=np.float32).dtype == np.float32
    with pytest.raises(IndexError):
        lazy[6]
    with pytest.raises(ValueError, match="copy"):
        np.array(lazy, copy=False)
