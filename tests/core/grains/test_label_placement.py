"""Labels lie on the voxels of the scan that they were made on, or are refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk
import tifffile
import zarr

from mbstudio.core.errors import GrainWarning, SegmentationError
from mbstudio.core.grains import load_labels
from mbstudio.core.grains.label_writing import write_label_image
from mbstudio.core.scan import Scan, open_scan
from tests.core.grains.placed_files import write_nrrd


@pytest.fixture
def labels() -> np.ndarray:
    z, y, x = np.indices((30, 36, 42))
    image = np.zeros(z.shape, np.uint16)
    for number, (centre, radius) in enumerate((((9, 9, 10), 6), ((10, 26, 12), 7), ((20, 12, 30), 8)), 1):
        image[
            sum((axis - place) ** 2 for axis, place in zip((z, y, x), centre, strict=True)) <= radius**2
        ] = number
    return image


@pytest.fixture
def grey(labels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return (np.where(labels > 0, 180, 60) + rng.normal(0, 8, labels.shape)).clip(0, 255).astype(np.uint8)


def write(path: Path, voxels: np.ndarray, steps: np.ndarray, origin: tuple[float, ...] = (0, 0, 0)) -> Path:
    return write_nrrd(path, voxels, steps, origin)


def as_itk(path: Path, voxels: np.ndarray, origin: tuple[float, ...] = (0, 0, 0), turn: str = "") -> Path:
    image = sitk.GetImageFromArray(voxels)
    image.SetSpacing((0.01, 0.01, 0.01))
    image.SetOrigin(origin)
    if turn:
        image = sitk.DICOMOrient(image, turn)
    sitk.WriteImage(image, str(path))
    return path


def grey_under(source: Path | np.ndarray, scan: Scan) -> float:
    found = load_labels(source, scan)
    assert found.labels.shape == scan.shape
    assert len(found) == 3
    return float(np.asarray(scan.voxels)[found.labels > 0].mean())


DIAGONALS = [np.diag([0.01 * a, 0.01 * b, 0.01 * c]) for a in (1, -1) for b in (1, -1) for c in (1, -1)]


@pytest.mark.parametrize("steps", DIAGONALS)
def test_stored_as_the_tiff_whatever_the_directions(
    tmp_path: Path, labels: np.ndarray, grey: np.ndarray, steps: np.ndarray
) -> None:
    tifffile.imwrite(tmp_path / "scan.tif", grey)
    scan = open_scan(tmp_path / "scan.tif", "10 um")
    assert grey_under(write(tmp_path / "l.nrrd", labels, steps), scan) > 175
    flips = tuple(slice(None, None, -1 if steps[axis, axis] < 0 else 1) for axis in (2, 1, 0))
    if steps.min() < 0:
        assert grey_under(write(tmp_path / "f.nrrd", labels[flips], steps), scan) > 175


@pytest.mark.parametrize("turn", ["LPS", "RAS", "ASL", "SAR", "PIR", "RPI"])
@pytest.mark.parametrize("turned", ["labels", "scan"])
@pytest.mark.parametrize("ending", ["mha", "nrrd"])
def test_turned_files_meet_in_space(
    tmp_path: Path, labels: np.ndarray, grey: np.ndarray, turn: str, turned: str, ending: str
) -> None:
    scan = as_itk(tmp_path / f"s.{ending}", grey, (1, 2, 3), turn if turned == "scan" else "")
    image = as_itk(tmp_path / f"l.{ending}", labels, (1, 2, 3), turn if turned == "labels" else "")
    opened = open_scan(scan, "10 um") if ending == "nrrd" else open_scan(scan)
    assert grey_under(image, opened) > 175


def test_a_cropped_segmentation_lands_where_its_origin_says(
    tmp_path: Path, labels: np.ndarray, grey: np.ndarray
) -> None:
    part = labels[2:29, 1:35, 3:40]
    origin = (1.03, 2.01, 3.02)
    scan = open_scan(as_itk(tmp_path / "s.mha", grey, (1, 2, 3)))
    with pytest.warns(GrainWarning, match=r"from voxel \(2, 1, 3\)"):
        assert grey_under(as_itk(tmp_path / "l.mha", part, origin, "RAS"), scan) > 175
    tifffile.imwrite(tmp_path / "s.tif", grey)
    bare = open_scan(tmp_path / "s.tif", "10 um")
    with pytest.warns(GrainWarning, match="begins at zero"):
        assert grey_under(as_itk(tmp_path / "m.mha", part, (0.03, 0.01, 0.02)), bare) > 175
    steps = np.diag([-0.01, -0.01, 0.01])
    with pytest.warns(GrainWarning, match="begins at zero"):
        assert grey_under(write(tmp_path / "n.nrrd", part, steps, (-0.03, -0.01, 0.02)), bare) > 175
    for wrong in ((0.9, 2.0, 3.0), (1.035, 2.01, 3.02)):
        with pytest.raises(SegmentationError, match=r"beyond the scan|between the scan's voxels"):
            load_labels(as_itk(tmp_path / "w.mha", part, wrong), scan)
    with pytest.raises(SegmentationError, match="seems to be cropped"):
        load_labels(part, scan)


def test_labels_of_other_voxels_are_refused(tmp_path: Path, labels: np.ndarray, grey: np.ndarray) -> None:
    scan = open_scan(as_itk(tmp_path / "s.mha", grey))
    image = sitk.GetImageFromArray(labels[::2, ::2, ::2])
    image.SetSpacing((0.02, 0.02, 0.02))
    sitk.WriteImage(image, str(tmp_path / "l.mha"))
    with pytest.raises(SegmentationError, match="resample"):
        load_labels(tmp_path / "l.mha", scan)


@pytest.mark.parametrize("flip", [np.s_[:, ::-1], np.s_[::-1], np.s_[:, :, ::-1], np.s_[::-1, ::-1, ::-1]])
def test_labels_without_directions_that_lie_wrongly_are_refused(
    tmp_path: Path, labels: np.ndarray, grey: np.ndarray, flip: tuple[slice, ...]
) -> None:
    tifffile.imwrite(tmp_path / "s.tif", grey)
    tifffile.imwrite(tmp_path / "l.tif", labels[flip])
    with pytest.raises(SegmentationError, match=r"l\.tif does not lie on the grains.*reversed"):
        load_labels(tmp_path / "l.tif", open_scan(tmp_path / "s.tif", "10 um"))


def test_axes_in_another_order(tmp_path: Path, labels: np.ndarray, grey: np.ndarray) -> None:
    tifffile.imwrite(tmp_path / "s.tif", grey)
    with pytest.raises(SegmentationError, match="another order"):
        load_labels(labels.T, open_scan(tmp_path / "s.tif", "10 um"))
    cube, solid = grey[:, :30, :30], labels[:, :30, :30]
    np.save(tmp_path / "c.npy", cube)
    with pytest.raises(SegmentationError, match="does not lie on the grains"):
        load_labels(np.ascontiguousarray(solid.T), open_scan(tmp_path / "c.npy", "10 um"))


def test_labels_that_state_another_voxel_size(tmp_path: Path, labels: np.ndarray, grey: np.ndarray) -> None:
    tifffile.imwrite(tmp_path / "s.tif", grey)
    tifffile.imwrite(tmp_path / "l.tif", labels, imagej=True, resolution=(0.05, 0.05),
                     metadata={"axes": "ZYX", "unit": "um", "spacing": 20})  # fmt: skip
    with pytest.warns(GrainWarning, match="20 µm, the scan's are 10 µm"):
        load_labels(tmp_path / "l.tif", open_scan(tmp_path / "s.tif", "10 um"))


@pytest.mark.parametrize("steps", DIAGONALS[1:])
def test_labels_without_directions_on_a_scan_that_was_turned(
    tmp_path: Path, labels: np.ndarray, grey: np.ndarray, steps: np.ndarray
) -> None:
    scan = open_scan(write(tmp_path / "s.nrrd", grey, steps))
    tifffile.imwrite(tmp_path / "stored.tif", labels)
    assert grey_under(tmp_path / "stored.tif", scan) > 175
    in_its_order = scan.grid.as_read(labels)
    np.save(tmp_path / "read.npy", in_its_order)
    assert grey_under(tmp_path / "read.npy", scan) > 175
    assert grey_under(in_its_order, scan) > 175
    flat = dataclasses.replace(scan, voxels=np.full(labels.shape, 7))
    with pytest.raises(SegmentationError, match="do not tell"):
        load_labels(tmp_path / "stored.tif", flat)


# Written by mbstudio ------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["tif", "nrrd", "mha", "mhd", "ome.zarr"])
@pytest.mark.parametrize("turn", ["", "RAS", "SAR"])
def test_written_labels_come_back(
    tmp_path: Path, labels: np.ndarray, grey: np.ndarray, ending: str, turn: str
) -> None:
    scan = open_scan(as_itk(tmp_path / "s.mha", grey, (1, 2, 3), turn))
    grains = load_labels(as_itk(tmp_path / "l.mha", labels, (1, 2, 3)), scan)
    path = tmp_path / f"out.{ending}"
    if ending == "ome.zarr" and turn == "SAR":
        with pytest.raises(SegmentationError, match=r"out\.ome\.zarr .*axes are turned .*NRRD or MHA"):
            write_label_image(path, grains, scan.grid)
        assert not path.exists()
        return
    write_label_image(path, grains, scan.grid)
    again = load_labels(path, scan)
    np.testing.assert_array_equal(again.labels, grains.labels)
    alone = load_labels(path)
    assert alone.voxel_size.to("um").zyx == pytest.approx((10, 10, 10))
    assert sorted(alone.table["voxels"]) == sorted(grains.table["voxels"])


def test_what_fiji_and_itk_find_in_written_labels(tmp_path: Path, labels: np.ndarray) -> None:
    grains = load_labels(labels, voxel_size="20 x 15 x 10 um")
    write_label_image(tmp_path / "l.tif", grains)
    with tifffile.TiffFile(tmp_path / "l.tif") as file:
        facts = file.imagej_metadata
        assert facts is not None
        assert (facts["unit"], facts["spacing"], facts["slices"]) == ("um", 20.0, 30)
        pixels, units = file.pages[0].tags["XResolution"].value
        assert units / pixels == pytest.approx(10)
        np.testing.assert_array_equal(file.asarray(), labels)
    for ending in ("nrrd", "mha", "mhd"):
        write_label_image(tmp_path / f"l.{ending}", grains)
        image = sitk.ReadImage(str(tmp_path / f"l.{ending}"))
        assert image.GetSpacing() == pytest.approx((0.01, 0.015, 0.02))
        np.testing.assert_array_equal(sitk.GetArrayFromImage(image), labels)
    with pytest.raises(SegmentationError, match=r"l\.png"):
        write_label_image(tmp_path / "l.png", grains)


def test_what_zarr_finds_in_written_labels(tmp_path: Path, labels: np.ndarray) -> None:
    grains = load_labels(labels, voxel_size="20 x 15 x 10 um")
    path = tmp_path / "l.ome.zarr"
    for _ in range(2):  # what mbstudio wrote is written over
        write_label_image(path, grains)
    group = zarr.open_group(path, mode="r")
    assert group.metadata.zarr_format == 3
    facts = group.attrs["ome"]
    assert facts["version"] == "0.5"
    assert "image-label" in facts
    (image,) = facts["multiscales"]
    assert [(axis["name"], axis["type"], axis["unit"]) for axis in image["axes"]] == [
        (name, "space", "micrometer") for name in "zyx"
    ]
    (dataset,) = image["datasets"]
    assert dataset["coordinateTransformations"] == [
        {"type": "scale", "scale": [20.0, 15.0, 10.0]},
        {"type": "translation", "translation": [0.0, 0.0, 0.0]},
    ]
    array = group[dataset["path"]]
    assert array.dtype.kind == "u"
    assert array.metadata.dimension_names == ("z", "y", "x")
    np.testing.assert_array_equal(array[...], labels)
    assert [entry.name for entry in tmp_path.iterdir()] == ["l.ome.zarr"]


def test_a_folder_of_others_is_not_written_over(tmp_path: Path, labels: np.ndarray) -> None:
    grains = load_labels(labels, voxel_size="10 um")
    zarr.create_array(tmp_path / "s.zarr", shape=(2, 2, 2), dtype="u1")
    (tmp_path / "t.zarr").write_text("a file")
    (tmp_path / "l.tif").mkdir()
    for name, told in (
        ("s.zarr", "not written by mbstudio"),
        ("t.zarr", "is a file"),
        ("l.tif", "is a folder"),
    ):
        with pytest.raises(SegmentationError, match=rf"{name} .*{told}.*another name"):
            write_label_image(tmp_path / name, grains)
    assert zarr.open_array(tmp_path / "s.zarr", mode="r").shape == (2, 2, 2)
