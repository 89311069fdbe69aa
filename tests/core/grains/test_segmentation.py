"""Segmentation finds the grains that are there: known geometry, synthetic truth, real sand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cc3d
import numpy as np
import pytest

from mbstudio.core.errors import Cancelled, GrainError, ScanError, SegmentationError
from mbstudio.core.grains import GrainSet, SegmentationSettings, find_field_of_view, segment
from mbstudio.core.grains.agreement import agreement
from mbstudio.core.grains.flooding import split_by_necks
from mbstudio.core.scan import Phantom, Scan, make_phantom, open_scan, sample_recipe, sample_scan
from mbstudio.core.units import VoxelSize

UNIT = VoxelSize(1, 1, 1, "um")


def balls(
    shape: tuple[int, int, int],
    *places: tuple[float, float, float, float],
    edges: tuple[float, float, float] = (1, 1, 1),
) -> np.ndarray:
    """Grey voxels of balls (z, y, x, radius) in units of length, for voxels of these edges."""
    z, y, x = np.ogrid[tuple(slice(0, count) for count in shape)]
    grey = np.full(shape, 100, np.uint16)
    for cz, cy, cx, radius in places:
        grey[(z * edges[0] - cz) ** 2 + (y * edges[1] - cy) ** 2 + (x * edges[2] - cx) ** 2 <= radius**2] = (
            200
        )
    return grey


@pytest.fixture(scope="module")
def sample() -> Phantom:
    return sample_scan()


@pytest.fixture(scope="module")
def found(sample: Phantom) -> GrainSet:
    return segment(sample.scan)


# Known geometry --------------------------------------------------------------------------------


def test_one_ball() -> None:
    grains = segment(Scan(balls((40, 44, 48), (20, 21, 22, 12)), VoxelSize(2, 2, 2, "um"), origin=(10, 0, 0)))
    assert len(grains) == 1
    row = grains.table.iloc[0]
    assert row["volume"] == pytest.approx(4 / 3 * np.pi * 24**3, rel=0.02)
    assert (row["x"], row["y"], row["z"]) == pytest.approx((54, 42, 40), abs=1e-6)
    assert [row[name] for name in ("z0", "z1", "y0", "y1", "x0", "x1")] == [8, 33, 9, 34, 10, 35]
    assert not row["touches_border"]
    grain = grains[0]
    assert grain.centroid == pytest.approx((54, 42, 40), abs=1e-6)
    assert grain.label == 1
    assert not grain.mask.flags.writeable


def test_touching_balls_are_parted_by_the_neck_rule() -> None:
    """Balls of radius 12, centres 20 apart: the neck's radius is sqrt(144 - 100) = 6.6, 0.55 of 12."""
    scan = Scan(balls((40, 40, 64), (20, 20, 20, 12), (20, 20, 40, 12)), UNIT)
    assert len(segment(scan, splitting=0.4)) == 1
    assert len(segment(scan, splitting=0.7)) == 2
    assert len(segment(scan, splitting=0.0)) == 1
    parted = segment(scan)
    assert parted.table["x"].to_numpy() == pytest.approx([19.3, 40.7], abs=1)
    assert parted.table["voxels"].iloc[0] == pytest.approx(parted.table["voxels"].iloc[1], rel=0.04)


def test_the_neck_rule_does_not_depend_on_size() -> None:
    """Radius 9, centres 16 apart: the neck's radius is sqrt(81 - 64) = 4.1, 0.46 of 9."""
    for scale in (1, 2):
        scan = Scan(
            balls(
                (30 * scale, 30 * scale, 48 * scale),
                (15 * scale, 15 * scale, 15 * scale, 9 * scale),
                (15 * scale, 15 * scale, 31 * scale, 9 * scale),
            ),
            UNIT,
        )
        assert [len(segment(scan, splitting=s)) for s in (0.4, 0.6)] == [1, 2]


def test_flat_voxels_are_measured_in_length() -> None:
    """Two balls on voxels three times as long along z."""
    edges = (3.0, 1.0, 1.0)
    grey = balls((14, 40, 64), (20, 20, 20, 12), (20, 20, 40, 12), edges=edges)
    grains = segment(Scan(grey, VoxelSize(*edges, unit="um")))
    assert len(grains) == 2
    assert grains.table["volume"].sum() == pytest.approx(2 * 4 / 3 * np.pi * 12**3 * 0.98, rel=0.05)


def test_a_landscape_worked_out_by_hand() -> None:
    """Peaks 5 and 4 with a saddle of 3, 0.75 of the lower peak; a peak of 1.2 apart."""
    heights = np.array([[[1, 5, 3, 4, 0, 1.2, 1]]], np.float32)
    labels, count = split_by_necks(heights, 0.76, 0.1)
    assert count == 3
    assert labels.ravel()[[0, 1, 3, 5, 6]].tolist() == [1, 1, 2, 3, 3]
    assert labels.ravel()[4] == 0
    assert split_by_necks(heights, 0.74, 0.1)[1] == 2
    assert split_by_necks(heights, 0.9, 1.1)[1] == 2  # the lower peak stands out by one only
    assert split_by_necks(np.zeros((2, 2, 2), np.float32), 0.5, 0.1)[1] == 0


def test_specks_go_and_cavities_are_filled() -> None:
    grey = balls((40, 40, 60), (20, 20, 20, 14), (20, 20, 50, 3))
    grey[balls(grey.shape, (20, 20, 20, 4)) == 200] = 100
    grains = segment(Scan(grey, UNIT))
    assert len(grains) == 1
    assert grains.labels[20, 20, 20] == 1
    assert len(segment(Scan(grey, UNIT), smallest_voxels=20)) == 2


def test_border_by_box_and_by_field_of_view() -> None:
    """In a cylinder of radius 40: one ball cut by it, one by the box's end, one inside."""
    grey = balls((60, 90, 90), (30, 45, 45, 10), (30, 45, 82, 10), (0, 45, 15, 10))
    y, x = np.ogrid[:90, :90]
    grey[:, (y - 44.5) ** 2 + (x - 44.5) ** 2 > 40**2] = 0
    grains = segment(Scan(grey, UNIT))
    place = {
        int(grains.labels[30, 45, 45]): False,
        int(grains.labels[30, 45, 80]): True,
        int(grains.labels[1, 45, 15]): True,
    }
    assert 0 not in place
    assert dict(zip(grains.table["label"], grains.table["touches_border"], strict=True)) == place
    inside = segment(Scan(grey, UNIT), drop_border=True)
    assert len(inside) == 1
    assert inside.labels[30, 45, 45] == 1


def test_bright_grains_do_not_draw_the_threshold() -> None:
    grey = balls((60, 60, 60), (15, 15, 15, 12), (15, 45, 45, 12), (45, 15, 45, 12))
    grey[balls(grey.shape, (45, 45, 15, 5)) == 200] = 20_000
    assert len(segment(Scan(grey, UNIT))) == 4


def test_a_stated_threshold_is_used() -> None:
    grey = balls((40, 40, 80), (20, 20, 20, 12), (20, 20, 60, 12))
    grey[:, :, 40:][grey[:, :, 40:] == 200] = 300
    assert len(segment(Scan(grey, UNIT), threshold=150)) == 2
    assert len(segment(Scan(grey, UNIT), threshold=250)) == 1


# Field of view ---------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_cylinder_is_found_along_any_axis(axis: int, rng: np.random.Generator) -> None:
    y, x = np.ogrid[:50, :50]
    disk = (y - 24.5) ** 2 + (x - 24.5) ** 2 <= 22**2
    grey = np.where(disk[None], rng.integers(1, 100, (30, 50, 50)), 0)
    view = find_field_of_view(np.moveaxis(grey, 0, axis))
    assert view.axis == axis
    np.testing.assert_array_equal(view.footprint, disk)


def test_no_field_of_view_means_the_whole_box(rng: np.random.Generator) -> None:
    assert find_field_of_view(rng.integers(0, 100, (20, 30, 30))).is_whole_box
    # Pores of zero, which hang together and reach the corners, are no unseen margin.
    pores = balls((8, 60, 60), (4, 15, 15, 9), (4, 15, 45, 9), (4, 45, 15, 9), (4, 45, 45, 9))
    pores[pores == 100] = 0
    assert find_field_of_view(pores).is_whole_box
    assert len(segment(Scan(pores, UNIT))) == 4


# Synthetic truth -------------------------------------------------------------------------------


def test_the_sample_is_found(sample: Phantom, found: GrainSet) -> None:
    scored = agreement(found.labels, sample.labels)
    assert scored.foreground_iou >= 0.95
    assert scored.f1 >= 0.95


def test_labels_and_table_agree(found: GrainSet) -> None:
    labels = np.asarray(found.labels)
    assert found.table["label"].tolist() == list(range(1, len(found) + 1))
    np.testing.assert_array_equal(
        np.bincount(labels.ravel(), minlength=len(found) + 1)[1:], found.table["voxels"]
    )
    for row in found.table.itertuples():
        mask = labels == row.label
        z, y, x = np.nonzero(mask)
        assert (row.z0, row.z1, row.y0, row.y1, row.x0, row.x1) == (
            z.min(), z.max() + 1, y.min(), y.max() + 1, x.min(), x.max() + 1,
        )  # fmt: skip
        assert (
            cc3d.connected_components(
                mask[row.z0 : row.z1, row.y0 : row.y1, row.x0 : row.x1], connectivity=26
            ).max()
            == 1
        )
    grain = found.grain(7)
    assert grain.label == 7
    assert grain.voxel_count == found.table["voxels"].iloc[6]
    assert grain.centroid == pytest.approx(found.table.loc[6, ["x", "y", "z"]].to_numpy(float))
    assert set(found.interior_labels) == set(found.table["label"][~found.table["touches_border"]])
    with pytest.raises(GrainError, match="no grain 9999"):
        found.grain(9999)


def test_border_grains_of_the_sample(sample: Phantom, found: GrainSet) -> None:
    """Grains that the truth shows well inside are interior, grains at the cylinder are not."""
    y, x = np.ogrid[:160, :160]
    far = np.sqrt((y - 79.5) ** 2 + (x - 79.5) ** 2)
    for grain in found:
        z, y, x = np.nonzero(np.asarray(found.labels) == grain.label)
        reach, low, high = far[y, x].max(), z.min(), z.max()
        if reach > 76.5 or low == 0 or high == 159:
            assert grain.touches_border
        elif reach < 74:
            assert not grain.touches_border


@pytest.mark.parametrize(
    ("changes", "seed"),
    [({"noise": 0.1, "blur": 1.0}, 2), ({"field_of_view_radius": None}, 4)],
    ids=["noisy", "whole box"],
)
def test_other_synthetic_scans(changes: dict, seed: int) -> None:
    phantom = make_phantom(
        replace(sample_recipe(), shape=(110, 120, 120), **{"field_of_view_radius": 57.0, **changes}), seed
    )
    scored = agreement(segment(phantom.scan).labels, phantom.labels)
    assert scored.foreground_iou >= 0.93
    assert scored.f1 >= 0.93


def test_more_splitting_never_makes_fewer_pieces(sample: Phantom) -> None:
    scan = Scan(np.asarray(sample.scan.voxels)[:70], sample.scan.voxel_size)
    counts = [
        len(segment(scan, splitting=splitting, smallest_voxels=1)) for splitting in (0, 0.3, 0.6, 0.8, 1)
    ]
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]


# Progress, settings, bad input -----------------------------------------------------------------


def test_progress_rises_and_cancels() -> None:
    scan = Scan(balls((30, 30, 30), (15, 15, 15, 10)), UNIT)
    steps: list[tuple[float, str]] = []
    segment(scan, progress=lambda fraction, message: steps.append((fraction, message)))
    fractions = [fraction for fraction, _ in steps]
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0, 1)
    assert all(message for _, message in steps)

    def cancel(fraction: float, message: str) -> None:
        if fraction > 0.3:
            raise Cancelled("stopped")

    with pytest.raises(Cancelled):
        segment(scan, progress=cancel)


@pytest.mark.parametrize(
    "bad",
    [{"splitting": 1.5}, {"splitting": float("nan")}, {"denoise_sigma": -1}, {"threshold": float("inf")},
     {"smallest_voxels": 0}, {"watershed": 3}],
)  # fmt: skip
def test_impossible_settings(bad: dict) -> None:
    with pytest.raises(SegmentationError, match=next(iter(bad))):
        segment(Scan(balls((8, 8, 8), (4, 4, 4, 2)), UNIT), SegmentationSettings(), **bad)


def test_bad_voxels(tmp_path: Path) -> None:
    np.save(tmp_path / "constant.npy", np.full((6, 6, 6), 7.0))
    holed = np.ones((6, 6, 6))
    holed[3, 3, 3] = np.nan
    np.save(tmp_path / "holed.npy", holed)
    with pytest.raises(ScanError, match=r"constant\.npy is constant: every voxel is 7"):
        segment(open_scan(tmp_path / "constant.npy", "1 um"))
    with pytest.raises(ScanError, match=r"holed\.npy contains voxels that are not finite"):
        segment(open_scan(tmp_path / "holed.npy", "1 um"))


def test_no_grains_is_an_error_not_an_empty_set() -> None:
    with pytest.raises(SegmentationError, match="No grains"):
        segment(Scan(balls((20, 20, 20), (10, 10, 10, 5)), UNIT), threshold=5000)
    with pytest.raises(SegmentationError, match="No grains"):
        segment(Scan(balls((20, 20, 20), (0, 10, 10, 6)), UNIT), drop_border=True)


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32, np.float64, ">u2"])
def test_grey_types(dtype: str) -> None:
    grains = segment(Scan(balls((30, 30, 30), (15, 15, 15, 10)).astype(dtype), UNIT))
    assert len(grains) == 1


# Real sand -------------------------------------------------------------------------------------


@pytest.mark.real_data
def test_real_sand_against_hand_labels(shared_data: Path) -> None:
    """All 51 million voxels by the defaults alone: the count of its authors, and their hand labels."""
    import tifffile

    grains = segment(open_scan(shared_data / "sand_ct" / "sand_ct_14um.tif", voxel_size="14 um"))
    scored = agreement(
        grains.labels[0], tifffile.imread(shared_data / "sand_ct" / "hand_labels_slice000.tif")
    )
    assert 1700 <= len(grains) <= 2300
    assert scored.foreground_iou >= 0.80
    assert scored.f1 >= 0.80
