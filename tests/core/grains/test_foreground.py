"""Grains are found in scans of every share of solid, tone and unevenness, or it is said why not."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from mbstudio.core.errors import SegmentationError, SegmentationWarning
from mbstudio.core.grains import SegmentationSettings, segment
from mbstudio.core.grains.agreement import agreement
from mbstudio.core.grains.grey_ranges import read_ranges, write_ranges
from mbstudio.core.grains.interfaces import find_interfaces
from mbstudio.core.grains.phases import Kind, _levels, find_phases
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize
from tests.core.grains.degraded import CONTRAST, VOID, packed, scanned, scattered

SIZE = VoxelSize(10, 10, 10, "um")


def f1_of(grey: np.ndarray, truth: np.ndarray, **settings: Any) -> float:
    return agreement(segment(Scan(grey, SIZE), **settings).labels, truth).f1


@pytest.mark.parametrize("share", [0.0005, 0.002, 0.01, 0.05, 0.2])
@pytest.mark.parametrize("noise", [0.07, 0.25])
def test_dilute_grains_are_found_and_nothing_else(share: float, noise: float) -> None:
    truth = scattered(share)
    assert f1_of(scanned(truth, noise=noise), truth) == 1.0


@pytest.mark.parametrize(
    "degraded",
    [
        {"noise": 0.5},
        {"toned": (0.3, 3.0)},
        {"toned": (0.5, 3.0)},
        {"toned": (0.3, 0.5)},
        {"toned": (0.5, 0.5)},
        {"cupping": 0.6},
        {"drift": 0.6},
        {"rings": 0.3},
    ],
)
def test_packed_grains_are_found_whatever_is_uneven(degraded: dict[str, Any]) -> None:
    truth = packed()
    assert f1_of(scanned(truth, **degraded), truth) > 0.93


@pytest.mark.parametrize("truth", [packed(), scattered(0.05)], ids=["packed", "scattered"])
def test_dark_grains_are_found_by_their_convex_side(truth: np.ndarray) -> None:
    grey = scanned(truth, dark=True)
    with pytest.warns(SegmentationWarning, match="darker than what lies between"):
        assert f1_of(grey, truth) > 0.93
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert f1_of(scanned(truth), truth) > 0.93
    assert f1_of(grey, truth, dark=False) < 0.5


@pytest.mark.parametrize("film", [3.0, 5.0])
def test_water_is_told_and_is_no_grain(film: float) -> None:
    truth = packed()
    with pytest.warns(SegmentationWarning, match="three phases"):
        grains = segment(Scan(scanned(truth, water=film), SIZE))
    assert np.count_nonzero(grains.labels) == pytest.approx(np.count_nonzero(truth), rel=0.05)
    assert agreement(grains.labels, truth).f1 > 0.93


def test_noise_alone_is_refused() -> None:
    grey = np.random.default_rng(0).normal(20_000, 800, (80, 80, 80)).astype(np.uint16)
    with pytest.raises(SegmentationError, match="stands out from the noise"):
        segment(Scan(grey, SIZE))


def test_a_masked_particle_is_one_whole_grain() -> None:
    grey = np.zeros((60, 60, 60), np.uint8)
    grey[6:54, 18:42, 22:40] = 1
    grains = segment(Scan(grey, SIZE))
    assert len(grains) == len(grains.interior_labels) == 1
    assert grains.table["voxels"].tolist() == [48 * 24 * 18]


def test_levels_of_phases_are_those_of_the_scan() -> None:
    grey = scanned(scattered(0.2), toned=(0.5, 2.0)).astype(np.float32)
    phases = find_phases(find_interfaces(grey, np.ones(grey.shape, np.bool_)))
    assert phases is not None
    assert phases.void == pytest.approx(VOID, abs=0.05 * CONTRAST)
    assert phases.tones == pytest.approx((VOID + CONTRAST, VOID + 2 * CONTRAST), abs=0.1 * CONTRAST)
    assert (phases.count, phases.liquid, phases.dark) == (3, None, False)
    assert phases.contrast_to_noise == pytest.approx(1 / 0.07, rel=0.3)


def test_ranges_of_grey_values_choose_a_phase() -> None:
    truth = scattered(0.2)
    grey = scanned(truth, toned=(0.5, 3.0))
    bright = segment(Scan(grey, SIZE), ranges=(VOID + 2 * CONTRAST, 65_535))
    both = segment(Scan(grey, SIZE), ranges=(VOID + 0.5 * CONTRAST, VOID + CONTRAST, VOID + CONTRAST, 65_535))
    assert len(bright) == round(0.5 * truth.max())
    assert len(both) == truth.max()


@pytest.mark.parametrize("ranges", [(1.0,), (3.0, 2.0), (1.0, 2.0, 5.0)])
def test_ranges_that_are_none_are_refused(ranges: tuple[float, ...]) -> None:
    with pytest.raises(SegmentationError, match="pairs of a lower and a higher"):
        SegmentationSettings(ranges=ranges)


def test_a_stated_threshold_holds_for_dark_grains_too() -> None:
    truth = scattered(0.05)
    assert f1_of(scanned(truth, dark=True), truth, dark=True, threshold=VOID + 0.5 * CONTRAST) == 1.0


def test_ranges_are_read_as_they_are_written() -> None:
    assert read_ranges("90:140, 200:255.5") == (90.0, 140.0, 200.0, 255.5)
    assert read_ranges(write_ranges((90.0, 140.0, 200.0, 255.5))) == (90.0, 140.0, 200.0, 255.5)
    for text in ("", "90", "90:", "90:140:3", "a:b", "140:90", "1:inf"):
        with pytest.raises(SegmentationError, match="grey value"):
            read_ranges(text)


def test_faint_grains_of_a_fine_packing_are_no_liquid() -> None:
    truth = packed(3, 72, 0.45)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SegmentationWarning)
        found = segment(Scan(scanned(truth, toned=(0.6, 0.3), noise=0.04), SIZE))
    assert agreement(found.labels, truth).foreground_iou > 0.8


@pytest.mark.parametrize("drift", [0.0, 1.5])
def test_pores_of_a_fine_packing_are_no_dark_grains(drift: float) -> None:
    truth = packed(3, 72, 0.4)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SegmentationWarning)
        found = segment(Scan(scanned(truth, drift=drift), SIZE))
    assert agreement(found.labels, truth).foreground_iou > 0.9


@pytest.mark.parametrize("dark", [True, False])
def test_grains_of_a_fine_packing_are_the_convex_side(dark: bool) -> None:
    truth = packed(3, 72, 0.4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SegmentationWarning)
        found = segment(Scan(scanned(truth, dark=dark), SIZE))
    assert agreement(found.labels, truth).foreground_iou > 0.9


@pytest.mark.parametrize("drift", [0.8, 1.2, 1.6])
def test_a_drift_is_no_liquid(drift: float) -> None:
    truth = packed(5)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SegmentationWarning)
        found = segment(Scan(scanned(truth, drift=drift), SIZE))
    assert agreement(found.labels, truth).f1 > 0.95


def test_streaks_within_grains_are_no_liquid() -> None:
    # Levels of a scan with streaks: what seems to lie between two phases never meets the void.
    streaked = (
        Kind(20_462, 31_426, 0.624), Kind(28_344, 31_756, 0.112), Kind(32_182, 35_277, 0.062),
    )  # fmt: skip
    assert _levels(streaked, 11_000, wet=True)[2] is None
    wet = (Kind(20_978, 31_745, 0.308), Kind(26_860, 31_857, 0.532), Kind(20_789, 26_420, 0.063))
    assert _levels(wet, 6_000, wet=True)[2] == 26_860
