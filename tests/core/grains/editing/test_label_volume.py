"""Versions of labels share what does not differ and read like arrays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbstudio.core.grains.editing import LabelVolume

SHAPE = (21, 40, 35)


@pytest.fixture
def base(rng) -> np.ndarray:
    return rng.integers(0, 9, SHAPE).astype(np.int32)


def boxes():
    def along(count: int):
        return st.tuples(st.integers(0, count - 1), st.integers(1, count)).map(
            lambda ends: slice(ends[0], min(ends[0] + ends[1], count))
        )

    return st.tuples(*map(along, SHAPE))


@settings(max_examples=25)
@given(st.lists(boxes(), min_size=1, max_size=5), st.integers(0, 2**32 - 1))
def test_writing_gives_another_volume_and_leaves_the_first(written, seed):
    rng = np.random.default_rng(seed)
    expected = rng.integers(0, 9, SHAPE).astype(np.int32)
    versions = [(LabelVolume(expected.copy()), expected.copy())]
    for box in written:
        expected = versions[-1][1].copy()
        expected[box] = rng.integers(0, 99, expected[box].shape)
        versions.append((versions[-1][0].written(box, expected[box]), expected))
    for volume, known in versions:
        assert np.array_equal(volume.whole(), known)
        for box in written:
            assert np.array_equal(volume.read(box), known[box])


def test_it_reads_like_an_array(base):
    volume = LabelVolume(base.copy()).written(
        (slice(3, 9), slice(10, 30), slice(0, 35)), np.full((6, 20, 35), 77, np.int32)
    )
    known = base.copy()
    known[3:9, 10:30] = 77
    assert (volume.shape, volume.ndim, volume.dtype, volume.size) == (SHAPE, 3, np.int32, known.size)
    for key in (4, -1, (4, 11), (4, 11, 3), np.s_[:, 12], np.s_[:, :, 7], np.s_[::3, ::2, 5:9], np.s_[2:2]):
        assert np.array_equal(volume[key], known[key])
    assert np.array_equal(np.asarray(volume), known)
    with pytest.raises(IndexError, match="outside"):
        volume[0, 0, 35]
    with pytest.raises(IndexError, match="forwards"):
        volume[::-1]


def test_nobody_can_write_into_a_version(base):
    first = LabelVolume(base)
    second = first.written(np.s_[0:2, 0:2, 0:2], np.full((2, 2, 2), 5, np.int32))
    for array in (base, first.whole(), first[0], second.whole(), second.read(np.s_[0:5, 0:5, 0:5])):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_a_version_takes_the_memory_of_what_differs():
    base = np.zeros((160, 160, 160), np.int32)
    volume = LabelVolume(base).written(np.s_[40:60, 40:60, 40:60], np.ones((20, 20, 20), np.int32))
    assert 20**3 * 4 <= volume.changed_bytes <= 48**3 * 4
    same = volume.written(np.s_[0:100, 0:100, 0:100], volume.read(np.s_[0:100, 0:100, 0:100]))
    assert same.changed_bytes == volume.changed_bytes


def test_the_whole_is_kept_by_the_last_version_only(base):
    first = LabelVolume(base).written(np.s_[0:2, 0:2, 0:2], np.full((2, 2, 2), 50, np.int32))
    assert first.whole() is first.whole()
    second = first.written(np.s_[0:2, 0:2, 0:2], np.full((2, 2, 2), 51, np.int32))
    assert first._kept is None
    assert second.whole()[0, 0, 0] == 51
    assert first.whole()[0, 0, 0] == 50


def test_a_label_too_large_for_the_type_widens_it():
    volume = LabelVolume(np.zeros((4, 4, 4), np.uint8)).written(np.s_[0:1, 0:1, 0:1], np.full((1, 1, 1), 300))
    assert volume[0, 0, 0] == 300
    assert volume[1, 1, 1] == 0
