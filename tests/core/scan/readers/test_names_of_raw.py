"""The name of a RAW file may describe it: checked against its length and its voxels, told, never silent."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from mbstudio.core.errors import ScanError, ScanWarning
from mbstudio.core.grains import load_labels
from mbstudio.core.scan import open_scan


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    """Voxels of which neighbours are alike, as in every scan, with edges 40, 48, 64 (z, y, x)."""
    smooth = ndimage.gaussian_filter(rng.standard_normal((40, 48, 64)), 2)
    return (30_000 + 200_000 * smooth / np.ptp(smooth) / 4).clip(0, 65_535).astype("<u2")


def opened(path: Path, voxels: np.ndarray, says: str) -> None:
    path.write_bytes(voxels.tobytes())
    with pytest.warns(ScanWarning, match=f"described by its name alone.*{says}"):
        scan = open_scan(path, "10 um")
    assert scan.is_memory_mapped
    np.testing.assert_array_equal(np.asarray(scan.voxels), voxels)


@pytest.mark.parametrize(
    ("name", "dtype"),
    [("core_64x48x40_16bit_le.raw", "<u2"), ("core_64x48x40_uint16.raw", "<u2"), ("64x48x40.raw", "<u2"),
     ("core_64x48x40_16-bit_big-endian.raw", ">u2"), ("core 64x48x40 ushort.bin", ">u2"),
     ("core_64x48x40_1x1x1_int16.raw", "<i2"), ("core_64x48x40_float32.raw", "<f4"),
     ("core_64x48x40_32bit_LE.vol", "<f4"), ("core_40x48x64_16bit_le.raw", "<u2"),
     ("40x48x64_float.raw", "<f4"), ("core_64X48X40_16bit_signed_msb.dat", ">i2")],
)  # fmt: skip
def test_names_that_describe(tmp_path: Path, volume: np.ndarray, name: str, dtype: str) -> None:
    voxels = (volume // 2 if "i" in dtype else volume).astype(dtype)
    opened(tmp_path / name, voxels, "40 slices of 48 rows of 64 voxels")


def test_one_byte_and_cubes_need_no_order(tmp_path: Path, rng: np.random.Generator) -> None:
    noise = rng.integers(0, 250, (12, 12, 12)).astype(np.uint8)
    opened(tmp_path / "bonsai_12x12x12_uint8.raw", noise, "uint8")
    opened(tmp_path / "bonsai_12x12x12.raw", noise, "uint8")
    opened(tmp_path / "bonsai_12x12x12_16bit_le.raw", noise.astype("<u2"), "uint16, little-endian")


@pytest.mark.parametrize(
    ("name", "says"),
    [("n_11x7x5_16bit.raw", r"order of its axes \(shape\) and of its bytes"),
     ("n_11x7x5_16bit_le.raw", r"order of its axes \(shape\):"), ("n_7x7x5.raw", "770 bytes, which is not"),
     ("n_11x7x6_uint16.raw", "not their length as uint16"), ("n_11x7x5_float32.raw", "as float32"),
     ("n_5x7x11_11x7x5_u16.raw", "can be meant as 11x7x5 of uint16 or 5x7x11"),
     ("n_11x7x5_int16_uint16.raw", "can be meant as"), ("n_11x7x5x1.raw", "describe itself"),
     ("n.raw", "describe itself")],
)  # fmt: skip
def test_names_that_could_be_meant_otherwise(
    tmp_path: Path, rng: np.random.Generator, name: str, says: str
) -> None:
    path = tmp_path / name
    path.write_bytes(rng.integers(0, 60_000, (5, 7, 11)).astype("<u2").tobytes())
    with pytest.raises(ScanError, match=rf"(?s){path.stem}.*{says}"):
        open_scan(path, "10 um")


@pytest.mark.parametrize("value", [0, 7, 65_535])
def test_voxels_that_show_nothing(tmp_path: Path, value: int) -> None:
    path = tmp_path / "n_64x48x40_16bit.raw"
    path.write_bytes(np.full((40, 48, 64), value, "<u2").tobytes())
    with pytest.raises(ScanError, match="nor the voxels say the order"):
        open_scan(path, "10 um")


def test_four_bytes_are_not_guessed_and_what_is_stated_goes_before(
    tmp_path: Path, volume: np.ndarray
) -> None:
    path = tmp_path / "core_64x48x40.raw"
    path.write_bytes(volume.astype("<i4").tobytes())
    with pytest.raises(ScanError, match="not their length as uint8, uint16"):
        open_scan(path, "10 um")
    with pytest.warns(ScanWarning, match="int32, little-endian"):
        scan = open_scan(path, "10 um", dtype="int32")
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)
    stated = open_scan(path, "10 um", shape=(80, 48, 64), dtype="uint16")
    assert stated.shape == (80, 48, 64)


def test_labels_by_their_name(tmp_path: Path) -> None:
    labels = np.zeros((40, 48, 64), np.uint8)
    labels[5:20, 5:20, 5:20], labels[22:38, 10:40, 30:60] = 1, 2
    path = tmp_path / "labels_64x48x40_8bit.raw"
    path.write_bytes(labels.tobytes())
    with pytest.warns(UserWarning, match="by its name alone"):
        grains = load_labels(path, voxel_size="10 um")
    np.testing.assert_array_equal(grains.labels, labels)
