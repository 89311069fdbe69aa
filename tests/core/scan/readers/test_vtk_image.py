"""VTK images in every encoding that VTK writes, and files that would end VTK's own reader."""

from __future__ import annotations

import base64
import os
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

from mbstudio.core.errors import GrainWarning, ScanError, UnitError
from mbstudio.core.grains import load_labels
from mbstudio.core.project import Project
from mbstudio.core.scan import Scan, open_scan
from tests.fuzzing.harness import cases_of_folder, problems_of

MODES = ("Ascii", "Binary", "Appended", "Raw")
PACKERS = ("None", "ZLib", "LZ4", "LZMA")


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 60_000, (5, 7, 11)).astype(np.uint16)


def write(
    path: Path,
    points: dict[str, np.ndarray],
    cells: dict[str, np.ndarray] | None = None,
    mode: str = "Raw",
    packer: str = "ZLib",
    edges: tuple[float, float, float] = (0.014, 0.015, 0.02),
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    direction: Any = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    first: tuple[int, int, int] = (0, 0, 0),
    wide: bool = False,
    block: int | None = None,
) -> Path:
    """Write arrays [z, y, x] by VTK; `edges`, `origin` and `first` along x, y, z."""
    image = vtkImageData()
    shape = (
        next(iter(points.values())).shape[:3]
        if points
        else tuple(n + 1 for n in next(iter(cells.values())).shape[:3])
    )
    ends = [part for axis in range(3) for part in (first[axis], first[axis] + shape[2 - axis] - 1)]
    image.SetExtent(*ends)
    image.SetSpacing(*edges)
    image.SetOrigin(*origin)
    image.SetDirectionMatrix(*np.ravel(direction))
    for data, arrays in ((image.GetPointData(), points), (image.GetCellData(), cells or {})):
        for name, array in arrays.items():
            flat = array.reshape(-1, array.shape[3]) if array.ndim == 4 else array.ravel()
            one = numpy_to_vtk(np.ascontiguousarray(flat), deep=True)
            one.SetName(name)
            data.AddArray(one)
    writer = vtkXMLImageDataWriter()
    writer.SetInputData(image)
    writer.SetFileName(str(path))
    getattr(writer, f"SetDataModeTo{'Appended' if mode == 'Raw' else mode}")()
    writer.SetEncodeAppendedData(mode == "Appended")
    getattr(writer, f"SetCompressorTypeTo{packer}")()
    if wide:
        writer.SetHeaderTypeToUInt64()
    if block:
        writer.SetBlockSize(block)
    assert writer.Write()
    return path


def assert_same(scan: Scan, volume: np.ndarray) -> None:
    assert scan.shape == volume.shape
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("packer", PACKERS)
@pytest.mark.parametrize("wide", [False, True])
def test_every_encoding(tmp_path: Path, volume: np.ndarray, mode: str, packer: str, wide: bool) -> None:
    """With several blocks an array, and the last one shorter."""
    path = write(tmp_path / "s.vti", {"grey": volume}, mode=mode, packer=packer, wide=wide, block=256)
    scan = open_scan(path, unit="mm")
    assert_same(scan, volume)
    assert scan.voxel_size.zyx == (0.02, 0.015, 0.014)
    assert scan.is_memory_mapped == (mode == "Raw" and packer == "None")


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8"])
@pytest.mark.parametrize("mode", ["Ascii", "Binary"])
def test_types(tmp_path: Path, volume: np.ndarray, kind: str, mode: str) -> None:
    data = (volume % 120).astype(kind)
    data[0, 0, 0] = np.iinfo(kind).max if kind[0] != "f" else 0.125
    scan = open_scan(write(tmp_path / "s.vti", {"grey": data}, mode=mode), "10 um")
    assert scan.voxels.dtype == np.dtype(kind)
    assert_same(scan, data)


def by_hand(path: Path, body: str, beside: str = "", extent: str = "0 10 0 6 0 4", **attributes: str) -> Path:
    facts = {"type": "ImageData", "version": "0.1", "byte_order": "LittleEndian", **attributes}
    head = " ".join(f'{name}="{value}"' for name, value in facts.items())
    path.write_text(
        f'<?xml version="1.0"?>\n<VTKFile {head}>\n<ImageData WholeExtent="{extent}" '
        f'Origin="0 0 0" Spacing="1 1 1">'
        f'<Piece Extent="{extent}"><PointData>\n{body}\n</PointData></Piece></ImageData>{beside}</VTKFile>'
    )
    return path


def test_what_others_write(tmp_path: Path, volume: np.ndarray) -> None:
    """Length and data encoded as one, big-endian, broken into lines, or with notes within the array."""
    big = volume.astype(">u2").tobytes()
    one = base64.b64encode(len(big).to_bytes(4, "big") + big).decode()
    lines = "\n".join(re.findall(".{1,76}", one))
    head = '<DataArray type="UInt16" Name="a &gt; b" NumberOfComponents="1" format="binary">'
    note = '<InformationKey name="UNITS" location="vtkDataArray">none</InformationKey>'
    path = by_hand(tmp_path / "s.vti", f"{head}{note}\n{lines}\n</DataArray>", byte_order="BigEndian")
    assert_same(open_scan(path, "10 um"), volume)
    blocks = np.array([1, volume.nbytes, 0, 0], "<u4")
    packed = zlib.compress(volume.tobytes())
    blocks[3] = len(packed)
    text = (base64.b64encode(blocks.tobytes()) + base64.b64encode(packed)).decode()
    appended = f'<AppendedData encoding="base64">\n   _{text}\n</AppendedData>'
    array = '<DataArray type="UInt16" Name="a" format="appended" offset="0"/>'
    path = by_hand(tmp_path / "t.vti", array, appended, compressor="vtkZLibDataCompressor")
    assert_same(open_scan(path, "10 um"), volume)


# Which array, and its place -----------------------------------------------------------------------------


def test_several_arrays_are_named(tmp_path: Path, volume: np.ndarray) -> None:
    cells = (volume + 1)[1:, 1:, 1:]
    path = write(
        tmp_path / "s.vti", {"grey": volume, "both": volume + 2}, {"labels": cells, "both": cells + 2}
    )
    with pytest.raises(ScanError, match=r"4 arrays .*: grey \(points\), .*labels \(cells\).*'s\.vti:grey'"):
        open_scan(path, "10 um")
    assert_same(open_scan(f"{path}:grey", "10 um"), volume)
    assert_same(open_scan(f"{path}:labels", "10 um"), cells)
    assert_same(open_scan(f"{path}:CellData/both", "10 um"), cells + 2)
    with pytest.raises(ScanError, match="of points and one of cells"):
        open_scan(f"{path}:both", "10 um")
    with pytest.raises(ScanError, match="no array 'none': grey"):
        open_scan(f"{path}:none", "10 um")
    scan = open_scan(f"{path}:labels", "10 um")
    Project.new(scan).save(tmp_path / "p.mbs")
    again = Project.open(tmp_path / "p.mbs").scan
    assert again is not None
    assert_same(again, cells)


def test_the_unit_is_asked_for(tmp_path: Path, volume: np.ndarray) -> None:
    path = write(tmp_path / "s.vti", {"grey": volume})
    with pytest.raises(
        UnitError, match=r"s\.vti gives a voxel size of 0\.02 x 0\.015 x 0\.014 .*without a unit"
    ):
        open_scan(path)
    assert open_scan(path, unit="mm").voxel_size.to("um").x == pytest.approx(14)
    assert open_scan(path, "14 um").voxel_size.x == 14
    zero = write(tmp_path / "z.vti", {"grey": volume}, edges=(0, 1, 1))
    with pytest.raises(UnitError, match="impossible voxel spacing"):
        open_scan(zero)


def test_origin_and_extent(tmp_path: Path, volume: np.ndarray) -> None:
    cells = volume[:4, :6, :10]
    path = write(
        tmp_path / "s.vti",
        {"grey": volume},
        {"labels": cells},
        edges=(2, 3, 4),
        origin=(1, 2, 3),
        first=(10, 0, -1),
    )
    assert open_scan(f"{path}:grey", unit="um").origin == (21, 2, -1)
    assert open_scan(f"{path}:labels", unit="um").origin == (22, 3.5, 1)


@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, 1), (1, -1, -1), (-1, -1, 1)])
def test_directions_as_in_meta_image(tmp_path: Path, volume: np.ndarray, signs: tuple[int, int, int]) -> None:
    direction = np.diag(np.array(signs, float))
    write(tmp_path / "s.vti", {"grey": volume}, origin=(1, 2, 3), direction=direction)
    image = sitk.GetImageFromArray(volume)
    image.SetSpacing((0.014, 0.015, 0.02))
    image.SetOrigin((1, 2, 3))
    image.SetDirection(direction.ravel())
    sitk.WriteImage(image, tmp_path / "s.mha")
    mine, its = open_scan(tmp_path / "s.vti", unit="mm"), open_scan(tmp_path / "s.mha")
    np.testing.assert_array_equal(np.asarray(mine.voxels), np.asarray(its.voxels))
    assert mine.origin == pytest.approx(its.origin)
    assert mine.grid is not None
    assert its.grid is not None
    np.testing.assert_allclose(mine.grid.steps, its.grid.steps)


def test_turned_axes_are_steps_of_columns(tmp_path: Path, volume: np.ndarray) -> None:
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    write(tmp_path / "s.vti", {"grey": volume}, direction=turn)
    grid = open_scan(tmp_path / "s.vti", unit="mm").grid
    assert grid is not None
    image = vtkImageData()
    image.SetSpacing(0.014, 0.015, 0.02)
    image.SetDirectionMatrix(*turn.ravel())
    for axis in range(3):
        place = [0.0, 0.0, 0.0]
        image.TransformIndexToPhysicalPoint(*np.eye(3, dtype=int)[axis].tolist(), place)
        np.testing.assert_allclose(grid.steps[axis], place)


def test_grey_colours_and_vectors(tmp_path: Path, volume: np.ndarray) -> None:
    grey = (volume % 256).astype(np.uint8)
    assert_same(open_scan(write(tmp_path / "g.vti", {"rgb": np.stack([grey] * 3, -1)}), "10 um"), grey)
    path = write(tmp_path / "v.vti", {"v": np.stack([grey, grey + 1, grey], -1).astype("f4")})
    with pytest.raises(ScanError, match="colour images"):
        open_scan(path, "10 um")
    path = write(tmp_path / "t.vti", {"t": np.stack([grey] * 9, -1)})
    with pytest.raises(ScanError, match="contains 9 values per pixel"):
        open_scan(path, "10 um")


def test_labels_on_an_image(tmp_path: Path) -> None:
    scan = np.full((12, 14, 16), 20, np.uint8)
    labels = np.zeros(scan.shape, np.int32)
    labels[2:6, 3:7, 4:8], labels[7:10, 8:12, 9:14] = 1, 2
    scan[labels > 0] = 200
    path = write(tmp_path / "s.vti", {}, {"grey": scan, "labels": labels}, edges=(0.02, 0.02, 0.02))
    grains = load_labels(f"{path}:labels", open_scan(f"{path}:grey", unit="mm"))
    np.testing.assert_array_equal(grains.labels, labels)
    crop = write(
        tmp_path / "l.vti", {"l": labels[1:, 2:, 3:]}, edges=(0.02, 0.02, 0.02), origin=(0.07, 0.05, 0.03)
    )
    with pytest.warns(GrainWarning, match=r"from voxel \(1, 2, 3\)"):
        grains = load_labels(crop, open_scan(f"{path}:grey", unit="mm"))
    np.testing.assert_array_equal(grains.labels, labels)


# What is refused ----------------------------------------------------------------------------------------


def test_what_is_not_damaged_is_not_said_to_be(tmp_path: Path, volume: np.ndarray) -> None:
    array = '<DataArray type="UInt16" Name="a" format="ascii">1</DataArray>'
    cases = [
        (by_hand(tmp_path / "poly.vti", array, type="PolyData"), "no image but PolyData"),
        (by_hand(tmp_path / "parts.vti", array, type="PImageData"), "pieces in other files"),
        (by_hand(tmp_path / "none.vti", ""), "no array of points or cells"),
        (by_hand(tmp_path / "bits.vti", array.replace("UInt16", "Bit")), "values of type Bit"),
        (by_hand(tmp_path / "extent.vti", array, extent="0 x 0 6 0 4"), "where 6 numbers should be"),
        (by_hand(tmp_path / "empty.vti", array, extent="0 -1 0 6 0 4"), "contains no voxels"),
        (by_hand(tmp_path / "format.vti", array.replace("ascii", "runes")), "the unknown format 'runes'"),
    ]
    two = (tmp_path / "empty.vti").read_text().replace("0 -1 0", "0 10 0")
    (tmp_path / "two.vti").write_text(two.replace("</Piece>", '</Piece><Piece Extent="0 10 0 6 0 4"/>'))
    (tmp_path / "part.vti").write_text(two.replace('Piece Extent="0 10', 'Piece Extent="2 10'))
    (tmp_path / "text.vti").write_text("nothing")
    doctype = '<?xml version="1.0"?>\n<!DOCTYPE a [<!ENTITY b "c">]>\n'
    (tmp_path / "entity.vti").write_text(two.replace('<?xml version="1.0"?>\n', doctype))
    cases += [
        (tmp_path / "two.vti", "in 2 pieces"),
        (tmp_path / "part.vti", r"holds a piece \(2 10 0 6 0 4\)"),
        (tmp_path / "text.vti", "not an XML file of VTK"),
        (tmp_path / "entity.vti", "declares a document type"),
    ]
    for path, told in cases:
        with pytest.raises(ScanError, match=told) as caught:
            open_scan(path, "10 um")
        assert "damaged" not in str(caught.value).replace(str(tmp_path), "")


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("packer", ["None", "ZLib"])
def test_what_is_cut_off(tmp_path: Path, volume: np.ndarray, mode: str, packer: str) -> None:
    whole = write(tmp_path / "w.vti", {"grey": volume}, mode=mode, packer=packer).read_bytes()
    for number, keep in enumerate((len(whole) - 300, 500)):
        path = tmp_path / f"{number}.vti"
        path.write_bytes(whole[:keep])
        with pytest.raises(ScanError, match=r"damaged or cut off|copy or export it again"):
            open_scan(path, "10 um")


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("packer", PACKERS)
def test_claims_are_checked_before_memory_is_taken(
    tmp_path: Path, volume: np.ndarray, mode: str, packer: str
) -> None:
    path = write(tmp_path / "s.vti", {"grey": volume}, mode=mode, packer=packer)
    path.write_bytes(path.read_bytes().replace(b"0 10 0 6 0 4", b"0 2999 0 1999 0 1999"))
    with pytest.raises(ScanError, match=r"states 2000 x 2000 x 3000 voxels, 24,000,000,000 bytes"):
        open_scan(path, "10 um")


def test_blocks_are_not_unpacked_beyond_their_size(tmp_path: Path, volume: np.ndarray) -> None:
    bomb = zlib.compress(bytes(50_000_000))
    for wanted, blocks in ((volume.nbytes, 1), (volume.nbytes // 2, 2)):
        header = np.array([blocks, wanted, 0, *[len(bomb)] * blocks], "<u4").tobytes()
        text = (base64.b64encode(header) + base64.b64encode(bomb * blocks)).decode()
        array = f'<DataArray type="UInt16" Name="a" format="binary">{text}</DataArray>'
        path = by_hand(tmp_path / "s.vti", array, compressor="vtkZLibDataCompressor")
        with pytest.raises(ScanError, match="damaged or cut off"):
            open_scan(path, "10 um")


def test_numbers_that_the_type_does_not_hold(tmp_path: Path) -> None:
    ones = "1 " * 384
    for text, told in ((ones + "70000", "none of uint16"), (ones + "a", "not a number"),
                       (ones + "-1", "none of uint16"), (ones + "1 1", "386 numbers where 385")):  # fmt: skip
        array = f'<DataArray type="UInt16" Name="a" format="ascii">{text}</DataArray>'
        with pytest.raises(ScanError, match=told):
            open_scan(by_hand(tmp_path / "s.vti", array), "10 um")


@pytest.mark.skipif(os.name != "posix", reason="memory is bounded by a call of POSIX")
def test_damaged_files_are_refused(tmp_path: Path, volume: np.ndarray) -> None:
    folder = tmp_path / "whole"
    folder.mkdir()
    for mode, packer in (
        ("Ascii", "None"),
        ("Raw", "None"),
        ("Raw", "LZ4"),
        ("Binary", "LZMA"),
        ("Appended", "ZLib"),
    ):
        write(folder / f"{mode}{packer}.vti", {"grey": volume}, mode=mode, packer=packer, block=256)
    assert problems_of(tmp_path, cases_of_folder(folder), 40) == []
