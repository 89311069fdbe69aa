"""Every file family brings back the voxels and the voxel size that were written."""

from __future__ import annotations

from pathlib import Path

import imageio.v3 as iio
import nrrd
import numpy as np
import pytest
import SimpleITK as sitk
import tifffile

from mbstudio.core.errors import ScanError, ScanWarning, UnitError
from mbstudio.core.scan import Scan, open_scan, voxel_digest


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    """Voxels of unlike edges, so that swapped axes are seen."""
    return rng.integers(0, 60_000, (5, 7, 11)).astype(np.uint16)


def assert_same(scan: Scan, volume: np.ndarray) -> None:
    assert scan.shape == volume.shape
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)
    np.testing.assert_array_equal(scan.voxels[2], volume[2])
    np.testing.assert_array_equal(scan.voxels[1:4, :, 3], volume[1:4, :, 3])


# TIFF ------------------------------------------------------------------------------------------


def test_plain_tiff_is_memory_mapped(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "scan.tif"
    tifffile.imwrite(path, volume, metadata=None)
    scan = open_scan(path, "14 um")
    assert scan.is_memory_mapped
    assert scan.voxel_size.zyx == (14, 14, 14)
    assert_same(scan, volume)


def test_compressed_tiff_is_read(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "scan.tif"
    tifffile.imwrite(path, volume, compression="zlib", predictor=True)
    assert_same(open_scan(path, "14 um"), volume)


def test_large_compressed_tiff_is_read_page_by_page(
    tmp_path: Path, volume: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mbstudio.core.scan.readers import tiff

    monkeypatch.setattr(tiff, "DECODE_AT_ONCE_BYTES", 0)
    path = tmp_path / "scan.tif"
    tifffile.imwrite(path, volume, compression="zlib")
    scan = open_scan(path, "14 um")
    assert not isinstance(scan.voxels, np.ndarray)
    assert_same(scan, volume)


def test_pages_written_one_by_one_and_big_endian(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "scan.tif"
    with tifffile.TiffWriter(path, byteorder=">") as writer:
        for image in volume:
            writer.write(image, contiguous=False, metadata=None)
    assert_same(open_scan(path, "14 um"), volume)


def test_imagej_stack_says_its_voxel_size(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "scan.tif"
    tifffile.imwrite(
        path,
        volume,
        imagej=True,
        resolution=(1 / 14, 1 / 15),
        metadata={"spacing": 20.0, "unit": "um", "axes": "ZYX"},
    )
    scan = open_scan(path)
    assert scan.voxel_size.zyx == pytest.approx((20, 15, 14), rel=1e-6)
    assert scan.unit == "um"
    assert_same(scan, volume)


def test_imagej_stack_in_pixels_says_nothing(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "scan.tif"
    tifffile.imwrite(path, volume, imagej=True, metadata={"unit": "pixel", "axes": "ZYX"})
    with pytest.raises(UnitError, match=r"scan\.tif.*voxel_size"):
        open_scan(path)


def test_ome_stack_with_mixed_units(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "scan.ome.tif"
    sizes = {
        "PhysicalSizeX": 14.0,
        "PhysicalSizeXUnit": "µm",
        "PhysicalSizeY": 15.0,
        "PhysicalSizeYUnit": "µm",
    }
    tifffile.imwrite(
        path,
        volume,
        ome=True,
        metadata={"axes": "ZYX", **sizes, "PhysicalSizeZ": 0.02, "PhysicalSizeZUnit": "mm"},
    )
    scan = open_scan(path)
    assert scan.voxel_size.zyx == pytest.approx((20, 15, 14))
    assert scan.unit == "um"
    assert_same(scan, volume)


def test_resolution_tags_in_centimetres(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "scan.tif"
    tifffile.imwrite(
        path, volume, resolution=(10_000 / 14, 10_000 / 14), resolutionunit="CENTIMETER", metadata=None
    )
    with pytest.warns(ScanWarning, match="slice spacing"):
        scan = open_scan(path)
    assert scan.voxel_size.zyx == pytest.approx((14, 14, 14), rel=1e-6)
    assert scan.unit == "um"


@pytest.mark.parametrize(
    ("dpi", "unit"), [(72, "INCH"), (96, "INCH"), (300, "INCH"), (1, "NONE"), (1, "CENTIMETER")]
)
def test_a_cameras_default_resolution_is_no_voxel_size(
    tmp_path: Path, volume: np.ndarray, dpi: int, unit: str
) -> None:
    path = tmp_path / "scan.tif"
    tifffile.imwrite(path, volume, resolution=(dpi, dpi), resolutionunit=unit, metadata=None)
    with pytest.raises(UnitError, match="voxel_size"):
        open_scan(path)


def test_the_callers_voxel_size_overrides_the_file(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "scan.tif"
    tifffile.imwrite(
        path, volume, imagej=True, resolution=(1 / 14, 1 / 14), metadata={"spacing": 14.0, "unit": "um"}
    )
    assert open_scan(path, "3 x 2 x 1 mm").voxel_size.zyx == (3, 2, 1)
    assert open_scan(path, 50, unit="nm").unit == "nm"
    with pytest.warns(ScanWarning, match="5 nm.*check the unit"):
        assert open_scan(path, 5, unit="nm").unit == "nm"


def test_colour_and_time_series_are_refused(tmp_path: Path, volume: np.ndarray) -> None:
    colour, series = tmp_path / "colour.tif", tmp_path / "series.tif"
    tifffile.imwrite(colour, np.arange(4 * 6 * 6 * 3).astype(np.uint8).reshape(4, 6, 6, 3), photometric="rgb")
    tifffile.imwrite(series, np.zeros((2, 4, 6, 6), np.uint16), imagej=True, metadata={"axes": "TZYX"})
    with pytest.raises(ScanError, match=r"colour\.tif.*colour"):
        open_scan(colour, "14 um")
    with pytest.raises(ScanError, match=r"series\.tif.*time step"):
        open_scan(series, "14 um")


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
@pytest.mark.parametrize(
    ("style", "compression"),
    [(style, compression) for style in ("plain", "shaped", "pages") for compression in (None, "zlib")]
    + [("imagej", None)],
)
def test_truncated_tiff(
    tmp_path: Path, rng: np.random.Generator, share: float, style: str, compression: str | None
) -> None:
    volume = rng.integers(0, 60_000, (8, 40, 40)).astype(np.uint16)
    path = tmp_path / "scan.tif"
    if style == "pages":
        with tifffile.TiffWriter(path) as writer:
            for image in volume:
                writer.write(image, contiguous=False, compression=compression)
    elif style == "imagej":
        tifffile.imwrite(path, volume, imagej=True)
    else:
        tifffile.imwrite(path, volume, compression=compression, metadata=None if style == "plain" else {})
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(ScanError, match=r"scan\.tif.*(cut off|damaged)"):
        open_scan(path, "14 um")


@pytest.mark.parametrize("content", [b"", b"II*\0", b"this is no image at all"])
def test_empty_or_foreign_tiff(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "scan.tif"
    path.write_bytes(content)
    with pytest.raises(ScanError, match=r"scan\.tif"):
        open_scan(path, "14 um")


def test_pages_of_different_sizes(tmp_path: Path) -> None:
    path = tmp_path / "scan.tif"
    with tifffile.TiffWriter(path) as writer:
        writer.write(np.zeros((6, 6), np.uint16))
        writer.write(np.zeros((6, 7), np.uint16))
    with pytest.raises(ScanError, match=r"scan\.tif.*different sizes"):
        open_scan(path, "14 um")


# Folders of slices -----------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["tif", "png"])
def test_slices_in_natural_order(tmp_path: Path, rng: np.random.Generator, ending: str) -> None:
    volume = rng.integers(0, 60_000, (12, 6, 9)).astype(np.uint16)
    for index, image in enumerate(volume):
        iio.imwrite(tmp_path / f"slice{index}.{ending}", image)  # slice10 sorts before slice2 as text
    (tmp_path / "notes.txt").write_text("not a slice")
    scan = open_scan(tmp_path, "14 um")
    assert not isinstance(scan.voxels, np.ndarray)
    assert_same(scan, volume)
    np.testing.assert_array_equal(scan.voxels[-1], volume[-1])
    np.testing.assert_array_equal(scan.voxels[::-3, 1:3], volume[::-3, 1:3])
    np.testing.assert_array_equal(scan.voxels[..., 4], volume[..., 4])
    with pytest.raises(IndexError):
        scan.voxels[12]


def test_slices_of_different_sizes(tmp_path: Path) -> None:
    iio.imwrite(tmp_path / "a.png", np.zeros((6, 6), np.uint8))
    iio.imwrite(tmp_path / "b.png", np.zeros((6, 7), np.uint8))
    with pytest.raises(ScanError, match=r"b\.png.*6 x 7"):
        open_scan(tmp_path, "14 um")


def test_folders_that_are_no_stack(tmp_path: Path) -> None:
    with pytest.raises(ScanError, match="no slices"):
        open_scan(tmp_path, "14 um")
    iio.imwrite(tmp_path / "a.png", np.arange(108).astype(np.uint8).reshape(6, 6, 3))
    with pytest.raises(ScanError, match=r"a\.png.*colour"):
        open_scan(tmp_path, "14 um")
    iio.imwrite(tmp_path / "b.tif", np.zeros((6, 6), np.uint8))
    with pytest.raises(ScanError, match="both TIFF and PNG"):
        open_scan(tmp_path, "14 um")


def test_a_broken_slice_is_named(tmp_path: Path) -> None:
    iio.imwrite(tmp_path / "a.png", np.zeros((6, 6), np.uint8))
    (tmp_path / "b.png").write_bytes(b"no image")
    with pytest.raises(ScanError, match=r"b\.png"):
        open_scan(tmp_path, "14 um")


# RAW and NPY -----------------------------------------------------------------------------------


@pytest.mark.parametrize("big_endian", [False, True])
def test_raw_with_header(tmp_path: Path, volume: np.ndarray, big_endian: bool) -> None:
    path = tmp_path / "scan.raw"
    path.write_bytes(b"x" * 13 + volume.astype(">u2" if big_endian else "<u2").tobytes())
    scan = open_scan(
        path, "14 um", shape=volume.shape, dtype="uint16", header_bytes=13, big_endian=big_endian
    )
    assert scan.is_memory_mapped
    assert_same(scan, volume)


@pytest.mark.parametrize(("surplus", "says"), [(-1, "needs"), (1, "more than")])
def test_raw_of_the_wrong_length(tmp_path: Path, volume: np.ndarray, surplus: int, says: str) -> None:
    path = tmp_path / "scan.raw"
    path.write_bytes((volume.tobytes() + b"x")[: volume.nbytes + surplus])
    with pytest.raises(ScanError, match=rf"scan\.raw.*{says}"):
        open_scan(path, "14 um", shape=volume.shape, dtype="uint16")


def test_raw_must_be_described(tmp_path: Path) -> None:
    path = tmp_path / "scan.raw"
    path.write_bytes(bytes(8))
    with pytest.raises(ScanError, match="shape="):
        open_scan(path, "14 um")
    with pytest.raises(ScanError, match="not a voxel type"):
        open_scan(path, "14 um", shape=(2, 2, 2), dtype="grey")
    with pytest.raises(ScanError, match="impossible"):
        open_scan(path, "14 um", shape=(2, -2, 2), dtype="uint8")
    with pytest.raises(UnitError, match=r"scan\.raw"):
        open_scan(path, shape=(2, 2, 2), dtype="uint8")


def test_npy_is_mapped_and_never_unpickled(tmp_path: Path, volume: np.ndarray) -> None:
    path, pickled, cut = tmp_path / "scan.npy", tmp_path / "pickled.npy", tmp_path / "cut.npy"
    np.save(path, volume)
    scan = open_scan(path, "14 um")
    assert scan.is_memory_mapped
    assert_same(scan, volume)
    np.save(pickled, np.array([[[{}]]], dtype=object), allow_pickle=True)
    cut.write_bytes(path.read_bytes()[:-10])
    for bad in (pickled, cut):
        with pytest.raises(ScanError, match=bad.name):
            open_scan(bad, "14 um")
    np.save(path, volume[0])
    with pytest.raises(ScanError, match="three"):
        open_scan(path, "14 um")


# NRRD and MetaImage ----------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
def test_nrrd_with_directions_and_units(tmp_path: Path, volume: np.ndarray, encoding: str) -> None:
    path = tmp_path / "scan.nrrd"
    header = {
        "space dimension": 3,
        "space directions": np.diag([14.0, 15.0, 20.0]),
        "space units": ["um", "um", "um"],
        "space origin": np.array([100.0, 200.0, 300.0]),
        "encoding": encoding,
    }
    nrrd.write(str(path), volume, header, index_order="C")
    scan = open_scan(path)
    assert scan.voxel_size.zyx == pytest.approx((20, 15, 14))
    assert scan.unit == "um"
    assert scan.origin == pytest.approx((100, 200, 300))
    assert scan.is_memory_mapped == (encoding == "raw")
    assert_same(scan, volume)


def test_nrrd_without_unit_asks_for_it(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "scan.nrrd"
    nrrd.write(str(path), volume, {"spacings": [14.0, 15.0, 20.0]}, index_order="C")
    with pytest.raises(UnitError, match="without a unit"):
        open_scan(path)
    assert open_scan(path, unit="um").voxel_size.zyx == pytest.approx((20, 15, 14))


def test_nrrd_axis_that_runs_backwards_is_flipped(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "scan.nrrd"
    header = {
        "space dimension": 3, "space directions": np.diag([-2.0, 2.0, 2.0]), "space units": ["mm"] * 3,
        "space origin": np.array([20.0, 0.0, 0.0]),
    }  # fmt: skip
    nrrd.write(str(path), volume, header, index_order="C")
    scan = open_scan(path)
    assert_same(scan, volume[:, :, ::-1])
    assert scan.origin == pytest.approx((0, 0, 0))  # 11 voxels: 20 - 10 * 2


def test_truncated_nrrd(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "scan.nrrd"
    for encoding in ("raw", "gzip"):
        nrrd.write(str(path), volume, {"encoding": encoding}, index_order="C")
        path.write_bytes(path.read_bytes()[:-100])
        with pytest.raises(ScanError, match=r"scan\.nrrd"):
            open_scan(path, "14 um")


@pytest.mark.parametrize("name", ["scan.mha", "scan.mhd"])
@pytest.mark.parametrize("compressed", [False, True])
def test_meta_image(tmp_path: Path, volume: np.ndarray, name: str, compressed: bool) -> None:
    image = sitk.GetImageFromArray(volume)
    image.SetSpacing((0.014, 0.015, 0.02))
    image.SetOrigin((1.0, 2.0, 3.0))
    path = tmp_path / name
    sitk.WriteImage(image, str(path), compressed)
    scan = open_scan(path)
    assert scan.voxel_size.zyx == pytest.approx((0.02, 0.015, 0.014))
    assert scan.unit == "mm"
    assert scan.origin == pytest.approx((1, 2, 3))
    assert scan.is_memory_mapped != compressed
    assert_same(scan, volume)
    assert open_scan(path, unit="um").unit == "um"


def test_meta_image_without_spacing_or_data(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "scan.mhd"
    path.write_text(
        "ObjectType = Image\nNDims = 3\nDimSize = 11 7 5\nElementType = MET_USHORT\n"
        "ElementDataFile = scan.raw\n"
    )
    with pytest.raises(ScanError, match=r"scan\.mhd.*missing"):
        open_scan(path, "14 um")
    (tmp_path / "scan.raw").write_bytes(volume.astype("<u2").tobytes())
    assert_same(open_scan(path, "14 um"), volume)
    with pytest.raises(UnitError):
        open_scan(path)
    (tmp_path / "scan.raw").write_bytes(volume.tobytes()[:-1])
    with pytest.raises(ScanError, match="cut off"):
        open_scan(path, "14 um")


# All families ----------------------------------------------------------------------------------


def test_missing_and_unknown_files(tmp_path: Path) -> None:
    with pytest.raises(ScanError, match="does not exist"):
        open_scan(tmp_path / "nothing.tif", "14 um")
    unknown = tmp_path / "scan.xyz"
    unknown.write_bytes(bytes(8))
    with pytest.raises(ScanError, match=r"scan\.xyz"):
        open_scan(unknown, "14 um")


@pytest.mark.parametrize("bad", ["-14 um", "0 um", "14", "14 miles"])
def test_impossible_voxel_size(tmp_path: Path, volume: np.ndarray, bad: str) -> None:
    np.save(tmp_path / "scan.npy", volume)
    with pytest.raises(UnitError):
        open_scan(tmp_path / "scan.npy", bad)


def test_the_digest_knows_the_voxels_not_the_format(tmp_path: Path, volume: np.ndarray) -> None:
    import hashlib

    np.save(tmp_path / "scan.npy", volume)
    with tifffile.TiffWriter(tmp_path / "scan.tif", byteorder=">") as writer:
        writer.write(volume)
    folder = tmp_path / "slices"
    folder.mkdir()
    for index, image in enumerate(volume):
        iio.imwrite(folder / f"{index}.png", image)
    expected = hashlib.sha256(volume.astype("<u2").tobytes()).hexdigest()
    for source in ("scan.npy", "scan.tif", "slices"):
        assert voxel_digest(open_scan(tmp_path / source, "14 um")) == expected
    changed = volume.copy()
    changed[4, 6, 10] ^= 1
    np.save(tmp_path / "scan.npy", changed)
    assert voxel_digest(open_scan(tmp_path / "scan.npy", "14 um")) != expected
