"""Bare voxels are read as the side-cars of scanners and programs describe them, or refused with the cause.

The side-cars are written here after their documented layout; none comes from a scanner.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.errors import ScanError, ScanWarning, UnitError
from mbstudio.core.grains import load_labels
from mbstudio.core.project import Project
from mbstudio.core.scan import open_scan
from tests.fuzzing.harness import problems_of

VGI = """{volume1}
[representation]
size = 11 7 5
datatype = unsigned integer
datarange = 0 -1
bitsperelement = 16
[file1]
SkipHeader = 0
FileType = RAW
Size = 11 7 5
Name = s.vol
Datatype = unsigned integer
datarange = 0 -1
BitsPerElement = 16
{volumeprimitive12}
[geometry]
resolution = 0.01 0.01 0.02
unit = mm
[volume]
volume = volume1
[description]
text = s
"""
XTEK = """[XTekCT]
Name=s
VoxelsX=11
VoxelSizeX=0.01
VoxelsY=7
VoxelSizeY=0.01
VoxelsZ=5
VoxelSizeZ=0.02
OffsetX=0
SrcToObject=100
Units=mm

[CTPro]
Scaling_DataTypeVolume=Float
Scaling_Units=InverseMetres
"""
PCR = """[Versions]
Version-datos|x=2.2
[VolumeData]
Volume_SizeX=11
Volume_SizeY=7
Volume_SizeZ=5
VoxelSizeRec=0.015
Format=5
Min=0
[ROI]
ROI_SizeX=11
"""
INFO = (
    "! PyHST_SLAVE VOLUME INFO FILE\nNUM_X =  11\nNUM_Y =   7\nNUM_Z =   5\nvoxelSize =  14.0\n"
    "s1 = 1\nS1 = 2\n"
)
ENVI = (
    "ENVI\ndescription = {\n a scan,\n of sand}\nsamples = 11\nlines = 7\nbands = 5\nheader offset = 0\n"
    "file type = ENVI Standard\ndata type = 12\ninterleave = bsq\nbyte order = 0\n"
)
VOREEN = (
    "ObjectFileName: s.raw\nResolution: 11 7 5\nSliceThickness: 0.01 0.01 0.02\nFormat: USHORT\n"
    "ObjectModel: I\n"
)


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 60_000, (5, 7, 11)).astype("<u2")


def write(folder: Path, voxels: np.ndarray, **texts: str) -> Path:
    """Write voxels as ``s.vol`` (or .raw) and side-cars by their endings; return the file of voxels."""
    data = folder / f"s.{texts.pop('data', 'vol')}"
    data.write_bytes(voxels.tobytes())
    for ending, text in texts.items():
        (folder / f"s.{ending.replace('_', '.')}").write_text(text, encoding="utf-8")
    return data


def check(path: Path, volume: np.ndarray, zyx: tuple[float, ...], unit: str | None = None) -> None:
    scan = open_scan(path, unit=unit)
    assert scan.is_memory_mapped
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)
    assert scan.voxel_size.to("mm").zyx == pytest.approx(zyx)


# Nikon -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("opened", ["s.vol", "s.vgi"])
def test_vgi_describes_the_volume_beside_it(tmp_path: Path, volume: np.ndarray, opened: str) -> None:
    write(tmp_path, volume, vgi=VGI)
    check(tmp_path / opened, volume, (0.02, 0.01, 0.01))


@pytest.mark.parametrize(
    ("kind", "bits", "dtype"),
    [("float", 32, "<f4"), ("unsigned integer", 8, "u1"), ("signed integer", 16, "<i2"),
     ("double", 64, "<f8"), ("integer", 32, "<i4")],
)  # fmt: skip
def test_types_of_vgi(tmp_path: Path, volume: np.ndarray, kind: str, bits: int, dtype: str) -> None:
    text = VGI.replace("unsigned integer", kind).replace("= 16", f"= {bits}").replace("unit = mm\n", "")
    voxels = volume.astype(dtype)
    write(tmp_path, voxels, vgi=text)
    check(tmp_path / "s.vgi", voxels, (0.02, 0.01, 0.01))


def test_what_else_a_vgi_says_is_of_no_matter(tmp_path: Path, volume: np.ndarray) -> None:
    text = VGI.replace("[description]", "[view]\nsize = 800 600\nunit = pixel\n[description]")
    text = text.replace("Datatype = unsigned integer\n", "").replace("BitsPerElement = 16\n", "")
    write(tmp_path, volume, vgi=text)
    check(tmp_path / "s.vgi", volume, (0.02, 0.01, 0.01))


def test_vgi_with_header_and_other_units(tmp_path: Path, volume: np.ndarray) -> None:
    text = VGI.replace("SkipHeader = 0", "SkipHeader = 3").replace("unit = mm", "unit = µm")
    write(tmp_path, volume, vgi=text.replace("0.01 0.01 0.02", "10 10 20"))
    (tmp_path / "s.vol").write_bytes(b"abc" + volume.tobytes())
    check(tmp_path / "s.vol", volume, (0.02, 0.01, 0.01))


def test_vgi_that_names_its_volume_by_a_path_of_another_machine(tmp_path: Path, volume: np.ndarray) -> None:
    text = VGI.replace("Name = s.vol", r"Name = D:\scans\2020\stone.vol")
    write(tmp_path, volume, vgi=text)
    with pytest.warns(ScanWarning, match=r"names its voxels 'D:.*not there: s\.vol was taken"):
        open_scan(tmp_path / "s.vgi")
    (tmp_path / "stone.vol").write_bytes(np.zeros_like(volume).tobytes())
    check(tmp_path / "s.vgi", np.zeros_like(volume), (0.02, 0.01, 0.01))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [("Size = 11 7 5", "Size = 11 7 6", "a part is shown"),
     ("[file1]", "[file1]\nName = a\n[file2]", "2 files of voxels"),
     ("size = 11 7 5", "size = 11 0 5", "not a number of voxels"),
     ("size = 11 7 5", "size = 11 7", "as 11 x 7"),
     ("Datatype = unsigned integer", "Datatype = complex", "not read"),
     ("BitsPerElement = 16", "BitsPerElement = 12", "12 bits"),
     ("SkipHeader = 0", "SkipHeader = -5", "not a number of bytes"),
     ("SkipHeader = 0", "SkipHeader = 5", "5 fewer.*cut off"),
     ("resolution = 0.01 0.01 0.02", "resolution = 0.01 x 0.02", "not three lengths")],
)  # fmt: skip
def test_what_a_vgi_says_wrongly(tmp_path: Path, volume: np.ndarray, old: str, new: str, says: str) -> None:
    data = write(tmp_path, volume, vgi=VGI.replace(old, new))
    with pytest.raises(ScanError, match=rf"(?s)s\.vgi.*{says}"):
        open_scan(tmp_path / "s.vgi")
    scan = open_scan(data, "10 um", shape=volume.shape, dtype="uint16")
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)


@pytest.mark.parametrize("resolution", ["", "resolution = 0 0 0"])
def test_a_vgi_without_a_voxel_size_asks_for_it(tmp_path: Path, volume: np.ndarray, resolution: str) -> None:
    data = write(tmp_path, volume, vgi=VGI.replace("resolution = 0.01 0.01 0.02", resolution))
    with pytest.raises(UnitError, match="does not contain the voxel size"):
        open_scan(data)
    assert open_scan(data, "10 um").voxel_size.x == 10


@pytest.mark.parametrize("unit", ["furlong", "parsec", "?m"])
def test_units_of_a_vgi_that_are_not_known(tmp_path: Path, volume: np.ndarray, unit: str) -> None:
    data = write(tmp_path, volume, vgi=VGI.replace("unit = mm", f"unit = {unit}"))
    with pytest.raises(UnitError, match=rf"'{unit}'".replace("?", r"\?")):
        open_scan(data)


def test_sizes_that_no_scan_has_are_asked_about(tmp_path: Path, volume: np.ndarray) -> None:
    data = write(tmp_path, volume, vgi=VGI.replace("0.01 0.01 0.02", "14 14 14"))
    with pytest.raises(UnitError, match="outside the range of scans"):
        open_scan(data)


def test_mirrored_axes_are_told(tmp_path: Path, volume: np.ndarray) -> None:
    data = write(tmp_path, volume, vgi=VGI.replace("[geometry]", "[geometry]\nmirror = 0 0 1"))
    with pytest.warns(ScanWarning, match="mirrored axes"):
        open_scan(data)


@pytest.mark.parametrize("opened", ["s.vol", "s.xtekct"])
def test_xtekct_describes_the_volume_beside_it(tmp_path: Path, volume: np.ndarray, opened: str) -> None:
    voxels = volume.astype("<f4")
    write(tmp_path, voxels, xtekct=XTEK)
    check(tmp_path / opened, voxels, (0.02, 0.01, 0.01))


@pytest.mark.parametrize(("dtype", "name"), [("<f4", "float32"), ("<u2", "uint16"), ("u1", "uint8")])
def test_an_xtekct_without_the_type_is_told_by_the_length(
    tmp_path: Path, volume: np.ndarray, dtype: str, name: str
) -> None:
    write(tmp_path, volume.astype(dtype), xtekct=XTEK.partition("[CTPro]")[0])
    with pytest.warns(ScanWarning, match=f"without the type of its voxels.*taken as {name}"):
        scan = open_scan(tmp_path / "s.xtekct")
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume.astype(dtype))


@pytest.mark.parametrize(
    ("text", "says"),
    [(XTEK.replace("VoxelsY=7\n", ""), "does not say VoxelsY"),
     (XTEK.replace("=7", "=7.5"), "not a number of voxels"),
     ("Name=s\n", r"\[XTekCT\] is missing"), (XTEK.replace("=0.02", "=wide"), "not a length"),
     (XTEK.replace("VoxelsX=11", "VoxelsX=11\nVoxelsX=12"), "as 11 and as 12")],
)  # fmt: skip
def test_what_an_xtekct_says_wrongly(tmp_path: Path, volume: np.ndarray, text: str, says: str) -> None:
    write(tmp_path, volume.astype("<f4"), xtekct=text)
    with pytest.raises(ScanError, match=rf"s\.xtekct.*{says}"):
        open_scan(tmp_path / "s.xtekct")


# GE --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("opened", ["s.vol", "s.pcr"])
@pytest.mark.parametrize(("code", "dtype"), [(1, "u1"), (5, "<u2"), (10, "<f4")])
def test_pcr_describes_the_volume_beside_it(
    tmp_path: Path, volume: np.ndarray, opened: str, code: int, dtype: str
) -> None:
    voxels = volume.astype(dtype)
    write(tmp_path, voxels, pcr=PCR.replace("Format=5", f"Format={code}").replace("\n", "\r\n"))
    check(tmp_path / opened, voxels, (0.015, 0.015, 0.015))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [("Format=5", "Format=7", "only 1 .8 bits., 5"), ("Format=5", "Format=10", "fewer.*cut off"),
     ("Format=5", "Format=1", "385 more"), ("Format=5\n", "", "does not say Format"),
     ("[VolumeData]", "[Volume]", "VolumeData"), ("SizeZ=5", "SizeZ=-5", "not a number of voxels")],
)  # fmt: skip
def test_what_a_pcr_says_wrongly(tmp_path: Path, volume: np.ndarray, old: str, new: str, says: str) -> None:
    write(tmp_path, volume, pcr=PCR.replace(old, new))
    with pytest.raises(ScanError, match=rf"s\.pcr.*{says}"):
        open_scan(tmp_path / "s.pcr")


def test_a_pcr_without_voxel_size_or_volume(tmp_path: Path, volume: np.ndarray) -> None:
    data = write(tmp_path, volume, pcr=PCR.replace("VoxelSizeRec=0.015\n", ""))
    with pytest.raises(UnitError, match="does not contain the voxel size"):
        open_scan(data)
    data.unlink()
    with pytest.raises(ScanError, match=r"s\.vol, which is missing"):
        open_scan(tmp_path / "s.pcr")


# Other side-cars of RAW ------------------------------------------------------------------------


def test_pyhst_info(tmp_path: Path, volume: np.ndarray) -> None:
    data = write(tmp_path, volume.astype("<f4"), vol_info=INFO)
    with pytest.raises(UnitError, match=r"14 x 14 x 14.*without a unit"):
        open_scan(data)
    with pytest.warns(ScanWarning, match="without the type"):
        check(data, volume.astype("<f4"), (0.014, 0.014, 0.014), "um")
    text = INFO + "DATA_TYPE = uint16\nBYTEORDER = HIGHBYTEFIRST\n"
    write(tmp_path, volume.astype(">u2"), data="raw", raw_info=text)
    check(tmp_path / "s.raw", volume, (0.014, 0.014, 0.014), "um")
    write(tmp_path, volume, data="raw", raw_info=INFO + "DATA_TYPE = PACKED_BINARY\n")
    with pytest.raises(ScanError, match="packed_binary"):
        open_scan(tmp_path / "s.raw", "10 um")


def test_envi_headers(tmp_path: Path, volume: np.ndarray) -> None:
    data = write(tmp_path, volume, data="raw", hdr=ENVI)
    np.testing.assert_array_equal(np.asarray(open_scan(data, "10 um").voxels), volume)
    with pytest.raises(UnitError, match="does not contain the voxel size"):
        open_scan(data)
    write(tmp_path, volume.astype(">u2"), data="raw", hdr=ENVI.replace("order = 0", "order = 1"))
    np.testing.assert_array_equal(np.asarray(open_scan(data, "10 um").voxels), volume)
    for old, new, says in (
        ("bsq", "bil", "BIL"),
        ("type = 12", "type = 6", "data type 6"),
        ("bands = 5", "", "bands"),
    ):
        write(tmp_path, volume, data="raw", hdr=ENVI.replace(old, new))
        with pytest.raises(ScanError, match=rf"s\.hdr.*{says}"):
            open_scan(data, "10 um")


@pytest.mark.parametrize("opened", ["s.raw", "s.dat"])
def test_voreen_and_inviwo(tmp_path: Path, volume: np.ndarray, opened: str) -> None:
    write(tmp_path, volume, data="raw", dat=VOREEN)
    check(tmp_path / opened, volume, (0.02, 0.01, 0.01), "mm")
    with pytest.raises(UnitError, match="without a unit"):
        open_scan(tmp_path / opened)
    text = "RawFile: s.raw\nResolution: 11 7 5\nFormat: UINT16\nByteOffset: 2\n"
    write(tmp_path, volume, data="raw", dat=text)
    (tmp_path / "s.raw").write_bytes(b"ab" + volume.tobytes())
    np.testing.assert_array_equal(np.asarray(open_scan(tmp_path / opened, "10 um").voxels), volume)


def test_headers_of_itk_and_nrrd_beside_raw(tmp_path: Path, volume: np.ndarray) -> None:
    text = (
        "ObjectType = Image\nNDims = 3\nDimSize = 11 7 5\nElementType = MET_USHORT\n"
        "ElementSpacing = 0.01 0.01 0.02\nElementDataFile = s.raw\n"
    )
    write(tmp_path, volume, data="raw", mhd=text)
    check(tmp_path / "s.raw", volume, (0.02, 0.01, 0.01))
    (tmp_path / "s.mhd").write_text(text.replace("s.raw", "t.raw"))
    with pytest.raises(ScanError, match="nothing beside it does"):
        open_scan(tmp_path / "s.raw", "10 um")
    (tmp_path / "s.nhdr").write_text(
        "NRRD0004\ntype: uint16\nendian: little\ndimension: 3\nsizes: 11 7 5\nencoding: raw\n"
        'spacings: 0.01 0.01 0.02\nunits: "mm" "mm" "mm"\ndata file: s.raw\n\n'
    )
    check(tmp_path / "s.raw", volume, (0.02, 0.01, 0.01))


def test_side_cars_must_agree(tmp_path: Path, volume: np.ndarray) -> None:
    data = write(tmp_path, volume, vgi=VGI, pcr=PCR)
    with pytest.raises(ScanError, match="different voxel sizes"):
        open_scan(data)
    write(tmp_path, volume, vgi=VGI, pcr=PCR.replace("VoxelSizeRec=0.015\n", ""))
    check(data, volume, (0.02, 0.01, 0.01))
    swapped = PCR.replace("X=11", "X=7").replace("Y=7", "Y=11")
    write(tmp_path, volume, vgi=VGI, pcr=swapped)
    with pytest.raises(ScanError, match=r"differently \(5 x 7 x 11 of uint16; 5 x 11 x 7"):
        open_scan(data)


def test_what_describes_a_volume_describes_no_other_file(tmp_path: Path, volume: np.ndarray) -> None:
    write(tmp_path, volume, vgi=VGI, pcr=PCR.replace("VoxelSizeRec=0.015\n", ""))
    (tmp_path / "s.raw").write_bytes(volume[:2].tobytes())
    with pytest.raises(ScanError, match="nothing beside it does"):
        open_scan(tmp_path / "s.raw", "10 um")
    (tmp_path / "s.vol").unlink()
    with pytest.raises(ScanError, match=r"s\.vgi states 5 x 7 x 11"):
        open_scan(tmp_path / "s.raw", "10 um")


def test_other_files_of_those_endings_describe_nothing(tmp_path: Path, volume: np.ndarray) -> None:
    data = write(tmp_path, volume, data="raw", info="a note", raw_info="another", hdr="SIZE 3", dat="a b c")
    with pytest.raises(ScanError, match="does not describe itself, and nothing beside it does"):
        open_scan(data, "10 um")
    (tmp_path / "s.vgi").write_bytes(b"\0" * 100)
    with pytest.raises(ScanError, match=r"s\.vgi is not the text"):
        open_scan(data, "10 um")


# What must not be opened -----------------------------------------------------------------------


@pytest.mark.parametrize("name", ["/etc/hostname", "../out.vol", "..", "C:\\out.vol"])
def test_no_other_folder_is_read(tmp_path: Path, volume: np.ndarray, name: str) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (tmp_path / "out.vol").write_bytes(volume.tobytes())
    (folder / "s.vgi").write_text(VGI.replace("Name = s.vol", f"Name = {name}"))
    with pytest.raises(ScanError, match="which is missing"):
        open_scan(folder / "s.vgi")
    (folder / "s.dat").write_text(VOREEN.replace("s.raw", name))
    with pytest.raises(ScanError, match="outside its folder"):
        open_scan(folder / "s.dat", "10 um")


@pytest.mark.parametrize("ending", ["vol", "vgi"])
def test_links_out_of_the_folder_are_not_followed(tmp_path: Path, volume: np.ndarray, ending: str) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    write(tmp_path, volume, vgi=VGI)
    write(folder, volume, vgi=VGI)
    (folder / f"s.{ending}").unlink()
    try:
        (folder / f"s.{ending}").symlink_to(tmp_path / f"s.{ending}")
    except OSError:
        pytest.skip("this system makes no links")
    with pytest.raises(ScanError, match="a link that leads outside"):
        open_scan(folder / ("s.vgi" if ending == "vol" else "s.vol"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes")
def test_pipes_are_refused_and_not_waited_for(tmp_path: Path, volume: np.ndarray) -> None:
    for name in ("p.vol", "p.vgi", "p.tif", "p.nrrd", "p.mhd", "p.h5", "p.npy", "p.pcr"):
        os.mkfifo(tmp_path / name)
        with pytest.raises(ScanError, match="not a regular file"):
            open_scan(tmp_path / name, "10 um")
    (tmp_path / "p.vol").unlink()
    (tmp_path / "p.vol").write_bytes(volume.tobytes())
    with pytest.raises(ScanError, match=r"p\.vgi is not a regular file"):
        open_scan(tmp_path / "p.vol", "10 um")
    (tmp_path / "s.vgi").write_text(VGI)
    os.mkfifo(tmp_path / "s.vol")
    with pytest.raises(ScanError, match=r"s\.vol is not a regular file"):
        open_scan(tmp_path / "s.vgi", "10 um")


@pytest.mark.skipif(os.name != "posix", reason="memory is bounded by a call of POSIX")
def test_mutated_files_are_read_or_refused(tmp_path: Path, volume: np.ndarray) -> None:
    cases = [
        ({"s.vol": "<u2", "s.vgi": VGI}, ["s.vol", "s.vgi"]),
        ({"s.vol": "<f4", "s.xtekct": XTEK}, ["s.vol", "s.xtekct"]),
        ({"s.vol": "<u2", "s.pcr": PCR}, ["s.vol", "s.pcr"]),
        ({"s.vol": "<f4", "s.vol.info": INFO}, ["s.vol"]),
        ({"s.raw": "<u2", "s.hdr": ENVI}, ["s.raw"]),
        ({"s.raw": "<u2", "s.dat": VOREEN}, ["s.raw", "s.dat"]),
        ({"n_11x7x5_16bit.raw": "<u2"}, ["n_11x7x5_16bit.raw"]),
    ]
    contents = []
    for files, opened in cases:
        content = {
            name: volume.astype(what).tobytes() if what[0] == "<" else what.encode()
            for name, what in files.items()
        }
        contents.append((content, opened))
    assert problems_of(tmp_path, contents, 200) == []


# Labels and projects ---------------------------------------------------------------------------


def test_labels_with_a_side_car(tmp_path: Path) -> None:
    labels = np.zeros((5, 7, 11), "<u2")
    labels[1:3, 1:4, 1:4], labels[1:3, 1:4, 6:9] = 4, 9
    data = write(tmp_path, labels, vgi=VGI)
    for path in (data, tmp_path / "s.vgi"):
        grains = load_labels(path)
        assert grains.table["voxels"].tolist() == [18, 18]
        assert grains.voxel_size.to("mm").zyx == pytest.approx((0.02, 0.01, 0.01))


def test_a_project_finds_such_a_scan_again(tmp_path: Path, volume: np.ndarray) -> None:
    text = VGI.replace("SkipHeader = 0", "SkipHeader = 3")
    write(tmp_path, volume, vgi=text)
    (tmp_path / "s.vol").write_bytes(b"abc" + volume.tobytes())
    for name in ("s.vgi", "s.vol"):
        Project.new(open_scan(tmp_path / name)).save(tmp_path / "p.mbs")
        again = Project.open(tmp_path / "p.mbs").scan
        assert again is not None
        np.testing.assert_array_equal(np.asarray(again.voxels), volume)
