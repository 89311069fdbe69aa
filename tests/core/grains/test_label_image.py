"""Label images made elsewhere become grains, or a clear message."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from mbstudio.core.errors import GrainWarning, ScanError, SegmentationError
from mbstudio.core.grains import load_labels
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize


@pytest.fixture
def image() -> np.ndarray:
    labels = np.zeros((10, 12, 14), np.uint16)
    labels[2:5, 2:5, 2:5] = 40
    labels[2:5, 5:8, 2:5] = 7  # touches 40
    labels[0:3, 9:12, 9:12] = 900  # at the box's face
    return labels


def test_numbers_become_consecutive_in_their_order(image: np.ndarray) -> None:
    grains = load_labels(image, voxel_size="2 mm")
    assert grains.table["voxels"].tolist() == [27, 27, 27]
    assert grains.labels[3, 6, 3] == 1
    assert grains.labels[3, 3, 3] == 2
    assert grains.labels[1, 10, 10] == 3
    assert grains.table["touches_border"].tolist() == [False, False, True]
    assert grains.table["volume"].tolist() == [216, 216, 216]
    assert grains[1].centroid == pytest.approx((6, 6, 6))


def test_from_a_file_with_the_scans_size_and_origin(tmp_path: Path, image: np.ndarray) -> None:
    path = tmp_path / "labels.tif"
    tifffile.imwrite(path, image)
    scan = Scan(np.arange(image.size).reshape(image.shape), VoxelSize(3, 2, 1, "mm"), origin=(10, 20, 30))
    grains = load_labels(path, scan)
    assert grains.voxel_size == scan.voxel_size
    assert grains[1].centroid == pytest.approx((13, 26, 39))


def test_two_values_are_a_mask_whose_pieces_are_the_grains(image: np.ndarray) -> None:
    grains = load_labels(image > 0, voxel_size="1 mm")
    assert sorted(grains.table["voxels"]) == [27, 54]


def test_the_largest_piece_of_a_label_is_kept(image: np.ndarray) -> None:
    image[8, 2, 2] = 40
    with pytest.warns(GrainWarning, match="1 labels were in several pieces.* 1 voxels dropped"):
        grains = load_labels(image, voxel_size="1 mm")
    assert grains.labels[8, 2, 2] == 0
    assert grains.table["voxels"].tolist() == [27, 27, 27]


def test_a_field_of_view_cuts_grains_off() -> None:
    y, x = np.ogrid[:40, :40]
    disk = (y - 19.5) ** 2 + (x - 19.5) ** 2 <= 18**2
    grey = np.where(disk, 50, 0) + np.zeros((10, 1, 1), int)
    labels = np.zeros((10, 40, 40), int)
    labels[3:6, 18:22, 18:22] = 1
    labels[3:6, 18:22, 30:38] = 2
    grains = load_labels(labels, Scan(grey, VoxelSize(1, 1, 1, "mm")))
    assert grains.table["touches_border"].tolist() == [False, True]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda image: image[:5], "scan"),
        (lambda image: image * 0.5, "whole numbers"),
        (lambda image: image * np.nan, "only NaN"),
        (lambda image: image.astype(int) - 1, "negative"),
        (lambda image: image * 0, "no grain"),
        (lambda image: image[0], "three axes"),
    ],
)
def test_bad_label_images(image: np.ndarray, change: object, says: str) -> None:
    scan = Scan(np.arange(image.size).reshape(image.shape), VoxelSize(1, 1, 1, "mm"))
    with pytest.raises(SegmentationError, match=says):
        load_labels(change(image), scan)  # type: ignore[operator]


def test_a_voxel_size_is_needed(image: np.ndarray) -> None:
    with pytest.raises(SegmentationError, match="voxel_size"):
        load_labels(image)


def test_float_labels_of_whole_numbers_are_taken(image: np.ndarray) -> None:
    assert len(load_labels(image.astype(np.float32), voxel_size="1 mm")) == 3


# Labels of other programs ---------------------------------------------------------------------------


def test_nan_and_64_bits_and_gaps(image: np.ndarray) -> None:
    bare = np.where(image > 0, image, np.nan).astype(np.float32)
    for source in (
        bare,
        image.astype(np.int64) * 10**12,
        (image > 0) * image.astype(np.float64) + 2**40 * (image > 0),
    ):
        assert load_labels(source, voxel_size="1 mm").table["voxels"].tolist() == [27, 27, 27]
    with pytest.raises(SegmentationError, match="too large for its type float32"):
        load_labels(image.astype(np.float32) * 2.0**23, voxel_size="1 mm")


def balls(shape: tuple[int, int, int], *centres: tuple[int, int, int, int]) -> np.ndarray:
    z, y, x = np.indices(shape)
    labels = np.zeros(shape, np.int32)
    for number, (cz, cy, cx, radius) in enumerate(centres, 1):
        labels[(z - cz) ** 2 + (y - cy) ** 2 + (x - cx) ** 2 <= radius**2] = number
    return labels


FOUR = ((10, 10, 10, 6), (10, 30, 10, 7), (30, 10, 30, 8), (30, 30, 12, 6))


@pytest.mark.parametrize(
    "classes",
    [lambda four: (four > 0) + 1, lambda four: np.where(four == 0, 1, np.where(four > 2, 3, 2)),
     lambda four: np.where(four == 0, 0, np.where(four > 2, 2, 1)), lambda four: np.where(four == 0, 255, 1),
     lambda four: np.where(four == 0, 5, four),
     lambda four: np.where(four == 0, 9, four - 1),
     lambda four: np.ones_like(four)],
)  # fmt: skip
def test_classes_of_material_are_no_grains(classes: object) -> None:
    four = balls((40, 40, 40), *FOUR)
    with pytest.raises(SegmentationError, match=r"classes of material|no 0"):
        load_labels(classes(four).astype(np.uint8), voxel_size="1 mm")  # type: ignore[operator]


def test_a_mask_of_touching_grains_is_told_and_parted_on_request() -> None:
    two = balls((30, 30, 44), (15, 15, 14, 9), (15, 15, 30, 8))
    for mask in (two > 0, (two > 0).astype(np.uint8) * 255, (two > 0).astype(np.float32) * 7):
        with pytest.warns(GrainWarning, match="it is a mask.*--splitting"):
            assert len(load_labels(mask, voxel_size="1 mm")) == 1
        assert len(load_labels(mask, voxel_size="1 mm", splitting=0.75)) == 2


def test_touching_grains_of_two_numbers_stay_two() -> None:
    two = balls((30, 30, 44), (15, 15, 14, 9), (15, 15, 30, 8))
    assert len(load_labels(two, voxel_size="1 mm")) == 2


def test_slicers_layers(tmp_path: Path) -> None:
    import nrrd

    four = balls((40, 40, 40), *FOUR)
    layers = np.stack([np.where(four <= 2, four, 0), np.where(four > 2, four - 2, 0)], -1).astype(np.uint8)
    header = {
        "kinds": ["list", "domain", "domain", "domain"], "space": "left-posterior-superior",
        "space directions": np.vstack([[np.nan] * 3, np.diag([0.01] * 3)]), "space units": ["mm"] * 3,
        **{f"Segment{n}_LabelValue": str(n % 2 + 1) for n in range(4)},
    }  # fmt: skip
    nrrd.write(str(tmp_path / "s.seg.nrrd"), layers, header, index_order="C")
    grains = load_labels(tmp_path / "s.seg.nrrd")
    assert sorted(grains.table["voxels"]) == sorted(np.bincount(four.ravel())[1:])
    assert grains.voxel_size.to("um").x == pytest.approx(10)
    layers[10, 10, 10, 1] = 1
    nrrd.write(str(tmp_path / "o.seg.nrrd"), layers, header, index_order="C")
    with pytest.raises(ScanError, match="overlap"):
        load_labels(tmp_path / "o.seg.nrrd")


def test_cellposes_pickle_is_refused_by_name(tmp_path: Path) -> None:
    np.save(tmp_path / "scan_seg.npy", {"masks": np.zeros((3, 3, 3))}, allow_pickle=True)  # type: ignore[arg-type]
    with pytest.raises(ScanError, match=r"Cellpose.*_cp_masks"):
        load_labels(tmp_path / "scan_seg.npy", voxel_size="1 mm")
