"""TIFF, slices, NPY and HDF5 that are damaged in any way are read or refused, in bounded time and memory."""

from __future__ import annotations

import io
import os
import struct
from pathlib import Path
from typing import Any

import h5py
import imageio.v3 as iio
import numpy as np
import pytest
import tifffile

from mbstudio.core.errors import ScanError
from mbstudio.core.scan import open_scan
from tests.fuzzing.harness import problems_of


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 60_000, (5, 17, 21)).astype("<u2")


def tiff(voxels: np.ndarray, **options: Any) -> bytes:
    stream = io.BytesIO()
    tifffile.imwrite(stream, voxels, **options)
    return stream.getvalue()


@pytest.mark.parametrize("changed", [0, 2])
def test_slices_whose_pages_run_in_a_circle_end(tmp_path: Path, volume: np.ndarray, changed: int) -> None:
    for index, image in enumerate(volume):
        content = bytearray(tiff(image, metadata=None))
        if index == changed:
            start = struct.unpack("<I", content[4:8])[0]
            end = start + 2 + 12 * struct.unpack("<H", content[start : start + 2])[0]
            struct.pack_into("<I", content, end, len(content))
            # Another page, of one tag, behind which it comes again.
            content += (
                struct.pack("<H", 1) + content[start + 2 : start + 14] + struct.pack("<I", len(content))
            )
        (tmp_path / f"z{index}.tif").write_bytes(content)
    with pytest.raises(ScanError, match=rf"z{changed}\.tif"):
        np.asarray(open_scan(tmp_path, "10 um").voxels)


@pytest.mark.parametrize(
    "header",
    ["{'descr': '<u2', 'fortran_order': False, 'shape': (5, 17, 21",
     "{'descr': '<u2'", "((((((((((" * 50, "\0",
     "{'descr': '<u2', 'fortran_order': False, 'shape': (5, 17, 10**9)}", "[1, 2]", "{1: 2}"],
)  # fmt: skip
def test_headers_of_npy_that_are_none(tmp_path: Path, header: str) -> None:
    text = header.encode().ljust(118) + b"\n"
    path = tmp_path / "s.npy"
    path.write_bytes(b"\x93NUMPY\x01\0" + struct.pack("<H", len(text)) + text + bytes(2 * 5 * 17 * 21))
    with pytest.raises(ScanError, match=r"s\.npy cannot be read as an NPY array"):
        open_scan(path, "10 um")


@pytest.mark.skipif(os.name != "posix", reason="memory is bounded by a call of POSIX")
def test_mutated_files_are_read_or_refused(tmp_path: Path, volume: np.ndarray) -> None:
    plain = io.BytesIO()
    np.save(plain, volume)
    for name, options in (("a.h5", {}), ("b.h5", {"compression": "gzip", "chunks": (2, 8, 8)})):
        with h5py.File(tmp_path / name, "w") as file:
            file.create_dataset("exported_data", data=volume, **options)
    log = b"[Reconstruction]\nPixel Size (um)=14.1\n[Acquisition]\nImage Pixel Size (um)=12.0\n"
    pictures = {f"z{i}.bmp": iio.imwrite("<bytes>", image.astype(np.uint8), extension=".bmp")
                for i, image in enumerate(volume)}  # fmt: skip
    imagej = {
        "imagej": True,
        "resolution": (0.1, 0.1),
        "metadata": {"unit": "um", "spacing": 2.0, "axes": "ZYX"},
    }
    cases = [
        ({"s.tif": tiff(volume, compression="zlib", predictor=True)}, ["s.tif"]),
        ({"s.tif": tiff(volume, **imagej)}, ["s.tif"]),
        ({"s.tif": tiff(volume, ome=True, metadata={"axes": "ZYX"})}, ["s.tif"]),
        ({f"z{i}.tif": tiff(image, compression="zlib") for i, image in enumerate(volume)}, ["."]),
        ({**pictures, "z.log": log}, ["."]),
        ({"s.npy": plain.getvalue()}, ["s.npy"]),
        ({"s.h5": (tmp_path / "a.h5").read_bytes()}, ["s.h5"]),
        ({"s.h5": (tmp_path / "b.h5").read_bytes()}, ["s.h5"]),
    ]
    assert problems_of(tmp_path, cases, 60) == []
