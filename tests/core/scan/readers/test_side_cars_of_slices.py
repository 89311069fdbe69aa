"""Slices take their voxel size from the description that a scanner left beside them, if it is theirs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from mbstudio.core.errors import ScanError, ScanWarning, UnitError
from mbstudio.core.scan import open_scan
from tests.core.scan.readers.test_side_cars import PCR, VGI, XTEK


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    for index, image in enumerate(rng.integers(0, 60_000, (5, 7, 11)).astype("<u2")):
        tifffile.imwrite(tmp_path / f"z{index}.tif", image, metadata=None)
    return tmp_path


@pytest.mark.parametrize(
    ("name", "text", "zyx"),
    [("a.xtekct", XTEK, (0.02, 0.01, 0.01)), ("a.vgi", VGI, (0.02, 0.01, 0.01)),
     ("a.pcr", PCR, (0.015, 0.015, 0.015)), ("A.XTEKCT", XTEK, (0.02, 0.01, 0.01)),
     ("a.pcr", PCR.replace("X=11", "X=5").replace("Z=5", "Z=11"), (0.015, 0.015, 0.015))],
)  # fmt: skip
def test_size_from_the_description(folder: Path, name: str, text: str, zyx: tuple[float, ...]) -> None:
    (folder / name).write_text(text)
    scan = open_scan(folder)
    assert scan.shape == (5, 7, 11)
    assert scan.voxel_size.to("mm").zyx == pytest.approx(zyx)
    assert scan.metadata["side-car"] == name


@pytest.mark.parametrize(
    ("text", "says"),
    [(XTEK.replace("VoxelsZ=5", "VoxelsZ=6"), r"of 6 x 7 x 11 voxels .* not taken"),
     (XTEK.replace("VoxelsX=11", "VoxelsX=5").replace("VoxelsZ=5", "VoxelsZ=11"), "not taken"),
     (XTEK.replace("VoxelsX=11", ""), "cannot be taken"),
     (XTEK.replace("Z=5", "Z=9") + "[XTekCT]\nProjections=5\nDetectorPixelsX=11\nDetectorPixelsY=7\n",
      "these images are projections")],
)  # fmt: skip
def test_descriptions_of_something_else_are_told(folder: Path, text: str, says: str) -> None:
    (folder / "a.xtekct").write_text(text)
    with pytest.warns(ScanWarning, match=says):
        open_scan(folder, "10 um")
    with pytest.raises(UnitError, match="does not contain the voxel size"):
        open_scan(folder)


def test_descriptions_must_agree(folder: Path) -> None:
    (folder / "a.vgi").write_text(VGI)
    (folder / "a.xtekct").write_text(XTEK)
    assert open_scan(folder).voxel_size.to("mm").x == pytest.approx(0.01)
    (folder / "b.xtekct").write_text(XTEK.replace("0.01", "0.03"))
    with pytest.raises(ScanError, match=r"a\.vgi and b\.xtekct, which give different voxel sizes"):
        open_scan(folder)
