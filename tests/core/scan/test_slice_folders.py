"""Folders of slices: gaps, two series, strays and signs are found by the names."""

from __future__ import annotations

from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
import tifffile

from mbstudio.core.errors import ScanError, ScanWarning
from mbstudio.core.scan import open_scan


def write(folder: Path, names: list[str], shape: tuple[int, int] = (5, 6)) -> None:
    folder.mkdir(exist_ok=True)
    for number, name in enumerate(names):
        iio.imwrite(folder / name, np.full(shape, number, np.uint8))


def order(folder: Path) -> list[int]:
    return [int(image[0, 0]) for image in np.asarray(open_scan(folder, "10 um").voxels)]


@pytest.mark.parametrize(
    "names",
    [[f"slice-{n:03d}.png" for n in (5, 6, 7)], [f"z_{n}.png" for n in (-11, -10, -9)],
     [f"z_{n}.png" for n in (-1, 0, 1)], [f"z{n}.png" for n in (-1, 0, 1)],
     [f"-{n}.png" for n in (12, 11, 10)],
     [f"2024-11-{n}_scan.png" for n in (9, 10, 11)], [f"h_{n:.1f}.png" for n in (9.5, 10.0, 10.5)],
     [f"{n}.png" for n in (8, 9, 10)], [f"s_{n}_t{100 + 7 * n}.png" for n in (1, 2, 3)],
     [f"img_{n:02d}.bmp" for n in (1, 2, 3)]],
)  # fmt: skip
def test_the_number_that_counts_is_found(tmp_path: Path, names: list[str]) -> None:
    write(tmp_path / "s", names)
    assert order(tmp_path / "s") == [0, 1, 2]


@pytest.mark.parametrize(
    ("names", "says"),
    [([f"r_{n:04d}.png" for n in range(20) if n not in (7, 8)],
      r"between r_0006\.png and r_0009\.png \(2 missing\)"),
     ([f"r_{n:04d}.png" for n in range(0, 40, 2) if n != 10], r"r_0008\.png and r_0012\.png"),
     ([f"r_{n}.png" for n in (-3, -2, 0, 1)], r"r_-2\.png and r_0\.png"),
     ([f"{s}_{n}.png" for s in "ab" for n in range(6)], "2 kinds of names"),
     ([f"scan{s}_{n:03d}.png" for s in (1, 2) for n in range(6)], "series of slices"),
     ([f"r_{n}.png" for n in range(9)] + ["r_3 copy.png"], r"r_3 copy\.png"),
     (["r_1.png", "r_01.png", "r_2.png"], "two slices with the same number"),
     ([f"r_{n}.png" for n in range(9)] + ["mean.png"], r"mean\.png among slices")],
)  # fmt: skip
def test_what_is_wrong_with_a_folder_is_named(tmp_path: Path, names: list[str], says: str) -> None:
    write(tmp_path / "s", names)
    with pytest.raises(ScanError, match=says):
        open_scan(tmp_path / "s", "10 um")


def test_strays_of_another_size_are_left_out_and_told(tmp_path: Path) -> None:
    write(tmp_path / "s", [f"r_{n}.png" for n in range(9)])
    write(tmp_path / "s", ["preview.png"], (3, 3))
    with pytest.warns(ScanWarning, match=r"left out: preview\.png"):
        assert order(tmp_path / "s") == list(range(9))


def test_every_second_slice_is_told(tmp_path: Path) -> None:
    write(tmp_path / "s", [f"r_{n:03d}.png" for n in range(0, 20, 2)])
    with pytest.warns(ScanWarning, match="in steps of 2"):
        assert order(tmp_path / "s") == list(range(10))


def test_slices_without_numbers_are_told(tmp_path: Path) -> None:
    write(tmp_path / "s", ["front.png", "middle.png", "rear.png"])
    with pytest.warns(ScanWarning, match="without numbers"):
        assert order(tmp_path / "s") == [0, 1, 2]


def test_one_slice_of_another_size_or_type(tmp_path: Path) -> None:
    write(tmp_path / "s", [f"r_{n}.png" for n in range(9)])
    iio.imwrite(tmp_path / "s" / "r_4.png", np.zeros((5, 7), np.uint8))
    with pytest.raises(ScanError, match=r"r_4\.png has 5 x 7 pixels"):
        open_scan(tmp_path / "s", "10 um")
    iio.imwrite(tmp_path / "s" / "r_4.png", np.zeros((5, 6), np.uint16))
    with pytest.raises(ScanError, match=r"pixels of the slice .*r_4\.png .* differ from"):
        open_scan(tmp_path / "s", "10 um")


def test_a_stack_among_slices(tmp_path: Path) -> None:
    for n in range(3):
        tifffile.imwrite(tmp_path / f"r_{n}.tif", np.zeros((5, 6, 7) if n == 0 else (6, 7), np.uint8))
    with pytest.raises(ScanError, match=r"r_0\.tif holds 5 images"):
        open_scan(tmp_path, "10 um")


LOG = "[System]\nScanner=SkyScan1172\n[Acquisition]\nImage Pixel Size ({unit})={pixel}\n"


@pytest.mark.parametrize(
    ("log", "edge"),
    [((LOG + "[Reconstruction]\nPixel Size ({unit})=12.5\n").format(unit="um", pixel=13), 12.5),
     ((LOG + "[Reconstruction]\nProgram=NRecon\n").format(unit="µm", pixel="13,25"), 13.25)],
)  # fmt: skip
@pytest.mark.parametrize("codec", ["utf-8", "latin-1", "utf-16"])
def test_skyscan_logs(tmp_path: Path, log: str, edge: float, codec: str) -> None:
    write(tmp_path / "s", [f"sand_rec{n:08d}.bmp" for n in range(5)])
    write(tmp_path / "s", ["sand_rec_spr.bmp"], (2, 6))
    (tmp_path / "s" / "sand_rec.log").write_bytes(log.encode(codec))
    with pytest.warns(ScanWarning, match="sand_rec_spr"):
        size = open_scan(tmp_path / "s").voxel_size
    assert size.to("um").zyx == pytest.approx((edge,) * 3)


def test_a_log_of_an_acquisition_is_told_and_two_are_refused(tmp_path: Path) -> None:
    write(tmp_path, [f"sand{n:08d}.bmp" for n in range(5)])
    (tmp_path / "sand.log").write_text(LOG.format(unit="um", pixel=13))
    with pytest.warns(ScanWarning, match="projections"):
        open_scan(tmp_path)
    (tmp_path / "sand0.log").write_text(LOG.format(unit="um", pixel=14))
    with pytest.raises(ScanError, match="different pixel sizes"):
        open_scan(tmp_path)
