"""Grains and pores that the range of the grey values cuts off are refused or told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.errors import TwinError
from mbstudio.core.twin.levels import Levels, noise_of_pores
from mbstudio.core.twin.placing import find_levels
from tests.core.twin.conftest import TONE, VOID

ROW = ("label", "voxels", "z0", "z1", "y0", "y1", "x0", "x1")


def levels_of(phantom, voxels) -> Levels:
    scan = replace(phantom.scan, voxels=voxels.astype(np.float32))
    rows = [{key: int(row[key]) for key in ROW} for row in phantom.grains.table[list(ROW)].to_dict("records")]
    seen = np.ones(phantom.labels.shape, bool)
    return find_levels(scan.voxels, phantom.labels, seen, rows, np.dtype(np.float32))


def test_pores_that_are_cut_off_are_refused_or_told(phantom):
    voxels = np.asarray(phantom.scan.voxels)
    whole = levels_of(phantom, voxels)
    assert whole.notes == ()
    # 30 of noise: a little is cut off below one deviation, most of it above one.
    told = levels_of(phantom, np.maximum(voxels, VOID - 30))
    assert told.void == pytest.approx(whole.void, abs=1)
    assert told.void_noise == pytest.approx(whole.void_noise, rel=0.15)
    (note,) = told.notes
    assert "lowest value" in note
    with pytest.raises(TwinError, match="cuts the pores off"):
        levels_of(phantom, np.maximum(voxels, VOID + 30))


def test_dark_grains_that_are_cut_off_are_refused(phantom):
    dark = VOID + TONE - np.asarray(phantom.scan.voxels)  # grains at VOID, pores at TONE
    assert levels_of(phantom, dark).contrast < 0
    with pytest.raises(TwinError, match="saturated: its voxels are at the scan's lowest"):
        levels_of(phantom, np.maximum(dark, VOID + 10))
    with pytest.raises(TwinError, match="highest value"):
        levels_of(phantom, np.minimum(dark, TONE - 30))


def test_the_noise_is_that_of_the_side_that_is_left():
    values = np.random.default_rng(0).normal(100.0, 4.0, 20_000)
    noise, notes = noise_of_pores(np.maximum(values, 98.0), 98.0, "lowest")
    assert noise == pytest.approx(4.0, rel=0.05)
    assert len(notes) == 1
    assert noise_of_pores(values, float(values.min()), "lowest")[1] == ()
