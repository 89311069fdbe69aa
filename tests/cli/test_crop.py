"""``--crop`` and ``--bin`` on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile

from mbstudio.core.batch import memory_estimate
from mbstudio.core.project import Project


@pytest.mark.filterwarnings("always")
def test_segment_a_region(mbstudio, small_scan_file, tmp_path: Path) -> None:
    saved, labels = tmp_path / "part.mbs", tmp_path / "labels.nrrd"
    ran = mbstudio(
        "segment", small_scan_file, "--voxel-size", "14 um", "--crop", ":40,:,-56:36", "-o", saved,
        "--write-labels", labels, "--json",
    )  # fmt: skip
    assert ran.code == 0, ran.err
    result = json.loads(ran.out)
    assert result["part"] == "0:40, 0:56, 0:36 of 56 × 56 × 56"
    with Project.open(saved) as project:
        assert project.scan.shape == (40, 56, 36)
        assert project.grains.labels.shape == (40, 56, 36)
    # The labels lie on the whole scan where its region lay.
    ran = mbstudio("segment", small_scan_file, "--voxel-size", "14 um", "--labels", labels, "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["grains"] == result["grains"]


def test_bin_keeps_grains_where_they_are(mbstudio, small_scan_file, tmp_path: Path) -> None:
    saved = tmp_path / "part.mbs"
    ran = mbstudio(
        "segment", small_scan_file, "--voxel-size", "14 um", "--bin", "2", "--smallest", "50", "-o", saved
    )
    assert ran.code == 0, ran.err
    assert "28 µm" in ran.out
    assert "bin 2" in ran.out
    table = Project.open(saved).grains.table
    for centre in ((15, 15, 15), (16, 40, 38), (41, 38, 18)):
        away = np.linalg.norm(table[["x", "y", "z"]].to_numpy() - 14.0 * np.array(centre), axis=1)
        assert away.min() < 0.25 * 14


@pytest.mark.filterwarnings("always")
def test_bin_tells_what_it_leaves_out(mbstudio, small_scan_file) -> None:
    ran = mbstudio("segment", small_scan_file, "--voxel-size", "14 um", "--bin", "1,2,3")
    assert ran.code == 0
    assert "2 along x" in ran.err


def test_fit_and_sweep_take_a_region(mbstudio, small_scan_file, tmp_path: Path) -> None:
    saved, table = tmp_path / "part.mbs", tmp_path / "sweep.csv"
    common = ("--voxel-size", "14 um", "--crop", ":30,:30,:30")
    assert mbstudio("fit", small_scan_file, *common, "-n", "8", "-o", saved, "--workers", "0").code == 0
    with Project.open(saved) as project:
        assert project.scan.shape == (30, 30, 30)
        assert len(project.fits) == 1
    assert mbstudio("sweep", small_scan_file, *common, "-n", "6", "-o", table).code == 0
    assert len(table.read_text().splitlines()) == 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--crop", "10:10"), "empty along z"),
        (("--crop", ":,:,50:90"), "beyond the scan along x, which has 56 x 56 x 56 voxels"),
        (("--crop", "tall"), "cannot be read"),
        (("--bin", "57"), "larger than the 56 voxels"),
        (("--bin", "none"), "cannot be read"),
        (("--crop", "0:4", "--bin", "8"), "larger than the 4 voxels along z"),
    ],
)
def test_what_cannot_be_is_one_message(mbstudio, small_scan_file, options, said: str) -> None:
    ran = mbstudio("segment", small_scan_file, "--voxel-size", "14 um", *options)
    assert ran.code == 1
    assert said in ran.err
    assert len(ran.err.strip().splitlines()) == 1


def test_projects_and_meshes_have_no_region(mbstudio, fitted_project, tmp_path: Path) -> None:
    ran = mbstudio("segment", fitted_project, "--crop", "0:5")
    assert ran.code == 1
    assert "is a project" in ran.err
    (tmp_path / "stone.stl").write_text("solid\nendsolid\n")
    ran = mbstudio("fit", tmp_path / "stone.stl", "--unit", "mm", "--bin", "2")
    assert ran.code == 1
    assert "no scan" in ran.err


@pytest.mark.filterwarnings("always")
def test_labels_of_unbinned_voxels_are_refused(mbstudio, small_scan_file, tmp_path: Path) -> None:
    labels = np.zeros((56, 56, 56), np.uint8)
    labels[10:20, 10:20, 10:20] = 5
    labels[30:40, 10:20, 10:20] = 6
    tifffile.imwrite(tmp_path / "labels.tif", labels, photometric="minisblack")
    common = ("segment", small_scan_file, "--voxel-size", "14 um", "--labels", tmp_path / "labels.tif")
    ran = mbstudio(*common, "--bin", "2")
    assert ran.code == 1
    assert "before it was binned" in ran.err
    ran = mbstudio(*common, "--crop", "5:50", "--json")
    assert ran.code == 0
    assert json.loads(ran.out)["grains"] == 2


def test_what_the_memory_is_too_small_for_is_refused_unless_it_is_wanted(
    mbstudio, small_scan_file, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory_estimate, "free_memory", lambda: 222_000_000)
    common = ("segment", small_scan_file, "--voxel-size", "14 um", "--json")
    ran = mbstudio(*common)
    assert ran.code == 1
    assert "needs about 224 MB of memory, 222 MB are free" in ran.err
    assert "--crop" in ran.err
    assert "--anyway" in ran.err
    ran = mbstudio(*common, "--anyway")
    assert ran.code == 0
    assert "needs about 224 MB of memory, 222 MB are free." in ran.err
    assert json.loads(ran.out)["grains"] == 4
    # A part of it fits, and is no more than worth telling.
    ran = mbstudio(*common, "--crop", ":40,:40,:40")
    assert ran.code == 0
    assert "222 MB are free" in ran.err
    saved = tmp_path / "a.mbs"
    fit = ("fit", small_scan_file, "--voxel-size", "14 um", "-o", saved)
    assert mbstudio(*fit).code == 1
    assert not saved.exists()
    assert mbstudio("sweep", small_scan_file, "--voxel-size", "14 um", "-o", tmp_path / "s.csv").code == 1
    monkeypatch.setattr(memory_estimate, "free_memory", lambda: 10**10)
    ran = mbstudio(*common)
    assert ran.code == 0
    assert "memory" not in ran.err
