"""Impulses: found among noise and edges, replaced, and nothing else touched."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

import mbstudio as mb
from mbstudio.core.errors import SegmentationWarning
from mbstudio.core.grains.agreement import agreement
from mbstudio.core.scan import Scan, impulses
from mbstudio.core.scan.impulses import without_impulses
from mbstudio.core.units import VoxelSize
from tests.core.grains.degraded import packed, scanned, scattered


def _whole(grey):
    return np.ones(grey.shape, np.bool_)


def _struck(grey, share, rng):
    hit = rng.random(grey.shape) < share
    return np.where(hit, rng.choice([0, 60_000], size=grey.shape), grey).astype(grey.dtype), hit


@pytest.mark.parametrize("dtype", ["<u2", ">u2", "f4", "f2"])
def test_impulses_are_replaced_and_nothing_else(rng, dtype):
    grey = scanned(packed(), noise=0.1)
    struck, hit = _struck(grey, 0.04, rng)
    mended, share = without_impulses(struck.astype(dtype), _whole(grey))
    assert share == pytest.approx(hit.mean(), rel=0.1)
    missed = np.isin(mended, [0, np.array(60_000).astype(dtype)]) & hit
    assert missed.mean() < 0.1 * hit.mean()
    untouched = ~hit
    assert (mended[untouched] == struck.astype(dtype)[untouched]).mean() > 0.999
    assert np.abs(mended[hit] - grey[hit].astype(float)).mean() < 3000


@pytest.mark.parametrize("dtype", ["<u2", ">u2", "f4", "f2"])
def test_one_copy_of_the_voxels_is_made(rng, dtype, monkeypatch):
    """The estimate of a segmentation's memory counts one."""
    struck, _ = _struck(np.tile(scanned(packed(), noise=0.1), (1, 2, 2)), 0.01, rng)
    struck = struck.astype(dtype)
    seen = _whole(struck)
    monkeypatch.setattr(impulses, "_SAMPLED", 10_000)  # of which noise is measured, however many there are
    without_impulses(struck, seen)  # compiles
    tracemalloc.start()
    try:
        mended, _ = without_impulses(struck, seen)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    places = 8 * 3 * 4096 * 2 ** np.ceil(np.log2(0.01 * struck.size / 4096))
    assert peak < mended.nbytes + 2.5 * places + 1e6


@pytest.mark.parametrize("how", [{}, {"noise": 0.6}, {"noise": 0.0, "blur": 0.5}, {"toned": (0.3, 3.0)}])
def test_a_scan_without_impulses_is_the_same_array(how):
    grey = scanned(packed(), **how)
    assert without_impulses(grey, _whole(grey))[0] is grey


def test_a_film_of_one_voxel_and_what_lies_outside_stay():
    grey = np.full((20, 20, 20), 100, np.uint8)
    grey[10] = 200
    seen = _whole(grey)
    seen[:, :, :4] = False
    grey[::2, ::2, :4] = 255
    assert without_impulses(grey, seen)[0] is grey


def test_they_are_told_and_grains_are_found_in_spite_of_them(rng):
    truth = scattered(0.2, 3)
    struck, _ = _struck(scanned(truth), 0.1, rng)
    with pytest.warns(SegmentationWarning, match="% of the voxels are impulses"):
        grains = mb.segment(Scan(struck, VoxelSize(10, 10, 10, "um")))
    assert agreement(grains.labels, truth).f1 > 0.97
