"""Zeiss' reconstructed volumes are read from their OLE streams; projections and damage are refused by "
"name."""

from __future__ import annotations

import io
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import olefile
import pytest

from mbstudio.core.errors import ScanError, UnitError
from mbstudio.core.grains import load_labels
from mbstudio.core.project import Project
from mbstudio.core.scan import open_scan
from mbstudio.core.scan.readers import xradia
from tests.core.scan.readers.ole_writer import ole_file
from tests.fuzzing.harness import problems_of

CODES = {"uint8": 3, "int16": 4, "uint16": 5, "float32": 10}


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 60_000, (5, 47, 61)).astype(np.uint16)


def txm(voxels: np.ndarray, edge: float | None = 2.5, **changes: bytes | None) -> dict[str, bytes]:
    """Return the streams of a volume; `changes` replace or (None) remove those of ImageInfo."""
    z, y, x = voxels.shape
    info = {
        "ImageWidth": struct.pack("<I", x),
        "ImageHeight": struct.pack("<I", y),
        "NoOfImages": struct.pack("<I", z),
        "DataType": struct.pack("<I", CODES[voxels.dtype.name]),
        "Angles": np.zeros(z, "<f4").tobytes(),
        "PixelSize": None if edge is None else struct.pack("<f", edge),
        **changes,
    }
    streams = {f"ImageInfo/{key}": content for key, content in info.items() if content is not None}
    for index, image in enumerate(voxels):
        streams[f"ImageData{index // 100 + 1}/Image{index + 1}"] = image.tobytes()
    streams["Version"] = struct.pack("<f", 3.5)
    return streams


def test_olefile_itself_reads_what_the_tests_write(volume: np.ndarray) -> None:
    streams = txm(volume)
    for scattered in (None, 3):
        content = ole_file(streams, scattered)
        with olefile.OleFileIO(io.BytesIO(content), raise_defects=olefile.DEFECT_INCORRECT) as ole:
            names = {"/".join(name) for name in ole.listdir()}
            assert names == set(streams)
            for name in names:
                assert ole.openstream(name).read() == streams[name]


def test_what_reads_such_files_is_not_imported_before_it_is_needed() -> None:
    code = "import sys, mbstudio.core.scan.readers; sys.exit('olefile' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("scattered", [None, 1])
@pytest.mark.parametrize("dtype", ["uint8", "int16", "uint16", "float32"])
def test_reconstructed_volumes(tmp_path: Path, volume: np.ndarray, dtype: str, scattered: int | None) -> None:
    voxels = (volume // 256).astype(dtype)
    path = tmp_path / "s.txm"
    path.write_bytes(ole_file(txm(voxels), scattered))
    scan = open_scan(path)
    assert scan.voxels.dtype == dtype
    np.testing.assert_array_equal(np.asarray(scan.voxels), voxels)
    assert (scan.unit, scan.voxel_size.zyx) == ("um", (2.5, 2.5, 2.5))
    Project.new(scan).save(tmp_path / "p.mbs")
    again = Project.open(tmp_path / "p.mbs").scan
    assert again is not None
    np.testing.assert_array_equal(np.asarray(again.voxels), voxels)


@pytest.mark.parametrize("scattered", [None, 1])
def test_more_than_a_hundred_small_slices(
    tmp_path: Path, rng: np.random.Generator, scattered: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    voxels = rng.integers(0, 250, (203, 5, 7)).astype(np.uint8)
    path = tmp_path / "s.txm"
    path.write_bytes(ole_file(txm(voxels), scattered))
    np.testing.assert_array_equal(np.asarray(open_scan(path).voxels), voxels)
    monkeypatch.setattr(xradia, "READ_AT_ONCE_BYTES", 0)
    lazy = open_scan(path)
    assert not isinstance(lazy.voxels, np.ndarray)
    np.testing.assert_array_equal(lazy.voxels[150], voxels[150])
    np.testing.assert_array_equal(np.asarray(lazy.voxels), voxels)


@pytest.mark.parametrize("ending", ["txrm", "xrm", "TXRM"])
def test_projections_are_refused_by_name(tmp_path: Path, volume: np.ndarray, ending: str) -> None:
    path = tmp_path / f"s.{ending}"
    path.write_bytes(ole_file(txm(volume)))
    with pytest.raises(ScanError, match=rf"s\.{ending} holds projections.*\.txm"):
        open_scan(path, "10 um")


@pytest.mark.parametrize("edge", [None, 0.0, float("nan"), -2.0])
def test_a_volume_without_pixel_size_asks_for_it(
    tmp_path: Path, volume: np.ndarray, edge: float | None
) -> None:
    path = tmp_path / "s.txm"
    path.write_bytes(ole_file(txm(volume, edge)))
    with pytest.raises(UnitError, match="does not contain the voxel size"):
        open_scan(path)
    assert open_scan(path, "10 um").voxel_size.x == 10


@pytest.mark.parametrize(
    ("changes", "says"),
    [({"ImageWidth": None}, "does not say its ImageWidth"),
     ({"DataType": struct.pack("<I", 9)}, "data type 9"),
     ({"NoOfImages": struct.pack("<I", 7)}, "2 of them are missing, the first of them 6"),
     ({"NoOfImages": struct.pack("<I", 2**32 - 1)}, "4,294,967,290 of them are missing"),
     ({"ImageWidth": struct.pack("<I", 2**31)}, "more than its"),
     ({"ImageHeight": struct.pack("<I", 46)}, r"slice 1, where 46 x 61 .*damaged"),
     ({"DataType": b"\5"}, "does not say its DataType"), ({"NoOfImages": bytes(4)}, "contains no voxels")],
)  # fmt: skip
def test_what_a_file_says_wrongly(
    tmp_path: Path, volume: np.ndarray, changes: dict[str, bytes | None], says: str
) -> None:
    path = tmp_path / "s.txm"
    path.write_bytes(ole_file(txm(volume, **changes)))
    with pytest.raises(ScanError, match=rf"s\.txm.*{says}"):
        open_scan(path, "10 um")


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.9, 0.97])
def test_cut_off_and_foreign_files(tmp_path: Path, volume: np.ndarray, share: float) -> None:
    path = tmp_path / "s.txm"
    content = ole_file(txm(volume))
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ScanError, match=r"s\.txm.*(damaged|cut off|not a file of XRadia)"):
        open_scan(path, "10 um")
    path.write_bytes(b"II*\0" + bytes(1000))
    with pytest.raises(ScanError, match="not a file of XRadia"):
        open_scan(path, "10 um")


def test_labels(tmp_path: Path) -> None:
    labels = np.zeros((6, 40, 50), np.uint16)
    labels[1:4, 5:9, 5:9], labels[1:4, 20:30, 20:30] = 3, 8
    (tmp_path / "l.txm").write_bytes(ole_file(txm(labels)))
    assert load_labels(tmp_path / "l.txm").table["voxels"].tolist() == [48, 300]


@pytest.mark.skipif(os.name != "posix", reason="memory is bounded by a call of POSIX")
def test_mutated_files_are_read_or_refused(tmp_path: Path, volume: np.ndarray) -> None:
    cases = [({"s.txm": ole_file(txm(volume[:3]), 2)}, ["s.txm"]),
             ({"s.txm": ole_file(txm(volume[:3, :5, :7]))}, ["s.txm"])]  # fmt: skip
    assert problems_of(tmp_path, cases, 300) == []
