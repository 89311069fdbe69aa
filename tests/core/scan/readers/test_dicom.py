"""DICOM series and frames as pydicom and ITK write them: order, place, values, and what is refused."""

from __future__ import annotations

import locale
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pydicom
import pytest
import SimpleITK as sitk
from pydicom import uid
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.encaps import encapsulate
from pydicom.sequence import Sequence as Items

from mbstudio.core.errors import GrainWarning, ScanError, ScanWarning, UnitError
from mbstudio.core.grains import load_labels
from mbstudio.core.project import Project
from mbstudio.core.scan import Scan, open_scan
from tests.fuzzing.harness import cases_of_folder, problems_of

ALONG = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 60_000, (5, 7, 11)).astype(np.uint16)


def dataset(
    image: np.ndarray, series: str = "1.2.3", syntax: str = uid.ExplicitVRLittleEndian, **values: Any
) -> Dataset:
    """Return a CT image of bare pixels; `values` go over what it says."""
    one = Dataset()
    one.file_meta = FileMetaDataset()
    one.file_meta.TransferSyntaxUID = syntax
    one.file_meta.MediaStorageSOPClassUID = one.SOPClassUID = uid.CTImageStorage
    one.file_meta.MediaStorageSOPInstanceUID = one.SOPInstanceUID = uid.generate_uid()
    one.SeriesInstanceUID = series
    one.Rows, one.Columns = image.shape[-2:]
    one.SamplesPerPixel, one.PhotometricInterpretation = 1, "MONOCHROME2"
    one.BitsAllocated = one.BitsStored = 8 * image.itemsize
    one.PixelRepresentation = int(image.dtype.kind == "i")
    for name, value in values.items():
        if value is None:
            del one[name]
        else:
            setattr(one, name, value)
    one.HighBit = one.BitsStored - 1
    if "PixelData" not in one:
        one.PixelData = image.tobytes()
    one["PixelData"].VR = "OB" if one.BitsAllocated == 8 else "OW"
    return one


def save(one: Dataset, path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    one.save_as(path, enforce_file_format=True)
    return path


def write_series(
    folder: Path,
    volume: np.ndarray,
    edges: tuple[float, float, float] = (0.02, 0.015, 0.014),
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    across: Sequence[float] = ALONG,
    change: Callable[[int, Dataset], None] | None = None,
    name: str = "IM{:03d}.dcm",
    **values: Any,
) -> list[Path]:
    """Write slices whose names and numbers run against their places."""
    normal = np.cross(across[:3], across[3:])
    files = []
    for index, image in enumerate(volume):
        one = dataset(image, **values)
        place = np.asarray(origin) + normal * edges[0] * index
        one.ImagePositionPatient = [f"{part:.6f}" for part in place]
        one.ImageOrientationPatient = list(across)
        one.PixelSpacing = [edges[1], edges[2]]
        one.SliceThickness = 5.0  # which is not their distance
        one.InstanceNumber = len(volume) - index
        if change is not None:
            change(index, one)
        files.append(save(one, folder / name.format(len(volume) - index)))
    return files


def assert_same(scan: Scan, volume: np.ndarray) -> None:
    assert scan.shape == volume.shape
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)
    np.testing.assert_array_equal(scan.voxels[2], volume[2])


# Series -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["IM{:03d}.dcm", "IM{:06d}", "1.2.840.{}", "slice{}.IMA"])
def test_a_series_by_its_places(tmp_path: Path, volume: np.ndarray, name: str) -> None:
    files = write_series(tmp_path / "s", volume, origin=(1.0, 2.0, 3.0), name=name)
    for path in (tmp_path / "s", files[2]):
        scan = open_scan(path)
        assert_same(scan, volume)
        assert scan.voxel_size.zyx == pytest.approx((0.02, 0.015, 0.014))
        assert scan.unit == "mm"
        assert scan.origin == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    "across",
    [(1, 0, 0, 0, 1, 0), (-1, 0, 0, 0, -1, 0), (1, 0, 0, 0, -1, 0), (1, 0, 0, 0, 0, -1), (0, 1, 0, 0, 0, 1)],
)
def test_the_same_as_in_meta_image(tmp_path: Path, volume: np.ndarray, across: tuple[float, ...]) -> None:
    write_series(tmp_path / "s", volume, across=across, origin=(1.0, 2.0, 3.0))
    image = sitk.GetImageFromArray(volume)
    image.SetSpacing((0.014, 0.015, 0.02))
    image.SetOrigin((1, 2, 3))
    columns = np.stack([across[:3], across[3:], np.cross(across[:3], across[3:])], axis=1)
    image.SetDirection(columns.astype(float).ravel())
    sitk.WriteImage(image, tmp_path / "s.mha")
    mine, its = open_scan(tmp_path / "s"), open_scan(tmp_path / "s.mha")
    np.testing.assert_array_equal(np.asarray(mine.voxels), np.asarray(its.voxels))
    assert mine.origin == pytest.approx(its.origin, abs=1e-6)
    assert mine.voxel_size.zyx == pytest.approx(its.voxel_size.zyx)
    assert mine.grid is not None
    assert its.grid is not None
    np.testing.assert_allclose(mine.grid.steps, its.grid.steps, atol=1e-9)
    assert mine.grid.flipped == its.grid.flipped


@pytest.fixture(autouse=True)
def _same_locale() -> Iterator[None]:
    """Put back the locale: ITK leaves that of C behind, in which texts beyond ASCII cannot be read."""
    before = locale.setlocale(locale.LC_ALL)
    yield
    locale.setlocale(locale.LC_ALL, before)


@pytest.mark.parametrize("packed", [False, True])
def test_what_itk_writes(tmp_path: Path, rng: np.random.Generator, packed: bool) -> None:
    """Slices one by one, as its examples do, bare and in JPEG 2000."""
    volume = rng.integers(0, 60_000, (4, 64, 80)).astype(np.uint16)
    (tmp_path / "s").mkdir()
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    if packed:
        writer.UseCompressionOn()
    for index, plane in enumerate(volume):
        image = sitk.GetImageFromArray(plane[None])
        image.SetSpacing((0.014, 0.015, 0.02))
        facts = {
            "0020|000e": "1.2.3", "0020|0032": f"0\\0\\{0.02 * index:.3f}", "0020|0037": "1\\0\\0\\0\\1\\0",
            "0020|0013": str(index), "0008|0060": "CT",
        }  # fmt: skip
        for key, value in facts.items():
            image.SetMetaData(key, value)
        writer.SetFileName(str(tmp_path / "s" / f"{index}.dcm"))
        writer.Execute(image)
    syntax = pydicom.dcmread(tmp_path / "s" / "0.dcm").file_meta.TransferSyntaxUID
    assert syntax.is_compressed == packed
    scan = open_scan(tmp_path / "s")
    assert_same(scan, volume)
    assert scan.voxel_size.zyx == pytest.approx((0.02, 0.015, 0.014))


def test_a_project_finds_its_series_again(tmp_path: Path, volume: np.ndarray) -> None:
    write_series(tmp_path / "s", volume)
    Project.new(open_scan(tmp_path / "s")).save(tmp_path / "p.mbs")
    again = Project.open(tmp_path / "p.mbs").scan
    assert again is not None
    assert_same(again, volume)


def test_missing_and_doubled_slices(tmp_path: Path, volume: np.ndarray) -> None:
    write_series(tmp_path / "gap", volume)[2].unlink()
    with pytest.raises(
        ScanError, match=r"gaps in its slices between IM004\.dcm and IM002\.dcm \(1 missing\)"
    ):
        open_scan(tmp_path / "gap")
    files = write_series(tmp_path / "double", volume)
    (tmp_path / "double" / "copy.dcm").write_bytes(files[1].read_bytes())
    with pytest.raises(
        ScanError, match=r"1 slices at the place of another, such as IM004\.dcm and copy\.dcm"
    ):
        open_scan(tmp_path / "double")

    def uneven(index: int, one: Dataset) -> None:
        one.ImagePositionPatient = [0, 0, 0.02 * index + (0.004 if index == 3 else 0)]

    write_series(tmp_path / "uneven", volume, change=uneven)
    with pytest.raises(ScanError, match="gaps in its slices"):
        open_scan(tmp_path / "uneven")


def test_two_series(tmp_path: Path, volume: np.ndarray) -> None:
    write_series(tmp_path / "s", volume, SeriesDescription="dry")
    files = write_series(tmp_path / "s", volume + 1, series="1.2.4", SeriesDescription="wet", name="W{}.dcm")
    with pytest.raises(ScanError, match=r"2 series \(5 like IM001\.dcm \(dry\); 5 like W1\.dcm \(wet\)\)"):
        open_scan(tmp_path / "s")
    assert_same(open_scan(files[0]), volume + 1)


def test_slices_that_do_not_belong_together(tmp_path: Path, volume: np.ndarray) -> None:
    def odd(name: str, value: Any) -> Callable[[int, Dataset], None]:
        return lambda index, one: setattr(one, name, value) if index == 3 else None

    for number, (name, value, told) in enumerate(
        (
            ("ImageOrientationPatient", [0, 1, 0, 1, 0, 0], "different planes"),
            ("PixelSpacing", [0.1, 0.1], "different pixel sizes"),
            ("Columns", 10, "different sizes: .* has 7 x 10 pixels"),
            ("PixelRepresentation", 1, "different pixels"),
            ("ImagePositionPatient", [], "with and without a place"),
            ("ImagePositionPatient", [0.01, 0, 0.06], "shifted sideways by up to 0.01 mm"),
        )
    ):
        write_series(tmp_path / str(number), volume, change=odd(name, value))
        with pytest.raises(ScanError, match=told):
            open_scan(tmp_path / str(number))


def test_other_files_are_told(tmp_path: Path, volume: np.ndarray) -> None:
    write_series(tmp_path / "s", volume)
    (tmp_path / "s" / "readme.txt").write_text("measured on Monday")
    (tmp_path / "s" / "DICOMDIR").write_bytes(b"directory")
    (tmp_path / "s" / ".hidden").write_bytes(b"")
    with pytest.warns(ScanWarning, match=r"not DICOM, which were left out: readme\.txt\."):
        assert_same(open_scan(tmp_path / "s"), volume)


# Values -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["u1", "i1", "u2", "i2", "u4", "i4"])
def test_types(tmp_path: Path, volume: np.ndarray, kind: str) -> None:
    data = (volume % 251).astype(kind)
    write_series(tmp_path / "s", data)
    scan = open_scan(tmp_path / "s")
    assert_same(scan, data)
    assert scan.voxels.dtype == np.dtype(kind)


@pytest.mark.parametrize("syntax", [uid.ImplicitVRLittleEndian, uid.ExplicitVRBigEndian])
def test_other_byte_orders(tmp_path: Path, volume: np.ndarray, syntax: str) -> None:
    data = volume.astype(">u2") if syntax == uid.ExplicitVRBigEndian else volume
    write_series(tmp_path / "s", data, syntax=syntax)
    assert_same(open_scan(tmp_path / "s"), volume)


def test_numbers_of_fewer_bits(tmp_path: Path, rng: np.random.Generator) -> None:
    """Signed numbers of 12 bits, above which an overlay was drawn."""
    meant = rng.integers(-2048, 2048, (4, 6, 8)).astype(np.int16)
    stored = (meant.view(np.uint16) & 0x0FFF) | 0x3000
    write_series(tmp_path / "s", stored, BitsStored=12, PixelRepresentation=1)
    assert_same(open_scan(tmp_path / "s"), meant)


def test_white_at_zero(tmp_path: Path, volume: np.ndarray) -> None:
    write_series(tmp_path / "s", volume % 4096, BitsStored=12, PhotometricInterpretation="MONOCHROME1")
    assert_same(open_scan(tmp_path / "s"), 4095 - volume % 4096)


def test_slope_and_intercept(tmp_path: Path, volume: np.ndarray) -> None:
    data = volume % 4096
    write_series(tmp_path / "ct", data, BitsStored=12, RescaleSlope=1, RescaleIntercept=-1024)
    scan = open_scan(tmp_path / "ct")
    assert scan.voxels.dtype == np.int16
    assert_same(scan, data.astype(int) - 1024)
    write_series(tmp_path / "half", data, RescaleSlope=0.5, RescaleIntercept=3)
    assert_same(open_scan(tmp_path / "half"), data * 0.5 + 3)

    def scaled(index: int, one: Dataset) -> None:
        one.RescaleSlope, one.RescaleIntercept = index + 1, 0

    write_series(tmp_path / "pet", data, change=scaled)
    scan = open_scan(tmp_path / "pet")
    assert_same(scan, data * np.arange(1.0, 6.0)[:, None, None])
    assert scan.voxels.dtype == np.float32


def test_grey_colours(tmp_path: Path, volume: np.ndarray) -> None:
    grey = (volume % 256).astype(np.uint8)
    for planar in (0, 1):

        def colour(index: int, one: Dataset, planar: int = planar) -> None:
            one.SamplesPerPixel, one.PhotometricInterpretation, one.PlanarConfiguration = 3, "RGB", planar
            one.PixelData = np.stack([grey[index]] * 3, 0 if planar else -1).tobytes()

        write_series(tmp_path / str(planar), grey, change=colour)
        assert_same(open_scan(tmp_path / str(planar)), grey)


# Packed pixels ------------------------------------------------------------------------------------------

PACKED = {
    uid.RLELossless: None,
    uid.JPEGBaseline8Bit: lambda image: imagecodecs.jpeg8_encode(image, 100),
    uid.JPEGLosslessSV1: lambda image: imagecodecs.ljpeg_encode(image.view(f"u{image.itemsize}")),
    uid.JPEGLSLossless: lambda image: imagecodecs.jpegls_encode(image.view(f"u{image.itemsize}")),
    uid.JPEG2000Lossless: lambda image: imagecodecs.jpeg2k_encode(image, level=0, codecformat="j2k"),
}


def pack(one: Dataset, image: np.ndarray, syntax: str) -> None:
    if syntax == uid.RLELossless:
        one.compress(uid.RLELossless, generate_instance_uid=False)
        return
    one.file_meta.TransferSyntaxUID = syntax
    frames = image if image.ndim == 3 else image[None]
    one.PixelData = encapsulate([bytes(PACKED[syntax](frame)) for frame in frames])
    one["PixelData"].VR = "OB"
    one["PixelData"].is_undefined_length = True


@pytest.mark.parametrize("syntax", PACKED, ids=lambda syntax: syntax.name)
@pytest.mark.parametrize("kind", ["u1", "u2", "i2"])
def test_packed_pixels(tmp_path: Path, volume: np.ndarray, syntax: uid.UID, kind: str) -> None:
    lossy = syntax == uid.JPEGBaseline8Bit
    if lossy and kind != "u1":
        pytest.skip("of 8 bits only")
    smooth = np.add.outer(np.arange(5) * 20, np.add.outer(np.arange(7) * 3, np.arange(11))).astype("u2")
    data = (smooth if lossy else volume % (250 if kind == "u1" else 4000)).astype(kind)
    write_series(tmp_path / "s", data, change=lambda index, one: pack(one, data[index], syntax))
    scan = open_scan(tmp_path / "s")
    assert scan.voxels.dtype == np.dtype(kind)
    if lossy:
        np.testing.assert_allclose(np.asarray(scan.voxels).astype(int), data, atol=3)
    else:
        assert_same(scan, data)


def test_packed_frames_in_fragments(tmp_path: Path, volume: np.ndarray) -> None:
    """With a table of where frames begin, since a frame may lie in several pieces."""
    one = dataset(volume, NumberOfFrames=len(volume), PixelSpacing=[0.1, 0.1], SpacingBetweenSlices=0.1)
    frames = [imagecodecs.jpegls_encode(image) for image in volume]
    one.file_meta.TransferSyntaxUID = uid.JPEGLSLossless
    one.PixelData = encapsulate([bytes(frame) for frame in frames], fragments_per_frame=2, has_bot=True)
    one["PixelData"].VR, one["PixelData"].is_undefined_length = "OB", True
    save(one, tmp_path / "s.dcm")
    with pytest.warns(ScanWarning, match="as SpacingBetweenSlices says"):
        assert_same(open_scan(tmp_path / "s.dcm"), volume)


@pytest.mark.parametrize(
    "syntax", [uid.MPEG2MPML, uid.SMPTEST211020UncompressedProgressiveActiveVideo, uid.UID("1.2.3")]
)
def test_packing_that_is_not_read(tmp_path: Path, volume: np.ndarray, syntax: uid.UID) -> None:
    def pretend(_index: int, one: Dataset) -> None:
        one.PixelData = encapsulate([b"1234"])
        one["PixelData"].VR, one["PixelData"].is_undefined_length = "OB", True
        one.file_meta.TransferSyntaxUID = uid.JPEGBaseline8Bit

    for file in write_series(tmp_path / "s", volume, change=pretend):
        content = file.read_bytes()
        old = uid.JPEGBaseline8Bit.encode() + b"\0" * (len(uid.JPEGBaseline8Bit) % 2)
        new = syntax.encode() + b"\0" * (len(syntax) % 2)
        place = content.index(old)
        length = len(new).to_bytes(2, "little")
        file.write_bytes(content[: place - 2] + length + new + content[place + len(old) :])
    with pytest.raises(ScanError, match=rf"packed as {syntax.name}, which is not read here"):
        open_scan(tmp_path / "s")


# Files of many frames -----------------------------------------------------------------------------------


def enhanced(
    volume: np.ndarray, order: Sequence[int], edges: tuple[float, float, float] = (0.02, 0.015, 0.014)
) -> Dataset:
    """Return an enhanced CT image whose frames are stored in some order."""
    edges = (0.02, 0.015, 0.014)
    one = dataset(volume[list(order)], NumberOfFrames=len(volume))
    one.SOPClassUID = one.file_meta.MediaStorageSOPClassUID = uid.EnhancedCTImageStorage
    shared, measures, plane, values = Dataset(), Dataset(), Dataset(), Dataset()
    measures.PixelSpacing, measures.SliceThickness = [edges[1], edges[2]], 5.0
    plane.ImageOrientationPatient = list(ALONG)
    values.RescaleSlope, values.RescaleIntercept = 1, 0
    shared.PixelMeasuresSequence, shared.PlaneOrientationSequence = Items([measures]), Items([plane])
    shared.PixelValueTransformationSequence = Items([values])
    one.SharedFunctionalGroupsSequence = Items([shared])
    groups = []
    for index in order:
        group, place = Dataset(), Dataset()
        place.ImagePositionPatient = [1.0, 2.0, f"{3 + edges[0] * index:.6f}"]
        group.PlanePositionSequence = Items([place])
        groups.append(group)
    one.PerFrameFunctionalGroupsSequence = Items(groups)
    return one


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4), (4, 3, 2, 1, 0), (2, 0, 4, 1, 3)])
def test_enhanced_files(tmp_path: Path, volume: np.ndarray, order: tuple[int, ...]) -> None:
    save(enhanced(volume, order), tmp_path / "s.dcm")
    scan = open_scan(tmp_path / "s.dcm")
    assert_same(scan, volume)
    assert scan.voxel_size.zyx == pytest.approx((0.02, 0.015, 0.014))
    assert scan.origin == (1.0, 2.0, 3.0)
    assert scan.is_memory_mapped == (order == (0, 1, 2, 3, 4))
    assert_same(open_scan(tmp_path), volume)


def test_enhanced_files_in_frames_that_are_scaled(tmp_path: Path, volume: np.ndarray) -> None:
    one = enhanced(volume, range(5))
    one.SharedFunctionalGroupsSequence[0].PixelValueTransformationSequence[0].RescaleIntercept = -7
    pack(one, volume, uid.RLELossless)
    save(one, tmp_path / "s.dcm")
    assert_same(open_scan(tmp_path / "s.dcm"), volume.astype(int) - 7)


def test_volumes_of_itk(tmp_path: Path, volume: np.ndarray) -> None:
    """One file for all, with the places of its frames."""
    image = sitk.GetImageFromArray(volume)
    image.SetSpacing((0.014, 0.015, 0.02))
    image.SetOrigin((1, 2, 3))
    sitk.WriteImage(image, tmp_path / "s.dcm")
    scan = open_scan(tmp_path / "s.dcm")
    assert_same(scan, volume)
    assert scan.voxel_size.zyx == pytest.approx((0.02, 0.015, 0.014))
    assert scan.origin == (1, 2, 3)


def test_frames_without_places(tmp_path: Path, volume: np.ndarray) -> None:
    one = dataset(volume, NumberOfFrames=len(volume), PixelSpacing=[0.015, 0.014])
    save(one, tmp_path / "a.dcm")
    with pytest.raises(UnitError, match=r"gives pixels of 0\.015 x 0\.014 mm, but not how far"):
        open_scan(tmp_path / "a.dcm")
    one.SpacingBetweenSlices = 0.02
    save(one, tmp_path / "b.dcm")
    with pytest.warns(ScanWarning, match=r"0\.02 mm apart, as SpacingBetweenSlices says"):
        scan = open_scan(tmp_path / "b.dcm")
    assert_same(scan, volume)
    assert scan.voxel_size.zyx == pytest.approx((0.02, 0.015, 0.014))


# What is asked for, and refused -------------------------------------------------------------------------


def test_sizes_that_are_not_said(tmp_path: Path, volume: np.ndarray) -> None:
    def without(*names: str) -> Callable[[int, Dataset], None]:
        def change(_index: int, one: Dataset) -> None:
            for name in names:
                delattr(one, name)

        return change

    write_series(tmp_path / "a", volume, change=without("PixelSpacing"))
    with pytest.raises(UnitError, match=r"gives slices 0\.02 mm apart, but no size of its pixels"):
        open_scan(tmp_path / "a")
    assert_same(open_scan(tmp_path / "a", "14 um"), volume)
    write_series(
        tmp_path / "b", volume[::-1], change=without("ImagePositionPatient", "ImageOrientationPatient")
    )
    with pytest.warns(ScanWarning, match="order of InstanceNumber"):
        scan = open_scan(tmp_path / "b", "14 um")
    assert_same(scan, volume)
    with pytest.raises(UnitError, match=r"gives pixels of 0\.015 x 0\.014 mm, but not how far its slices"):
        open_scan(tmp_path / "b")
    write_series(tmp_path / "c", volume, change=without("ImagePositionPatient", "InstanceNumber"))
    with pytest.raises(ScanError, match="without place or number"):
        open_scan(tmp_path / "c", "14 um")
    write_series(tmp_path / "d", volume, edges=(14.0, 14.0, 14.0))  # micrometres that nobody said
    with pytest.raises(UnitError, match="14 mm, outside the range of scans"):
        open_scan(tmp_path / "d")


def test_what_is_no_grey_image(tmp_path: Path, volume: np.ndarray) -> None:
    grey = (volume % 256).astype(np.uint8)
    cases = (
        ({"PhotometricInterpretation": "PALETTE COLOR"}, "in the colours PALETTE COLOR"),
        ({"PhotometricInterpretation": "YBR_FULL", "SamplesPerPixel": 3}, "in the colours YBR_FULL"),
        ({"SOPClassUID": uid.SegmentationStorage}, "a DICOM segmentation"),
        ({"BitsStored": 1, "BitsAllocated": 8}, "pixels of 1 in 8 bits"),
        ({"RescaleSlope": 0, "RescaleIntercept": 0}, r"rescales its values by 0\.0 and 0\.0"),
        ({"ModalityLUTSequence": Items([Dataset()])}, "rescaled by a table"),
    )
    for number, (values, told) in enumerate(cases):
        files = write_series(tmp_path / str(number), grey, **values)
        with pytest.raises(ScanError, match=told) as caught:
            open_scan(files[0])
        assert "damaged" not in str(caught.value).replace(str(tmp_path), "")
    plan = dataset(grey[0])
    del plan.PixelData
    save(plan, tmp_path / "plan.dcm")
    with pytest.raises(ScanError, match=r"holds no image \(CT Image Storage\)"):
        open_scan(tmp_path / "plan.dcm")


def test_what_is_damaged(tmp_path: Path, volume: np.ndarray) -> None:
    file = write_series(tmp_path / "s", volume)[0]
    whole = file.read_bytes()
    file.write_bytes(whole[:-20])
    with pytest.raises(ScanError, match=r"IM005\.dcm .*(cut off|damaged)"):
        open_scan(tmp_path / "s")
    file.write_bytes(b"nothing")
    with pytest.raises(ScanError, match=r"IM005\.dcm does not begin as DICOM files do"):
        open_scan(tmp_path / "s")
    packed = write_series(
        tmp_path / "p", volume, change=lambda k, one: pack(one, volume[k], uid.JPEGLSLossless)
    )
    content = packed[0].read_bytes()
    packed[0].write_bytes(content[:-30])
    with pytest.raises(ScanError, match=r"cut off or damaged|packed frames that it states"):
        np.asarray(open_scan(tmp_path / "p").voxels)


def test_claims_are_checked_before_memory_is_taken(tmp_path: Path, volume: np.ndarray) -> None:
    for number, change in enumerate((None, lambda k, one: pack(one, volume[k], uid.JPEG2000Lossless))):
        for file in write_series(tmp_path / str(number), volume, change=change):
            one = pydicom.dcmread(file)
            one.Rows = one.Columns = 65535
            one.save_as(file)
        with pytest.raises(ScanError, match=r"65535 x 65535 pixels, 8,589,672,450 bytes, but holds"):
            open_scan(tmp_path / str(number))


def test_packed_frames_of_another_size(tmp_path: Path, volume: np.ndarray) -> None:
    """A frame of 100 megapixels where 77 pixels are stated is not unpacked."""
    large = np.zeros((10_000, 10_000), np.uint8)
    for syntax in (uid.JPEGLSLossless, uid.JPEGBaseline8Bit, uid.JPEG2000Lossless):
        packed = bytes(PACKED[syntax](large))

        def swap(_index: int, one: Dataset, packed: bytes = packed, syntax: str = syntax) -> None:
            pack(one, (volume[0] % 256).astype(np.uint8), syntax)
            one.PixelData = encapsulate([packed])

        write_series(tmp_path / syntax, (volume[:2] % 256).astype(np.uint8), change=swap)
        with pytest.raises(ScanError, match=r"cannot unpack .*\(10000, 10000\)"):
            np.asarray(open_scan(tmp_path / syntax).voxels)


def test_labels_on_a_series(tmp_path: Path) -> None:
    scan = np.full((12, 14, 16), 20, np.uint16)
    labels = np.zeros(scan.shape, np.uint16)
    labels[2:6, 3:7, 4:8], labels[7:10, 8:12, 9:14] = 1, 2
    scan[labels > 0] = 200
    write_series(tmp_path / "s", scan, edges=(0.02, 0.02, 0.02), origin=(1, 2, 3))
    write_series(tmp_path / "l", labels[1:, 2:, 3:], edges=(0.02, 0.02, 0.02), origin=(1.06, 2.04, 3.02))
    with pytest.warns(GrainWarning, match=r"from voxel \(1, 2, 3\)"):
        grains = load_labels(tmp_path / "l", open_scan(tmp_path / "s"))
    np.testing.assert_array_equal(grains.labels, labels)


@pytest.mark.skipif(os.name != "posix", reason="memory is bounded by a call of POSIX")
def test_damaged_files_are_refused(tmp_path: Path, volume: np.ndarray) -> None:
    folder = tmp_path / "whole"
    write_series(folder / "a", volume[:3])
    write_series(folder / "b", volume[:2], change=lambda k, one: pack(one, volume[k], uid.JPEGLSLossless))
    write_series(folder / "c", volume[:2], change=lambda k, one: pack(one, volume[k], uid.RLELossless))
    save(enhanced(volume, range(5)), folder / "d.dcm")
    assert problems_of(tmp_path, cases_of_folder(folder), 60) == []
