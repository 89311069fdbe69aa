"""Voxel sizes are read in every encoding and unit that programs write, or asked for by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nrrd
import numpy as np
import pytest
import SimpleITK as sitk
import tifffile

from mbstudio.core.errors import ScanError, ScanWarning, UnitError
from mbstudio.core.scan import open_scan


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 250, (5, 7, 11)).astype(np.uint8)


def write_nrrd(path: Path, volume: np.ndarray, units: bytes, edge: float = 10) -> None:
    steps = f"({edge},0,0) (0,{edge},0) (0,0,{edge})"
    path.write_bytes(
        b"NRRD0004\n# a comment\ntype: uint8\ndimension: 3\nspace dimension: 3\nsizes: 11 7 5\n"
        + f"space directions: {steps}\nspace units: ".encode()
        + units
        + b"\nencoding: raw\n\n"
        + volume.tobytes()
    )


@pytest.mark.parametrize(
    "word",
    [b"\xc2\xb5m", b"\xce\xbcm", b"\xb5m", "Âµm".encode(),
     b"um", b"microns", b"micron", b"Micrometer", b"micrometres",
     b"\\u00b5m", b"\xe6m", b"UM"],
)  # fmt: skip
def test_nrrd_in_every_micro(tmp_path: Path, volume: np.ndarray, word: bytes) -> None:
    quoted = b" ".join([b'"' + word.replace(b"\\", b"\\\\") + b'"'] * 3)
    write_nrrd(tmp_path / "s.nrrd", volume, quoted)
    scan = open_scan(tmp_path / "s.nrrd")
    assert (scan.unit, scan.voxel_size.x) == ("um", 10)
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)


@pytest.mark.parametrize("word", ["furlong", "?m", "Mm"])
def test_unknown_units_are_named(tmp_path: Path, volume: np.ndarray, word: str) -> None:
    write_nrrd(tmp_path / "s.nrrd", volume, f'"{word}" "{word}" "{word}"'.encode())
    with pytest.raises(UnitError, match=rf"s\.nrrd.*'{word}'".replace("?", r"\?")):
        open_scan(tmp_path / "s.nrrd")
    assert open_scan(tmp_path / "s.nrrd", "10 um").unit == "um"
    (tmp_path / "s.mhd").write_text(
        "ObjectType = Image\nNDims = 3\nDimSize = 11 7 5\nElementType = MET_UCHAR\n"
        f"ElementSpacing = 1 1 1\nDistanceUnits = {word}\nElementDataFile = s.raw\n"
    )
    volume.tofile(tmp_path / "s.raw")
    with pytest.raises(UnitError, match=rf"s\.mhd.*'{word}'".replace("?", r"\?")):
        open_scan(tmp_path / "s.mhd")


def test_nrrd_axes_of_different_units(tmp_path: Path, volume: np.ndarray) -> None:
    path = tmp_path / "s.nrrd"
    nrrd.write(str(path), volume, {"spacings": [10, 10, 0.02], "units": ["um", "um", "mm"]}, index_order="C")
    assert open_scan(path).voxel_size.to("um").zyx == pytest.approx((20, 10, 10))


@pytest.mark.parametrize(
    ("facts", "zyx"),
    [({"unit": "mm", "spacing": 0.02, "yunit": "um", "zunit": "mm"}, None),
     ({"unit": "\\u00B5m", "spacing": 20}, (20, 10, 10)),
     ({"unit": "um", "spacing": 2000, "zunit": "nm"}, (2, 10, 10)),
     ({"unit": "um", "spacing": -20.0}, (20, 10, 10)),
     ({"unit": "nm", "spacing": 20.0}, (0.02, 0.01, 0.01))],
)  # fmt: skip
def test_imagej_units(
    tmp_path: Path, volume: np.ndarray, facts: dict[str, Any], zyx: tuple[float, ...] | None
) -> None:
    tifffile.imwrite(
        tmp_path / "s.tif", volume, imagej=True, resolution=(0.1, 0.1), metadata={"axes": "ZYX", **facts}
    )
    size = open_scan(tmp_path / "s.tif").voxel_size.to("um")
    assert size.zyx == pytest.approx(zyx or (20, 10, 10_000))


def test_imagej_inches(tmp_path: Path, volume: np.ndarray) -> None:
    tifffile.imwrite(tmp_path / "s.tif", volume, imagej=True, resolution=(2540, 2540),
                     metadata={"axes": "ZYX", "unit": "inch", "spacing": 1 / 2540})  # fmt: skip
    assert open_scan(tmp_path / "s.tif").voxel_size.to("um").zyx == pytest.approx((10, 10, 10))
    tifffile.imwrite(tmp_path / "d.tif", volume, imagej=True, resolution=(72, 72),
                     metadata={"axes": "ZYX", "unit": "inch", "spacing": 1.0})  # fmt: skip
    with pytest.raises(UnitError, match="voxel size"):
        open_scan(tmp_path / "d.tif")


def test_a_slice_distance_that_nobody_has_set_is_asked_about(tmp_path: Path, volume: np.ndarray) -> None:
    description = "ImageJ=1.53t\nimages=5\nslices=5\nunit=um\n"
    options = {"resolution": (0.1, 0.1), "resolutionunit": "NONE"}
    tifffile.imwrite(tmp_path / "s.tif", volume, description=description, metadata=None, **options)
    with pytest.raises(UnitError, match="slices 1 um apart"):
        open_scan(tmp_path / "s.tif")
    tifffile.imwrite(
        tmp_path / "t.tif", volume, imagej=True, resolution=(0.1, 0.1), metadata={"axes": "ZYX", "unit": "um"}
    )
    with pytest.warns(ScanWarning, match="not its slice spacing"):
        assert open_scan(tmp_path / "t.tif").voxel_size.zyx == pytest.approx((10, 10, 10))


def test_ome_in_nanometres_and_unknown_units(tmp_path: Path, volume: np.ndarray) -> None:
    sizes = {f"PhysicalSize{axis}": 5000.0 for axis in "XYZ"}
    units = {f"PhysicalSize{axis}Unit": "nm" for axis in "XYZ"}
    tifffile.imwrite(tmp_path / "s.ome.tif", volume, ome=True, metadata={"axes": "ZYX", **sizes, **units})
    assert open_scan(tmp_path / "s.ome.tif").voxel_size.to("um").zyx == pytest.approx((5, 5, 5))
    content = (tmp_path / "s.ome.tif").read_bytes()
    (tmp_path / "u.ome.tif").write_bytes(content.replace(b'Unit="nm"', b'Unit="pt"'))
    with pytest.raises(UnitError, match=r"u\.ome\.tif.*'pt'"):
        open_scan(tmp_path / "u.ome.tif")


@pytest.mark.parametrize("edge", [10, 1, 0.5e-5, 14.2])
def test_meta_images_plainly_not_in_millimetres_are_asked_about(
    tmp_path: Path, volume: np.ndarray, edge: float
) -> None:
    image = sitk.GetImageFromArray(volume)
    image.SetSpacing((edge, edge, edge))
    sitk.WriteImage(image, str(tmp_path / "s.mha"))
    with pytest.raises(UnitError, match=r"s\.mha.*--voxel-size"):
        open_scan(tmp_path / "s.mha")
    assert open_scan(tmp_path / "s.mha", "14 um").voxel_size.x == 14


@pytest.mark.parametrize("edge", [b"20", b"1e-6"])
def test_sizes_that_no_scan_has_are_questioned(tmp_path: Path, volume: np.ndarray, edge: bytes) -> None:
    write_nrrd(tmp_path / "s.nrrd", volume, b'"mm" "mm" "mm"', float(edge))
    with pytest.raises(UnitError, match="outside the range of scans"):
        open_scan(tmp_path / "s.nrrd")
    with pytest.warns(ScanWarning, match="check the unit"):
        open_scan(tmp_path / "s.nrrd", "20 mm")


# Headers -----------------------------------------------------------------------------------------------


def write_mhd(folder: Path, *lines: str) -> Path:
    path = folder / "s.mhd"
    path.write_text("\n".join(lines) + "\n")
    return path


HEAD = ("ObjectType = Image", "NDims = 3", "ElementType = MET_UCHAR", "DimSize = 11 7 5")


@pytest.mark.parametrize(
    ("lines", "front", "behind"),
    [((*HEAD, "", "Comment = made by hand", "HeaderSize = 100", "ElementDataFile = s.raw"), 100, 0),
     ((*HEAD, "HeaderSize = -1", "ElementDataFile = ./s.raw"), 37, 0),
     (("\ufeffObjectType : Image", *HEAD[1:], "# note", "ElementDataFile = s.raw", "", "Other = 1"), 0, 9)],
)  # fmt: skip
def test_headers_of_meta_images(
    tmp_path: Path, volume: np.ndarray, lines: tuple[str, ...], front: int, behind: int
) -> None:
    path = tmp_path / "s.mhd"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    (tmp_path / "s.raw").write_bytes(bytes(front) + volume.tobytes() + bytes(behind))
    np.testing.assert_array_equal(np.asarray(open_scan(path, "10 um").voxels), volume)


@pytest.mark.parametrize("name", ["/etc/passwd", "../s.raw", "sub/s.raw", "C:\\s.raw"])
def test_no_other_folder_is_read(tmp_path: Path, volume: np.ndarray, name: str) -> None:
    folder = tmp_path / "in"
    (folder / "sub").mkdir(parents=True)
    for place in (tmp_path / "s.raw", folder / "sub" / "s.raw"):
        volume.tofile(place)
    path = write_mhd(folder, *HEAD, f"ElementDataFile = {name}")
    with pytest.raises(ScanError, match="outside its folder"):
        open_scan(path, "10 um")
    (folder / "s.nhdr").write_text(
        f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 11 7 5\nencoding: raw\ndata file: {name}\n\n"
    )
    with pytest.raises(ScanError, match="outside its folder"):
        open_scan(folder / "s.nhdr", "10 um")


def test_sizes_are_checked_before_memory_is_taken(tmp_path: Path) -> None:
    path = write_mhd(tmp_path, *HEAD[:3], "DimSize = 900000 900000 900000", "CompressedData = True",
                     "ElementDataFile = s.raw")  # fmt: skip
    (tmp_path / "s.raw").write_bytes(bytes(100))
    with pytest.raises(ScanError, match="cut off"):
        open_scan(path, "10 um")
    (tmp_path / "s.nrrd").write_bytes(
        b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 900000 900000 900000\nencoding: gzip\n\n" + bytes(50)
    )
    with pytest.raises(ScanError, match="cut off"):
        open_scan(tmp_path / "s.nrrd", "10 um")


def test_a_set_of_ome_files_opens_no_other(tmp_path: Path, volume: np.ndarray) -> None:
    tifffile.imwrite(tmp_path / "a.ome.tif", volume, ome=True, metadata={"axes": "ZYX"})
    content = tifffile.tiffcomment(tmp_path / "a.ome.tif")
    other = content.replace('FirstZ="0"', "").replace(
        "<TiffData", '<TiffData FirstZ="0"', 1
    ).replace(">urn:", ' FileName="b.ome.tif">urn:', 1)  # fmt: skip
    two = other.replace('SizeZ="5"', 'SizeZ="10"')
    tifffile.tiffcomment(tmp_path / "a.ome.tif", two.encode())
    np.save(tmp_path / "b.npy", volume)
    (tmp_path / "b.npy").rename(tmp_path / "b.ome.tif")
    with pytest.raises(ScanError, match=r"a\.ome\.tif"):
        open_scan(tmp_path / "a.ome.tif", "10 um")
