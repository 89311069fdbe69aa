"""Intervals of scanned grains: they hold the truth, answer to the scan, and refuse what does not fit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from benchmarks.known_solids import ellipsoid, solid
from mbstudio.core.errors import MeasureError
from mbstudio.core.grains import Grain
from mbstudio.core.metrics import CORE_FACTORS, DETAILED_FACTORS, factor_intervals, measure

TRUTHS = {
    "volume": "volume",
    "area": "area",
    "sphericity": "sphericity",
    "ds": "ds",
    "circularity": "circularity",
}


def test_the_intervals_of_an_ellipsoid_hold_the_truth_and_the_value():
    held = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        body = solid("ellipsoid", 10, rng)
        found = factor_intervals(Grain.from_mask(body.voxels(rng), "1 um"))
        assert set(found.intervals) == set(CORE_FACTORS)
        assert found.source == "mask"
        assert found.detailed is None
        for name, (low, high) in found.intervals.items():
            assert low <= getattr(found.factors, name) <= high, name
        held += [
            found.intervals[name][0] <= getattr(body, at) <= found.intervals[name][1]
            for name, at in TRUTHS.items()
        ]
        low, high = found.intervals["area"]
        assert (high - low) / body.area < 0.1
    assert np.mean(held) >= 0.9


def test_finer_voxels_leave_less_open():
    widths = []
    for radius in (8, 16):
        body = solid("ellipsoid", radius)
        found = factor_intervals(
            Grain.from_mask(body.voxels(np.random.default_rng(1)), "1 um"), axes="inertia"
        )
        widths.append(
            {name: (high - low) / body.volume ** (1 / 3) for name, (low, high) in found.intervals.items()}
        )
    for name in ("ds", "longest", "circularity", "csf"):
        assert widths[1][name] < widths[0][name]


def grey_picture(contrast):
    """A ball of radius 8 on a grid of 24 with a soft edge, and the grain above the middle."""
    z, y, x = np.mgrid[:24, :24, :24] - 11.7
    grey = 100 + contrast / (1 + np.exp(2 * (np.sqrt(x**2 + y**2 + z**2) - 8)))
    threshold = 100 + contrast / 2
    mask = grey > threshold if contrast > 0 else grey < threshold
    box = ndimage.find_objects(mask.astype(int))[0]
    margin = 2
    window = tuple(slice(part.start - margin, part.stop + margin) for part in box)
    return Grain.from_mask(mask, "1 um"), grey[window], threshold


@pytest.mark.parametrize("contrast", [50.0, -50.0])
def test_an_unsure_threshold_widens_the_interval_by_what_it_moves_the_surface(contrast):
    grain, grey, threshold = grey_picture(contrast)
    sure = factor_intervals(grain, axes="inertia", grey=grey, threshold=threshold, step=0.0)
    unsure = factor_intervals(grain, axes="inertia", grey=grey, threshold=threshold, step=10.0)
    assert sure.source == "grey"
    assert sure.factors == measure(grain, axes="inertia")
    # 10 grey values of 50 move the edge by about ln(0.7 / 0.3) / 2 = 0.42 voxels, volume by 3 * 0.42 / 8.
    low, high = unsure.intervals["volume"]
    assert (high - low) / 2 / grain.volume == pytest.approx(3 * 0.42 / 8, rel=0.3)
    assert high - low > 3 * (sure.intervals["volume"][1] - sure.intervals["volume"][0])


def test_neighbours_in_the_grey_values_do_not_count():
    grain, grey, threshold = grey_picture(50.0)
    crowded = np.pad(grey, 3, constant_values=100.0)
    alone = factor_intervals(grain, axes="inertia", grey=crowded.copy(), threshold=threshold)
    crowded[:2] = 150.0
    beside = factor_intervals(grain, axes="inertia", grey=crowded, threshold=threshold)
    assert dict(beside.intervals) == dict(alone.intervals)


def test_detailed_factors_have_intervals_too():
    grain = Grain.from_mask(solid("sphere", 7).voxels(np.random.default_rng(2)), "1 um")
    found = factor_intervals(grain, axes="inertia", detail=True, unit="mm")
    assert set(found.intervals) == {*CORE_FACTORS, *DETAILED_FACTORS} - {"roundness"}
    assert found.detailed.unit == found.factors.unit == "mm"
    low, high = found.intervals["inscribed"]
    assert low <= 0.014 <= high


def test_what_does_not_fit_is_refused():
    grain, grey, threshold = grey_picture(50.0)
    with pytest.raises(MeasureError, match="or neither"):
        factor_intervals(grain, grey=grey)
    with pytest.raises(MeasureError, match="do not fit the mask"):
        factor_intervals(grain, grey=grey[1:], threshold=threshold)
    with pytest.raises(MeasureError, match="does not lie between"):
        factor_intervals(grain, grey=grey, threshold=99.0)
    grey[0, 0, 0] = np.nan
    with pytest.raises(MeasureError, match="finite"):
        factor_intervals(grain, grey=grey, threshold=threshold)


def test_the_interval_of_a_thin_grain_of_long_voxels_holds_its_area():
    edges, held = (4.0, 1.0, 1.0), []
    for seed in (3, 5):
        body = ellipsoid(np.array([1.0, 0.5, 0.25]) * 12)
        grain = Grain.from_mask(
            body.voxels(np.random.default_rng(seed), edges), edges, unit="um", keep="largest"
        )
        found = factor_intervals(grain)
        held += [
            found.intervals[name][0] <= getattr(body, name) <= found.intervals[name][1]
            for name in ("area", "sphericity", "csf")
        ]
    assert all(held)
