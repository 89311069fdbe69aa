"""MetaImage and NRRD: several data files, packed and written-out numbers; no damage passes in silence."""

from __future__ import annotations

import bz2
import gzip
import os
import zlib
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

from mbstudio.core.errors import ScanError
from mbstudio.core.scan import open_scan
from tests.fuzzing.harness import problems_of

HEAD = ("ObjectType = Image", "NDims = 3", "DimSize = 11 7 5", "ElementType = MET_USHORT")


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 60_000, (5, 7, 11)).astype("<u2")


def mhd(folder: Path, *lines: str, head: tuple[str, ...] = HEAD) -> Path:
    path = folder / "s.mhd"
    path.write_text("\n".join((*head, *lines)) + "\n")
    return path


def nhdr(folder: Path, *lines: str) -> Path:
    path = folder / "s.nhdr"
    head = ("NRRD0004", "type: uint16", "endian: little", "dimension: 3", "sizes: 11 7 5")
    path.write_text("\n".join((*head, *lines)) + "\n")
    return path


def slices(
    folder: Path, volume: np.ndarray, pack=lambda content: content, name: str = "z{:03d}.raw"
) -> list[str]:
    names = [name.format(index) for index in range(1, len(volume) + 1)]
    for name, image in zip(names, volume, strict=True):
        (folder / name).write_bytes(pack(image.tobytes()))
    return names


def check(path: Path, volume: np.ndarray) -> None:
    scan = open_scan(path, "10 um")
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)
    np.testing.assert_array_equal(scan.voxels[3], volume[3])


# Several files ---------------------------------------------------------------------------------


@pytest.mark.parametrize("packed", [False, True])
def test_slices_named_by_a_pattern_or_a_list(tmp_path: Path, volume: np.ndarray, packed: bool) -> None:
    names = slices(tmp_path, volume, zlib.compress if packed else lambda content: content)
    more = ("CompressedData = True",) if packed else ()
    check(mhd(tmp_path, *more, "ElementDataFile = z%03d.raw 1 5 1"), volume)
    check(mhd(tmp_path, *more, "ElementDataFile = LIST", *names), volume)
    check(mhd(tmp_path, *more, "ElementDataFile = LIST 2", *reversed(names)), volume[::-1])
    names = slices(tmp_path, volume, gzip.compress if packed else lambda content: content)
    how = "encoding: gzip" if packed else "encoding: raw"
    check(nhdr(tmp_path, how, "data file: z%03d.raw 1 5 1", ""), volume)
    check(nhdr(tmp_path, how, "data file: z%03d.raw 5 1 -1 2", ""), volume[::-1])
    check(nhdr(tmp_path, how, "data file: LIST", *names), volume)


def test_simpleitk_means_the_same_by_a_pattern(tmp_path: Path, volume: np.ndarray) -> None:
    slices(tmp_path, volume)
    path = mhd(tmp_path, "ElementSpacing = 0.01 0.01 0.01", "ElementDataFile = z%03d.raw 1 5 1")
    np.testing.assert_array_equal(sitk.GetArrayFromImage(sitk.ReadImage(str(path))), volume)
    check(path, volume)


def test_blocks_of_slices_headers_and_bytes_of_colour(tmp_path: Path, volume: np.ndarray) -> None:
    thick = np.concatenate([volume, volume[:1]])
    for index, block in enumerate((thick[:2], thick[2:4], thick[4:])):
        (tmp_path / f"b{index}.raw").write_bytes(b"head" + block.tobytes())
    head = (*HEAD[:2], "DimSize = 11 7 6", HEAD[3])
    check(mhd(tmp_path, "HeaderSize = 4", "ElementDataFile = b%d.raw 0 2 1", head=head), thick)
    check(mhd(tmp_path, "HeaderSize = -1", "ElementDataFile = b%01d.raw 0 2 1", head=head), thick)
    grey = np.repeat(volume[..., None].astype(np.uint8), 3, axis=-1)
    slices(tmp_path, grey)
    head = (*HEAD[:3], "ElementType = MET_UCHAR_ARRAY", "ElementNumberOfChannels = 3")
    check(mhd(tmp_path, "ElementDataFile = z%03d.raw 1 5 1", head=head), volume.astype(np.uint8))


@pytest.mark.parametrize(
    ("named", "says"),
    [("z%s.raw 1 5 1", "which is not read"), ("z%n%n%n.raw 1 5 1", "which is not read"),
     ("z%d%d.raw 1 5 1", "which is not read"), ("z%9999d.raw 1 5 1", "which is not read"),
     ("z%03d.raw 1 999999999 1", "which is not read"), ("z%03d.raw 1 5 0", "which is not read"),
     ("z%03d.raw 1 4 1", "does not come out even"), ("z%03d.raw 2 6 1", r"z006\.raw, which is missing"),
     ("../z%03d.raw 1 5 1", "outside its folder"), ("/etc/%03d 1 5 1", "outside its folder")],
)  # fmt: skip
def test_patterns_that_are_refused(tmp_path: Path, volume: np.ndarray, named: str, says: str) -> None:
    slices(tmp_path, volume)
    with pytest.raises(ScanError, match=says):
        open_scan(mhd(tmp_path, f"ElementDataFile = {named}"), "10 um")
    with pytest.raises(ScanError, match=says):
        open_scan(nhdr(tmp_path, "encoding: raw", f"data file: {named}", ""), "10 um")


@pytest.mark.parametrize(
    ("names", "says"),
    [(["z001.raw"] * 4, "does not come out even"), ([], "does not come out even"),
     (["z001.raw"] * 4 + ["/etc/passwd"], "outside its folder"),
     (["z001.raw"] * 4 + ["../z001.raw"], "outside its folder"),
     (["z001.raw"] * 4 + ["other.raw"], "missing"), (["z001.raw"] * 4 + ["short.raw"], "cut off")],
)  # fmt: skip
def test_lists_that_are_refused(tmp_path: Path, volume: np.ndarray, names: list[str], says: str) -> None:
    slices(tmp_path, volume)
    (tmp_path / "short.raw").write_bytes(volume[0].tobytes()[:-1])
    with pytest.raises(ScanError, match=says):
        open_scan(mhd(tmp_path, "ElementDataFile = LIST", *names), "10 um")
    with pytest.raises(ScanError, match=says):
        open_scan(nhdr(tmp_path, "encoding: raw", "data file: LIST", *names), "10 um")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes")
def test_pipes_are_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "s.raw")
    for path in (
        mhd(tmp_path, "ElementDataFile = s.raw"),
        nhdr(tmp_path, "encoding: raw", "data file: s.raw", ""),
    ):
        with pytest.raises(ScanError, match=r"s\.raw is not a regular file"):
            open_scan(path, "10 um")


# Packed and written out ------------------------------------------------------------------------


def test_numbers_of_other_types_and_as_text(tmp_path: Path, volume: np.ndarray) -> None:
    text = " ".join(str(number) for number in volume.ravel())
    (tmp_path / "s.raw").write_text(text)
    check(mhd(tmp_path, "BinaryData = False", "ElementDataFile = s.raw"), volume)
    check(nhdr(tmp_path, "encoding: ascii", "data file: s.raw", ""), volume)
    for kind in ("<i4", "<i8"):
        (tmp_path / "s.raw").write_bytes(volume.astype(kind).tobytes())
        check(mhd(tmp_path, "ElementDataFile = s.raw", head=(*HEAD[:3], "ElementType = MET_LONG")), volume)
    (tmp_path / "s.raw").write_bytes(volume.astype(">u2").tobytes())
    check(mhd(tmp_path, "BinaryDataByteOrderMSB = True", "ElementDataFile = s.raw"), volume)


def test_lines_and_bytes_to_skip(tmp_path: Path, volume: np.ndarray) -> None:
    content = b"a line\nanother\n" + b"xyz" + volume.tobytes()
    (tmp_path / "s.raw").write_bytes(content)
    check(nhdr(tmp_path, "encoding: raw", "line skip: 2", "byte skip: 3", "data file: s.raw", ""), volume)
    check(nhdr(tmp_path, "encoding: raw", "byte skip: -1", "data file: s.raw", ""), volume)
    (tmp_path / "s.raw").write_bytes(b"a line\n" + gzip.compress(b"xyz" + volume.tobytes()))
    check(nhdr(tmp_path, "encoding: gzip", "line skip: 1", "byte skip: 3", "data file: s.raw", ""), volume)
    check_bz2 = nhdr(tmp_path, "encoding: bzip2", "data file: s.raw", "")
    (tmp_path / "s.raw").write_bytes(bz2.compress(volume[:2].tobytes()) + bz2.compress(volume[2:].tobytes()))
    check(check_bz2, volume)


@pytest.mark.parametrize("kind", ["mha", "nrrd gzip", "nrrd bzip2"])
def test_no_flipped_bit_of_packed_voxels_passes(tmp_path: Path, volume: np.ndarray, kind: str) -> None:
    path = tmp_path / ("s.mha" if kind == "mha" else "s.nrrd")
    if kind == "mha":
        image = sitk.GetImageFromArray(volume)
        sitk.WriteImage(image, str(path), useCompression=True)
        start = path.read_bytes().index(b"LOCAL\n") + 6
    else:
        packed = {"gzip": gzip.compress, "bzip2": bz2.compress}[kind.split()[1]](volume.tobytes())
        lines = "NRRD0004\ntype: uint16\nendian: little\ndimension: 3\nsizes: 11 7 5\nencoding: "
        path.write_bytes(f"{lines}{kind.split()[1]}\n\n".encode() + packed)
        start = len(path.read_bytes()) - len(packed)
    content = path.read_bytes()
    check(path, volume)
    silent = refused = 0
    for bit in range(8 * start, 8 * len(content), 7):
        changed = bytearray(content)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        try:
            silent += not np.array_equal(np.asarray(open_scan(path, "10 um").voxels), volume)
        except ScanError:
            refused += 1
    assert silent == 0
    assert refused > 500


@pytest.mark.parametrize("packing", ["zlib", "gzip", "bzip2"])
@pytest.mark.parametrize("change", ["more", "fewer", "cut", "huge"])
def test_as_many_voxels_as_stated(tmp_path: Path, volume: np.ndarray, packing: str, change: str) -> None:
    pack = {"zlib": zlib.compress, "gzip": gzip.compress, "bzip2": bz2.compress}[packing]
    plain = volume.tobytes()
    content = {
        "more": lambda: pack(plain + b"ab"),
        "fewer": lambda: pack(plain[:-2]),
        "cut": lambda: pack(plain)[:-6],
        "huge": lambda: pack(plain + bytes(50_000_000)),
    }[change]()
    (tmp_path / "s.raw").write_bytes(content)
    path = (
        mhd(tmp_path, "CompressedData = True", "ElementDataFile = s.raw")
        if packing == "zlib"
        else nhdr(tmp_path, f"encoding: {packing}", "data file: s.raw", "")
    )
    says = "more" if change in ("more", "huge") else "fewer"
    with pytest.raises(
        ScanError, match=rf"s\.raw holds {says} packed voxels than its header states \(770 bytes\)"
    ):
        open_scan(path, "10 um")


@pytest.mark.parametrize(
    ("lines", "says"),
    [(("HeaderSize = many",), "HeaderSize as 'many'"), (("HeaderSize = -7",), "HeaderSize as -7"),
     (("CompressedData = True", "CompressedDataSize = 99999"), "more packed bytes than s.raw holds"),
     (("NDims = 4",), r"4 axes .NDims., but 3"), (("DimSize = 11 seven 5",), "how many voxels"),
     (("DimSize = 11 7 1e99",), "how many voxels"), (("ElementType = MET_OTHER",), "MET_OTHER"),
     (("ElementNumberOfChannels = 0",), "0 channels"), (("ElementNumberOfChannels = x",), "whole number"),
     (("ElementSpacing = 1 one 1",), "invalid number"), (("ElementSpacing = 1",), "invalid number"),
     (("TransformMatrix = 1 0 0",), "invalid number"),
     (("BinaryData = False",), "holds something that is not a number|numbers, where")],
)  # fmt: skip
def test_headers_that_say_something_wrong(
    tmp_path: Path, volume: np.ndarray, lines: tuple[str, ...], says: str
) -> None:
    (tmp_path / "s.raw").write_bytes(volume.tobytes())
    with pytest.raises(ScanError, match=says):
        open_scan(mhd(tmp_path, *lines, "ElementDataFile = s.raw"), "10 um")


@pytest.mark.skipif(os.name != "posix", reason="memory is bounded by a call of POSIX")
def test_mutated_files_are_read_or_refused(tmp_path: Path, volume: np.ndarray) -> None:
    folder = tmp_path / "made"
    folder.mkdir()
    names = slices(folder, volume)
    parts = {name: (folder / name).read_bytes() for name in names}
    image = sitk.GetImageFromArray(volume)
    sitk.WriteImage(image, str(folder / "s.mha"), useCompression=True)
    said = ("ElementSpacing = 0.01 0.01 0.02", "Offset = 1 2 3", "TransformMatrix = 1 0 0 0 1 0 0 0 1")
    pattern = mhd(folder, *said, "ElementDataFile = z%03d.raw 1 5 1").read_bytes()
    listed = mhd(folder, *said, "ElementDataFile = LIST", *names).read_bytes()
    text = nhdr(folder, "encoding: ascii", "spacings: 1 1 2", 'units: "um" "um" "um"', "").read_bytes()
    packed = nhdr(folder, "encoding: gzip", "space directions: (1,0,0) (0,1,0) (0,0,1)", "").read_bytes()
    bunched = nhdr(folder, "encoding: raw", "data file: z%03d.raw 1 5 1", "").read_bytes()
    numbers = " ".join(map(str, volume.ravel())).encode()
    cases = [
        ({"s.mha": (folder / "s.mha").read_bytes()}, ["s.mha"]), ({"s.mhd": pattern, **parts}, ["s.mhd"]),
        ({"s.mhd": listed, **parts}, ["s.mhd"]), ({"s.nhdr": bunched, **parts}, ["s.nhdr"]),
        ({"s.nrrd": text + numbers}, ["s.nrrd"]),
        ({"s.nrrd": packed + gzip.compress(volume.tobytes())}, ["s.nrrd"]),
    ]  # fmt: skip
    assert problems_of(tmp_path, cases, 150) == []
