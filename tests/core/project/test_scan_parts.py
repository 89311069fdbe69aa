"""A project remembers which part of its file the scan is, and opens the same again."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile

from mbstudio.core.errors import ProjectError, ScanError
from mbstudio.core.grains import segment
from mbstudio.core.project import Project
from mbstudio.core.scan import open_scan
from mbstudio.core.scan.excerpt import Excerpt
from mbstudio.core.units import VoxelSize

SIZE = VoxelSize(20, 14, 14, "um")


@pytest.fixture
def voxels(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 60000, (9, 11, 13), dtype=np.uint16)


def write(folder: Path, kind: str, voxels: np.ndarray) -> tuple[Path, dict]:
    path = folder / f"scan.{kind}"
    if kind == "tif":
        tifffile.imwrite(path, voxels, photometric="minisblack")
        return path, {}
    if kind == "npy":
        np.save(path, voxels)
        return path, {}
    path.write_bytes(b"header!" + voxels.astype(">u2").tobytes())
    return path, {"shape": voxels.shape, "dtype": "uint16", "header_bytes": 7, "big_endian": True}


@pytest.mark.parametrize("kind", ["tif", "npy", "raw"])
@pytest.mark.parametrize(
    ("crop", "binning"), [("2:8,:,-9:", None), ("1:7", None), (None, (2, 1, 3)), ("1:,1:,1:", 2)]
)
@pytest.mark.parametrize("embed", [False, True])
@pytest.mark.filterwarnings("ignore:.*leaves the last ones out")
def test_a_part_is_opened_again(
    tmp_path: Path, voxels: np.ndarray, kind: str, crop: str | None, binning: object, embed: bool
) -> None:
    path, layout = write(tmp_path, kind, voxels)
    scan = open_scan(path, SIZE, crop=crop, binning=binning, **layout)
    Project.new(scan, embed_scan=embed).save(tmp_path / "project.mbs")
    with Project.open(tmp_path / "project.mbs") as project:
        again = project.scan
        reference = project.state.scan
    np.testing.assert_array_equal(np.asarray(again.voxels), np.asarray(scan.voxels))
    assert again.excerpt == scan.excerpt == reference.excerpt
    assert (again.voxel_size, again.origin) == (scan.voxel_size, scan.origin)
    assert (reference.shape, reference.dtype) == (scan.shape, "uint16")


def test_a_part_that_moved_is_found_and_another_file_is_not_taken_for_it(
    tmp_path: Path, voxels: np.ndarray
) -> None:
    path, _ = write(tmp_path, "tif", voxels)
    Project.new(open_scan(path, SIZE, crop="2:8")).save(tmp_path / "project.mbs")
    path.rename(tmp_path / "moved.tif")
    project = Project.open(tmp_path / "project.mbs")
    with pytest.raises(ScanError, match="does not exist"):
        project.scan
    assert project.relocate_scan(tmp_path / "moved.tif").shape == (6, 11, 13)
    # The format of the file does not matter, nor where in it the voxels begin.
    np.save(tmp_path / "scan.npy", voxels)
    assert project.relocate_scan(tmp_path / "scan.npy").shape == (6, 11, 13)
    # Its very voxels as a file of their own are another scan.
    tifffile.imwrite(tmp_path / "other.tif", voxels[2:8], photometric="minisblack")
    with pytest.raises(ScanError, match="reaches beyond the scan"):
        project.relocate_scan(tmp_path / "other.tif")
    tifffile.imwrite(tmp_path / "larger.tif", np.concatenate([voxels, voxels]), photometric="minisblack")
    with pytest.raises(ScanError, match="not the scan that the project was made with"):
        project.relocate_scan(tmp_path / "larger.tif")


def test_only_projects_of_parts_are_kept_from_older_versions(tmp_path: Path, voxels: np.ndarray) -> None:
    path, _ = write(tmp_path, "npy", voxels)
    scan = open_scan(path, SIZE)
    for part, schema in ((scan, 1), (scan.cropped("2:"), 4), (scan.binned("3,1,1"), 4)):
        saved = Project.new(part).save(tmp_path / "project.mbs")
        with h5py.File(saved) as file:
            assert file.attrs["schema"] == schema


def test_a_damaged_record_of_the_part_is_refused(tmp_path: Path, voxels: np.ndarray, edit_project) -> None:
    path, _ = write(tmp_path, "npy", voxels)
    saved = Project.new(open_scan(path, SIZE, crop="2:8")).save(tmp_path / "project.mbs")
    for name, value in (("stop_zyx", (9, 11, 13)), ("bin_zyx", (0, 1, 1)), ("start_zyx", (-1, 0, 0))):
        with edit_project(saved) as file:
            before = file["scan"].attrs[name]
            file["scan"].attrs[name] = value
        with pytest.raises(ProjectError, match="damaged"):
            Project.open(saved)
        with edit_project(saved) as file:
            file["scan"].attrs[name] = before
    assert Project.open(saved).state.scan.excerpt == Excerpt((9, 11, 13), (2, 0, 0), (8, 11, 13))


def test_parts_of_one_digest_are_told_apart(tmp_path: Path) -> None:
    """Undo of a crop whose voxels are those of another brings that one back."""
    voxels = np.tile(np.arange(4, dtype=np.uint8), (6, 5, 1))
    np.save(tmp_path / "scan.npy", voxels)
    first, second = (open_scan(tmp_path / "scan.npy", SIZE, crop=crop) for crop in ("0:2", "3:5"))
    project = Project.new(first)
    project.use_scan(second)
    assert project.scan.excerpt == second.excerpt
    project.undo()
    assert project.scan.excerpt == first.excerpt
    assert project.scan.origin == (0, 0, 0)


def test_grains_of_a_part_are_saved_where_they_lie(tmp_path: Path, small_scan_file: Path) -> None:
    scan = open_scan(small_scan_file, "14 um", crop="20:,22:,:36")
    project = Project.new(scan)
    project.change("Find grains", grains=segment(scan))
    project.save(tmp_path / "project.mbs")
    again = Project.open(tmp_path / "project.mbs").grains
    whole = segment(open_scan(small_scan_file, "14 um"))
    inside, all_of_it = (grains.table.loc[~grains.table["touches_border"]] for grains in (again, whole))
    assert len(inside) == 1
    place = inside[["x", "y", "z"]].to_numpy()[0]
    assert np.abs(all_of_it[["x", "y", "z"]].to_numpy() - place).max(axis=1).min() < 0.5
