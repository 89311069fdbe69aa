"""NIfTI: voxels, units, affine and scaling as nibabel and ITK write them; refusals that name the cause."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import nibabel
import numpy as np
import pytest
import SimpleITK as sitk

from mbstudio.core.errors import GrainWarning, ScanError, UnitError
from mbstudio.core.grains import load_labels
from mbstudio.core.scan import open_scan
from tests.fuzzing.harness import cases_of_folder, problems_of

# From the axes right-anterior-superior of NIfTI to left-posterior-superior.
LPS = np.diag([-1.0, -1.0, 1.0, 1.0])


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 60_000, (5, 7, 11)).astype(np.uint16)


def affine(x: float, y: float, z: float, origin: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    matrix = np.diag([x, y, z, 1.0])
    matrix[:3, 3] = origin
    return LPS @ matrix


def write(
    path: Path,
    volume: np.ndarray,
    matrix: np.ndarray | None,
    unit: str = "mm",
    kind: type[nibabel.Nifti1Image] = nibabel.Nifti1Image,
) -> nibabel.Nifti1Image:
    image = kind(volume.T, matrix)
    image.header.set_xyzt_units(unit)
    nibabel.save(image, path)
    return image


@pytest.mark.parametrize("name", ["s.nii", "s.nii.gz", "S.NII.GZ"])
@pytest.mark.parametrize("kind", [nibabel.Nifti1Image, nibabel.Nifti2Image])
def test_as_nibabel_writes_it(tmp_path: Path, volume: np.ndarray, name: str, kind: type) -> None:
    write(tmp_path / name, volume, affine(0.014, 0.015, 0.02, (1.5, -2.0, 3.25)), kind=kind)
    scan = open_scan(tmp_path / name)
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)
    assert scan.voxel_size.zyx == (0.02, 0.015, 0.014)
    assert scan.unit == "mm"
    assert scan.origin == (1.5, -2.0, 3.25)
    assert scan.is_memory_mapped == (name == "s.nii")


@pytest.mark.parametrize("kind", ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_types_and_byte_orders(tmp_path: Path, rng: np.random.Generator, kind: str, order: str) -> None:
    volume = (rng.random((4, 5, 6)) * 100).astype(kind)
    header = nibabel.Nifti1Header(endianness=order)
    header.set_data_dtype(np.dtype(kind))
    image = nibabel.Nifti1Image(volume.T, affine(0.1, 0.1, 0.1), header)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, tmp_path / "s.nii")
    scan = open_scan(tmp_path / "s.nii")
    assert np.dtype(scan.voxels.dtype).newbyteorder("=") == np.dtype(kind)
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)


@pytest.mark.parametrize(
    ("unit", "edge", "name"), [("micron", 14.0, "um"), ("mm", 0.014, "mm"), ("meter", 14e-6, "m")]
)
def test_units(tmp_path: Path, volume: np.ndarray, unit: str, edge: float, name: str) -> None:
    write(tmp_path / "s.nii", volume, affine(edge, edge, edge), unit)
    scan = open_scan(tmp_path / "s.nii")
    assert scan.unit == name
    assert scan.voxel_size.to("um").zyx == pytest.approx((14, 14, 14))


def test_a_file_without_unit_asks(tmp_path: Path, volume: np.ndarray) -> None:
    write(tmp_path / "s.nii", volume, affine(14, 14, 14), "unknown")
    with pytest.raises(UnitError, match=r"s\.nii.*14 x 14 x 14.*without a unit"):
        open_scan(tmp_path / "s.nii")
    assert open_scan(tmp_path / "s.nii", unit="um").voxel_size.zyx == (14, 14, 14)


@pytest.mark.parametrize("edge", [1.0, 5.0, 14.0])
def test_millimetres_that_nobody_meant(tmp_path: Path, volume: np.ndarray, edge: float) -> None:
    """ITK writes millimetres for micrometres, and 1 mm where nothing was set."""
    image = sitk.GetImageFromArray(volume)
    image.SetSpacing((edge, edge, edge))
    sitk.WriteImage(image, tmp_path / "s.nii")
    with pytest.raises(UnitError, match=r"s\.nii gives a voxel size of .* mm"):
        open_scan(tmp_path / "s.nii")
    assert open_scan(tmp_path / "s.nii", f"{edge} um").voxel_size.x == edge


@pytest.mark.parametrize("ending", [".nii", ".nii.gz"])
def test_the_same_as_in_meta_image(tmp_path: Path, volume: np.ndarray, ending: str) -> None:
    image = sitk.GetImageFromArray(volume)
    image.SetSpacing((0.014, 0.015, 0.02))
    image.SetOrigin((0.5, -1.5, 2.0))
    for signs in ((1, 1, 1), (-1, 1, 1), (1, -1, -1), (1, 1, -1)):
        image.SetDirection(np.diag(np.array(signs, float)).ravel())
        for name in (f"s{ending}", "s.mha"):
            sitk.WriteImage(image, tmp_path / name)
        mine, its = open_scan(tmp_path / f"s{ending}"), open_scan(tmp_path / "s.mha")
        np.testing.assert_array_equal(np.asarray(mine.voxels), np.asarray(its.voxels))
        assert mine.origin == pytest.approx(its.origin, abs=1e-6)
        assert mine.voxel_size.zyx == pytest.approx(its.voxel_size.zyx, rel=1e-6)
        assert mine.grid is not None
        assert its.grid is not None
        np.testing.assert_allclose(mine.grid.steps, its.grid.steps, atol=1e-8)


def test_a_mirrored_store_is_no_mirrored_scan(tmp_path: Path, volume: np.ndarray) -> None:
    write(tmp_path / "s.nii", volume[:, :, ::-1], affine(-0.1, 0.1, 0.1, (1.0, 0, 0)))
    scan = open_scan(tmp_path / "s.nii")
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)
    assert scan.origin == pytest.approx((0, 0, 0), abs=1e-6)


def test_quaternions_alone(tmp_path: Path, volume: np.ndarray) -> None:
    image = nibabel.Nifti1Image(volume.T, None)
    image.header.set_xyzt_units("mm")
    image.set_qform(affine(0.014, 0.015, 0.02, (1.5, 0, 0)), 1)
    image.set_sform(None, 0)
    nibabel.save(image, tmp_path / "s.nii")
    scan = open_scan(tmp_path / "s.nii")
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)
    assert scan.voxel_size.zyx == pytest.approx((0.02, 0.015, 0.014))
    assert scan.origin == pytest.approx((1.5, 0, 0))


def test_edges_alone_turn_nothing(tmp_path: Path, volume: np.ndarray) -> None:
    image = nibabel.Nifti1Image(volume.T, None)
    image.header.set_zooms((0.014, 0.015, 0.02))
    image.header.set_xyzt_units("mm")
    image.set_sform(None, 0)
    image.set_qform(None, 0)
    nibabel.save(image, tmp_path / "s.nii")
    scan = open_scan(tmp_path / "s.nii")
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)
    assert scan.grid is None
    assert scan.voxel_size.zyx == (0.02, 0.015, 0.014)


def test_two_sizes_in_one_file(tmp_path: Path, volume: np.ndarray) -> None:
    image = write(tmp_path / "s.nii", volume, affine(0.014, 0.014, 0.014))
    content = bytearray((tmp_path / "s.nii").read_bytes())
    header = image.header.copy()
    header["pixdim"][3] = 0.02
    content[:348] = header.binaryblock
    (tmp_path / "s.nii").write_bytes(content)
    with pytest.raises(UnitError, match=r"two voxel sizes: .*0\.014 .* by its affine, .*0\.02 by pixdim"):
        open_scan(tmp_path / "s.nii")


def test_slope_and_intercept(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = rng.integers(0, 4000, (5, 7, 11)).astype(np.int16)
    for slope, intercept, kind in ((2.0, -10.5, np.float32), (1.0, -1024.0, np.int32), (0.0, 7.0, np.int16)):
        image = nibabel.Nifti1Image(stored.T, affine(0.1, 0.1, 0.1))
        image.header.set_xyzt_units("mm")
        nibabel.save(image, tmp_path / "s.nii")
        content = bytearray((tmp_path / "s.nii").read_bytes())
        content[112:120] = np.array([slope, intercept], "<f4").tobytes()
        (tmp_path / "s.nii").write_bytes(content)
        meant = stored.astype(float) * slope + intercept if slope else stored
        scan = open_scan(tmp_path / "s.nii")
        np.testing.assert_array_equal(np.asarray(scan.voxels), meant)
        assert scan.voxels.dtype == kind
        from mbstudio.core.scan.readers import nifti

        monkeypatch.setattr(nifti, "DECODE_AT_ONCE_BYTES", 0)
        lazy = open_scan(tmp_path / "s.nii")
        np.testing.assert_array_equal(lazy.voxels[3], meant[3])
        assert lazy.voxels.dtype == kind
        monkeypatch.undo()


def test_grey_colours(tmp_path: Path, volume: np.ndarray) -> None:
    grey = (volume % 256).astype(np.uint8)
    colours = np.stack([grey] * 3, -1)
    for name, third in (("grey", grey), ("blue", 255 - grey)):
        colours[..., 2] = third
        pixels = np.ascontiguousarray(colours).view([("R", "u1"), ("G", "u1"), ("B", "u1")])[..., 0]
        write(tmp_path / f"{name}.nii", pixels, affine(0.1, 0.1, 0.1))
    np.testing.assert_array_equal(np.asarray(open_scan(tmp_path / "grey.nii").voxels), grey)
    with pytest.raises(ScanError, match="colour images"):
        open_scan(tmp_path / "blue.nii")


def test_several_volumes(tmp_path: Path, volume: np.ndarray) -> None:
    image = nibabel.Nifti1Image(np.stack([volume.T, volume.T], -1), affine(0.1, 0.1, 0.1))
    nibabel.save(image, tmp_path / "s.nii")
    with pytest.raises(ScanError, match="more than one volume \\(11 x 7 x 5 x 2"):
        open_scan(tmp_path / "s.nii")
    image = nibabel.Nifti1Image(volume.T[..., None, None], affine(0.1, 0.1, 0.1))
    image.header.set_xyzt_units("mm")
    nibabel.save(image, tmp_path / "t.nii")
    np.testing.assert_array_equal(np.asarray(open_scan(tmp_path / "t.nii").voxels), volume)


def test_labels_land_where_their_affine_says(tmp_path: Path) -> None:
    scan = np.full((12, 14, 16), 20, np.uint8)
    labels = np.zeros(scan.shape, np.uint8)
    labels[2:6, 3:7, 4:8], labels[7:10, 8:12, 9:14] = 1, 2
    scan[labels > 0] = 200
    write(tmp_path / "scan.nii.gz", scan, affine(0.1, 0.1, 0.1, (1, 2, 3)))
    crop = labels[1:, 2:, 3:]
    write(tmp_path / "labels.nii.gz", crop[:, :, ::-1], affine(-0.1, 0.1, 0.1, (2.5, 2.2, 3.1)))
    with pytest.warns(GrainWarning, match=r"from voxel \(1, 2, 3\)"):
        grains = load_labels(tmp_path / "labels.nii.gz", open_scan(tmp_path / "scan.nii.gz"))
    np.testing.assert_array_equal(grains.labels, labels)
    # One file of ITK's frame and one of NIfTI's lie alike.
    image = sitk.GetImageFromArray(scan)
    image.SetSpacing((0.1, 0.1, 0.1))
    image.SetOrigin((1, 2, 3))
    sitk.WriteImage(image, tmp_path / "scan.nrrd")
    with pytest.warns(GrainWarning, match=r"from voxel \(1, 2, 3\)"):
        grains = load_labels(tmp_path / "labels.nii.gz", open_scan(tmp_path / "scan.nrrd", unit="mm"))
    np.testing.assert_array_equal(grains.labels, labels)


def test_what_is_damaged_is_said_to_be(tmp_path: Path, volume: np.ndarray) -> None:
    write(tmp_path / "s.nii.gz", volume, affine(0.1, 0.1, 0.1))
    write(tmp_path / "s.nii", volume, affine(0.1, 0.1, 0.1))
    whole = (tmp_path / "s.nii").read_bytes()
    (tmp_path / "cut.nii").write_bytes(whole[:-10])
    (tmp_path / "short.nii").write_bytes(whole[:100])
    (tmp_path / "cut.nii.gz").write_bytes((tmp_path / "s.nii.gz").read_bytes()[:-40])
    (tmp_path / "inside.nii.gz").write_bytes(gzip.compress(whole[:-10]))
    for name, told in (
        ("cut.nii", "cut off, or the header is wrong"),
        ("short.nii", "not a NIfTI file"),
        ("cut.nii.gz", "damaged or cut off"),
        ("inside.nii.gz", "fewer packed voxels than its header states"),
    ):
        with pytest.raises(ScanError, match=told):
            open_scan(tmp_path / name)


def test_what_is_not_damaged_is_not(tmp_path: Path, volume: np.ndarray) -> None:
    write(tmp_path / "s.nii", volume, affine(0.1, 0.1, 0.1))
    whole = bytearray((tmp_path / "s.nii").read_bytes())

    def changed(name: str, place: int, content: bytes) -> Path:
        other = bytearray(whole)
        other[place : place + len(content)] = content
        (tmp_path / name).write_bytes(other)
        return tmp_path / name

    cases = (
        (changed("pair.nii", 344, b"ni1\0"), r"a file of their own \(\.img\)"),
        (changed("complex.nii", 70, b"\x20\0"), "values of type complex64"),
        (changed("type.nii", 70, b"\x99\0"), "a type that NIfTI does not know"),
        (changed("dim.nii", 42, b"\xff\xff"), "how many voxels it holds"),
        (changed("scale.nii", 112, np.array([np.inf, 0], "<f4").tobytes()), "scl_slope, scl_inter"),
        (changed("offset.nii", 108, np.float32(np.nan).tobytes()), "begin at byte nan"),
    )
    for path, told in cases:
        with pytest.raises(ScanError, match=told) as caught:
            open_scan(path)
        assert "damaged" not in str(caught.value).replace(str(path), "")
    shear = affine(0.1, 0.1, 0.1)
    shear[0, 1] = 0.05
    write(tmp_path / "shear.nii", volume, shear)
    with pytest.raises(ScanError, match="not at right angles"):
        open_scan(tmp_path / "shear.nii")


def test_sizes_are_checked_before_memory_is_taken(tmp_path: Path, volume: np.ndarray) -> None:
    write(tmp_path / "s.nii", volume, affine(0.1, 0.1, 0.1))
    content = bytearray((tmp_path / "s.nii").read_bytes())
    content[42:48] = np.array([3000, 3000, 3000], "<i2").tobytes()
    (tmp_path / "s.nii").write_bytes(content)
    with pytest.raises(ScanError, match="54,000,000,000 bytes"):
        open_scan(tmp_path / "s.nii")
    (tmp_path / "t.nii.gz").write_bytes(gzip.compress(bytes(content)))
    with pytest.raises(ScanError, match=r"54,000,000,\d+ bytes, but holds"):
        open_scan(tmp_path / "t.nii.gz")


@pytest.mark.skipif(os.name != "posix", reason="memory is bounded by a call of POSIX")
def test_damaged_files_are_refused(tmp_path: Path, volume: np.ndarray) -> None:
    folder = tmp_path / "whole"
    folder.mkdir()
    write(folder / "a.nii", volume, affine(0.1, 0.1, 0.1))
    write(folder / "b.nii.gz", volume, affine(0.1, 0.1, 0.1))
    write(folder / "c.nii", volume, affine(0.1, 0.1, 0.1), kind=nibabel.Nifti2Image)
    assert problems_of(tmp_path, cases_of_folder(folder), 60) == []
