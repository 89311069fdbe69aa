"""Grains of a part of a scan are those of the scan, where they lay in space."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.grains import GrainSet, segment
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize

SIZE = VoxelSize(3, 2, 2, "um")
ORIGIN = (50.0, -10.0, 7.0)
SETTINGS = {"threshold": 120.0, "smallest_voxels": 40}


def made(
    seed: int, shape: tuple[int, int, int] = (56, 68, 72), axes: tuple[float, float] = (4.5, 6.5)
) -> Scan:
    """Ellipsoids with soft surfaces that stand apart, in noise."""
    rng = np.random.default_rng(seed)
    index = np.indices(shape)
    solid = np.zeros(shape)
    kept: list[tuple[np.ndarray, float]] = []
    for _ in range(400):
        centre, half = rng.uniform(0, shape), rng.uniform(*axes, 3)
        if any(np.linalg.norm(centre - other) < half.max() + reach + 3 for other, reach in kept):
            continue
        kept.append((centre, float(half.max())))
        away = np.sqrt(sum(((i - c) / a) ** 2 for i, c, a in zip(index, centre, half, strict=True)))
        solid += 1 / (1 + np.exp(3 * (away - 1) * half.mean()))
    grey = 60 + 120 * solid.clip(0, 1) + rng.normal(0, 4, shape)
    return Scan(grey.clip(0, 255).astype(np.uint8), SIZE, ORIGIN)


def inner(grains: GrainSet) -> np.ndarray:
    """Centre (x, y, z) and volume of the whole grains, sorted."""
    table = grains.table.loc[~grains.table["touches_border"]]
    return np.array(sorted(table[["x", "y", "z", "volume"]].to_numpy().tolist()))


@pytest.mark.parametrize("seed", range(4))
def test_crop_then_segment_is_segment_then_crop(seed: int) -> None:
    scan = made(seed)
    rng = np.random.default_rng(100 + seed)
    start = [int(rng.integers(0, count // 4)) for count in scan.shape]
    stop = [int(rng.integers(3 * count // 4, count)) for count in scan.shape]
    block = tuple(slice(*ends) for ends in zip(start, stop, strict=True))
    whole = segment(scan, **SETTINGS)
    part = segment(scan.cropped(block), **SETTINGS)
    boxes = whole.table
    within = ~boxes["touches_border"]
    for axis, first, last in zip("zyx", start, stop, strict=True):
        # The blur before the threshold sees no farther than two voxels.
        within &= (boxes[f"{axis}0"] > first + 2) & (boxes[f"{axis}1"] < last - 2)
    expected = np.array(sorted(boxes.loc[within, ["x", "y", "z", "volume"]].to_numpy().tolist()))
    assert len(expected) >= 3
    found = inner(part)
    for row in expected:
        assert np.abs(found - row).max(axis=1).min() < 1e-9
    # Voxel for voxel, they are the same bodies.
    for label in boxes.loc[within, "label"]:
        here = (whole.labels == label)[block]
        numbers = np.unique(part.labels[here])
        assert len(numbers) == 1
        assert np.array_equal(part.labels == numbers[0], here)


@pytest.mark.parametrize("binning", [2, (1, 2, 2)])
def test_a_bin_leaves_grains_where_and_as_large_as_they_were(binning: object) -> None:
    scan = made(7, (72, 88, 88), (10, 12))
    whole = inner(segment(scan, **SETTINGS))
    part = inner(segment(scan.binned(binning), threshold=120.0, smallest_voxels=10))
    assert len(part) == len(whole) >= 4
    for row in whole:
        near = part[np.linalg.norm(part[:, :3] - row[:3], axis=1).argmin()]
        assert near[:3] == pytest.approx(row[:3], abs=0.35)  # a sixth of a voxel
        assert near[3] == pytest.approx(row[3], rel=0.05)


def test_a_region_that_the_field_of_view_cuts_has_its_grains_cut_there() -> None:
    scan = made(3)
    voxels = np.array(scan.voxels)
    y, x = np.indices(voxels.shape[1:])
    voxels[:, np.hypot(y - 30, x - 32) > 29] = 0
    scan = Scan(voxels, SIZE, ORIGIN)
    whole, part = segment(scan, **SETTINGS), segment(scan.cropped(":,20:,:40"), **SETTINGS)
    expected, found = inner(whole), inner(part)
    assert 3 <= len(found) < len(expected)
    for row in found:
        assert np.abs(expected - row).max(axis=1).min() < 1e-9
