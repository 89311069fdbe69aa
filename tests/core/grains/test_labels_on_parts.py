"""Labels land on a part of a scan where they lie in space, or are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from mbstudio.core.errors import GrainWarning, SegmentationError
from mbstudio.core.grains import load_labels
from mbstudio.core.grains.label_writing import write_label_image
from mbstudio.core.scan import Scan, open_scan
from mbstudio.core.scan.excerpt import read_crop
from tests.core.grains.placed_files import write_nrrd

CROP = "2:28,4:34,3:40"


@pytest.fixture
def labels() -> np.ndarray:
    z, y, x = np.indices((30, 36, 42))
    image = np.zeros(z.shape, np.uint16)
    for number, (centre, radius) in enumerate((((9, 11, 10), 5), ((10, 26, 12), 6), ((19, 14, 30), 7)), 1):
        image[
            sum((axis - place) ** 2 for axis, place in zip((z, y, x), centre, strict=True)) <= radius**2
        ] = number
    return image


@pytest.fixture
def grey(labels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return (np.where(labels > 0, 180, 60) + rng.normal(0, 8, labels.shape)).clip(0, 255).astype(np.uint8)


def write(path: Path, voxels: np.ndarray, steps: np.ndarray, origin: tuple[float, ...] = (1, 2, 3)) -> Path:
    return write_nrrd(path, voxels, steps, origin)


STEPS = np.diag([0.01, 0.01, 0.01])
FLIPPED = np.diag([-0.01, 0.01, -0.01])


def require_in_place(scan: Scan, source: object, labels: np.ndarray, crop: str = CROP) -> None:
    found = load_labels(source, scan)
    np.testing.assert_array_equal(found.labels, labels[read_crop(crop, labels.shape)])
    assert found.origin == scan.origin


@pytest.mark.parametrize("steps", [STEPS, FLIPPED])
def test_labels_of_the_whole_file_are_cropped_as_the_scan(
    tmp_path: Path, labels: np.ndarray, grey: np.ndarray, steps: np.ndarray
) -> None:
    flips = tuple(slice(None, None, -1 if steps[axis, axis] < 0 else 1) for axis in (2, 1, 0))
    scan = open_scan(write(tmp_path / "scan.nrrd", grey[flips], steps), crop=CROP)
    with pytest.warns(GrainWarning, match="more than the scan, which is a region"):
        require_in_place(scan, write(tmp_path / "labels.nrrd", labels[flips], steps), labels)
    # Labels that say nothing of space are stored as the file is.
    tifffile.imwrite(tmp_path / "labels.tif", labels[flips], photometric="minisblack")
    with pytest.warns(GrainWarning, match="the labels were cropped to it"):
        require_in_place(scan, tmp_path / "labels.tif", labels)


def test_labels_without_a_place_are_cropped_as_a_scan_without_one(
    tmp_path: Path, labels: np.ndarray, grey: np.ndarray
) -> None:
    tifffile.imwrite(tmp_path / "scan.tif", grey, photometric="minisblack")
    tifffile.imwrite(tmp_path / "labels.tif", labels, photometric="minisblack")
    scan = open_scan(tmp_path / "scan.tif", "10 um", crop=CROP)
    for source in (tmp_path / "labels.tif", labels):
        with pytest.warns(GrainWarning, match="the labels were cropped to it"):
            require_in_place(scan, source, labels)
    require_in_place(scan, labels[read_crop(CROP, labels.shape)], labels)


@pytest.mark.parametrize("ending", ["tif", "nrrd"])
@pytest.mark.parametrize("steps", [STEPS, FLIPPED])
@pytest.mark.parametrize("binning", [None, 2, (1, 2, 2)])
def test_labels_written_of_a_part_come_back_to_it(
    tmp_path: Path, labels: np.ndarray, grey: np.ndarray, ending: str, steps: np.ndarray, binning: object
) -> None:
    crop = "2:28,4:34,4:40"
    if ending == "tif":
        tifffile.imwrite(tmp_path / "scan.tif", grey, photometric="minisblack")
    else:
        write(tmp_path / "scan.nrrd", grey, steps)
    scan = open_scan(tmp_path / f"scan.{ending}", "10 um", crop=crop, binning=binning)
    voxels = labels if ending == "tif" else scan_order(labels, steps)
    factors = {None: (1, 1, 1), 2: (2, 2, 2)}.get(binning, binning)
    of_part = voxels[read_crop(crop, labels.shape)][tuple(slice(None, None, factor) for factor in factors)]
    grains = load_labels(np.ascontiguousarray(of_part), scan)
    for name in ("labels.nrrd", "labels.mha", "labels.ome.zarr"):
        write_label_image(tmp_path / name, grains, scan.grid)
        again = load_labels(tmp_path / name, scan)
        np.testing.assert_array_equal(again.labels, grains.labels)
        np.testing.assert_allclose(
            again.table[["x", "y", "z"]].to_numpy(), grains.table[["x", "y", "z"]].to_numpy()
        )
    if binning is None:
        # They lie where they lay in the whole scan as well, and in another region of it.
        whole = open_scan(tmp_path / f"scan.{ending}", "10 um")
        with pytest.warns(GrainWarning, match="a part of the scan, from voxel"):
            on_whole = load_labels(tmp_path / "labels.nrrd", whole)
        np.testing.assert_array_equal(on_whole.labels, consecutive(voxels))
        other = open_scan(tmp_path / f"scan.{ending}", "10 um", crop="1:27,3:33,2:38")
        with pytest.warns(GrainWarning, match="a part of the scan, from voxel"):
            shifted = load_labels(tmp_path / "labels.nrrd", other)
        np.testing.assert_array_equal(shifted.labels, consecutive(voxels[1:27, 3:33, 2:38]))


def scan_order(labels: np.ndarray, steps: np.ndarray) -> np.ndarray:
    return labels[tuple(slice(None, None, -1 if steps[axis, axis] < 0 else 1) for axis in (2, 1, 0))]


def consecutive(labels: np.ndarray) -> np.ndarray:
    return np.searchsorted(np.unique(labels), labels)


@pytest.mark.parametrize("source", ["whole", "region"])
def test_labels_of_unbinned_voxels_are_refused_on_binned_ones(
    tmp_path: Path, labels: np.ndarray, grey: np.ndarray, source: str
) -> None:
    """A mean of numbers of grains would be the number of another grain."""
    write(tmp_path / "scan.nrrd", grey, STEPS)
    scan = open_scan(tmp_path / "scan.nrrd", crop="2:28,4:34,4:40", binning=2)
    given = labels if source == "whole" else labels[2:28, 4:34, 4:40]
    with pytest.raises(SegmentationError, match=r"before it was binned \(2\).*without a bin"):
        load_labels(given, scan)
    path = write(tmp_path / "labels.nrrd", given, STEPS)
    with pytest.raises(SegmentationError, match="before it was binned"):
        load_labels(path, scan)


def test_fine_labels_of_as_many_voxels_are_not_taken_for_coarse_ones(
    tmp_path: Path, labels: np.ndarray, grey: np.ndarray
) -> None:
    write(tmp_path / "scan.nrrd", grey, STEPS)
    scan = open_scan(tmp_path / "scan.nrrd", binning=2)
    z, y, x = scan.shape
    path = write(tmp_path / "labels.nrrd", labels[:z, :y, :x], STEPS)
    with pytest.raises(SegmentationError, match="voxels that differ from the scan"):
        load_labels(path, scan)


def test_labels_beyond_the_file_are_refused(tmp_path: Path, labels: np.ndarray, grey: np.ndarray) -> None:
    write(tmp_path / "scan.nrrd", grey, STEPS)
    scan = open_scan(tmp_path / "scan.nrrd", crop=CROP)
    path = write(tmp_path / "labels.nrrd", labels, STEPS, (1.2, 2, 3))
    with pytest.raises(SegmentationError, match="beyond the scan"):
        load_labels(path, scan)
