from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
import tifffile

from mbstudio.core.errors import ProjectError, ScanError
from mbstudio.core.project import FitSettings, Project
from mbstudio.core.project.scan_reference import refer_to
from mbstudio.core.scan import Scan, open_scan, voxel_digest


def test_a_new_project_knows_its_scan(scan):
    project = Project.new(scan)
    assert project.state.scan.digest == voxel_digest(scan)
    assert project.scan.voxel_size == scan.voxel_size
    assert project.is_modified
    assert not project.history.can_undo


def test_save_and_open_again(tmp_path, scan, state):
    project = Project.new(scan)
    project.change("Find grains", grains=state.grains)
    project.add_fits(state.fits)
    project.save(tmp_path / "sand.mbs")
    assert not project.is_modified

    with Project.open(tmp_path / "sand.mbs") as opened:
        assert not opened.is_modified
        np.testing.assert_array_equal(opened.scan.load(), scan.load())
        assert opened.scan.path == scan.path.resolve()
        assert [avatar.label for avatar in opened.avatars] == [2, 7]
        assert len(opened.grains) == 2
        assert set(opened.fits) == {2, 7}


def test_the_file_holds_no_voxels_unless_asked(tmp_path, rng):
    path = tmp_path / "scan.tif"
    voxels = rng.integers(0, 60000, (20, 50, 60), dtype=np.uint16)
    tifffile.imwrite(path, voxels, photometric="minisblack")
    project = Project.new(open_scan(path, "3 um"))
    bare = project.save(tmp_path / "bare.mbs").stat().st_size
    whole = project.save(tmp_path / "whole.mbs", embed_scan=True).stat().st_size
    assert bare < 60_000 < voxels.nbytes < whole

    path.unlink()
    opened = Project.open(tmp_path / "whole.mbs")
    np.testing.assert_array_equal(opened.scan.load(), voxels)
    assert opened.scan.voxel_size == project.scan.voxel_size


def test_a_scan_of_no_file_is_always_embedded(tmp_path, rng, scan):
    voxels = rng.normal(size=(3, 4, 5)).astype(np.float32)
    project = Project.new(Scan(voxels, scan.voxel_size, (1.0, 2.0, 3.0)))
    project.save(tmp_path / "made.mbs", embed_scan=False)
    opened = Project.open(tmp_path / "made.mbs")
    np.testing.assert_array_equal(opened.scan.load(), voxels)
    assert opened.scan.origin == (1.0, 2.0, 3.0)
    assert opened.scan.path is None


def test_an_embedded_scan_survives_saving_again(tmp_path, scan):
    Project.new(scan, embed_scan=True).save(tmp_path / "a.mbs")
    voxels = np.array(scan.load())
    scan.path.unlink()
    opened = Project.open(tmp_path / "a.mbs")
    opened.change("Other fit", fit_settings=FitSettings(n=7))
    opened.save()
    opened.save(tmp_path / "b.mbs")
    for name in ("a.mbs", "b.mbs"):
        np.testing.assert_array_equal(Project.open(tmp_path / name).scan.load(), voxels)


def test_a_project_opens_without_its_scan(tmp_path, scan, state):
    project = Project.new(scan)
    project.change("Find grains", grains=state.grains)
    project.save(tmp_path / "sand.mbs")
    voxels = np.array(scan.load())
    elsewhere = tmp_path / "archive" / "renamed.tif"
    elsewhere.parent.mkdir()
    shutil.move(scan.path, elsewhere)

    opened = Project.open(tmp_path / "sand.mbs")
    assert len(opened.grains) == 2
    with pytest.raises(ScanError, match=r"scan\.tif does not exist.*relocate_scan"):
        _ = opened.scan
    opened.relocate_scan(elsewhere)
    np.testing.assert_array_equal(opened.scan.load(), voxels)
    opened.save()
    np.testing.assert_array_equal(Project.open(tmp_path / "sand.mbs").scan.load(), voxels)


def test_a_project_moved_with_its_scan_finds_it(tmp_path, scan):
    folder = tmp_path / "job"
    folder.mkdir()
    shutil.move(scan.path, folder / "scan.tif")
    Project.new(open_scan(folder / "scan.tif", scan.voxel_size)).save(folder / "sand.mbs")
    folder.rename(tmp_path / "moved")
    opened = Project.open(tmp_path / "moved" / "sand.mbs")
    assert opened.scan.path == (tmp_path / "moved" / "scan.tif").resolve()


def test_other_voxels_are_noticed(tmp_path, scan):
    Project.new(scan).save(tmp_path / "sand.mbs")
    voxels = np.array(scan.load())
    voxels[2, 3, 4] ^= 1
    tifffile.imwrite(scan.path, voxels, photometric="minisblack")
    with pytest.raises(ScanError, match=r"scan\.tif is not the scan.*relocate_scan"):
        _ = Project.open(tmp_path / "sand.mbs").scan


def test_a_damaged_scan_is_named(tmp_path, scan):
    Project.new(scan).save(tmp_path / "sand.mbs")
    scan.path.write_bytes(scan.path.read_bytes()[:60])
    with pytest.raises(ScanError, match=r"scan\.tif"):
        _ = Project.open(tmp_path / "sand.mbs").scan


def test_relocating_to_another_scan_changes_nothing(tmp_path, scan):
    project = Project.new(scan)
    other = tmp_path / "other.tif"
    tifffile.imwrite(other, np.zeros((4, 5, 6), np.uint16), photometric="minisblack")
    before = project.state
    with pytest.raises(ScanError, match=r"other\.tif is not the scan"):
        project.relocate_scan(other)
    assert project.state is before


def test_relocating_without_a_scan_is_an_error(scan):
    with pytest.raises(ProjectError, match="no scan"):
        Project.new().relocate_scan(scan.path)


@pytest.mark.parametrize("dtype", ["<u2", ">u2"])
def test_a_raw_scan_is_found_again(tmp_path, rng, dtype):
    path = tmp_path / "scan.raw"
    voxels = rng.integers(0, 60000, (3, 4, 5)).astype(dtype)
    path.write_bytes(b"7 bytes" + voxels.tobytes())
    scan = open_scan(path, "2 um", shape=(3, 4, 5), dtype="u2", header_bytes=7, big_endian=dtype == ">u2")
    Project.new(scan).save(tmp_path / "sand.mbs")
    np.testing.assert_array_equal(Project.open(tmp_path / "sand.mbs").scan.load(), voxels)


def test_the_digest_is_the_same_for_every_format(tmp_path, scan):
    np.save(tmp_path / "scan.npy", scan.load())
    again = open_scan(tmp_path / "scan.npy", scan.voxel_size)
    assert refer_to(again).digest == refer_to(scan).digest


def test_undo_redo_and_the_signal(scan):
    project = Project.new(scan)
    seen = []
    project.changed.connect(seen.append)
    first = project.state
    second = project.change("Other fit", fit_settings=FitSettings(n=7))
    assert project.undo() is first
    assert project.redo() is second
    assert seen == [second, first, second]
    assert project.history.titles == ["Other fit"]


def test_another_scan_begins_anew_and_can_be_undone(tmp_path, scan, state):
    project = Project.new(scan)
    project.change("Find grains", grains=state.grains)
    project.add_fits(state.fits)
    other = Scan(np.ones((2, 2, 2), np.uint8), scan.voxel_size)
    project.use_scan(other)
    assert project.grains is None
    assert not project.fits
    assert project.scan.shape == (2, 2, 2)
    project.undo()
    assert project.scan.shape == scan.shape
    assert len(project.fits) == 2


def test_a_project_without_a_file_asks_for_one(scan):
    with pytest.raises(ProjectError, match="no file yet"):
        Project.new(scan).save()


def test_a_failed_save_keeps_the_project_modified(tmp_path, scan):
    project = Project.new(scan)
    project.save(tmp_path / "sand.mbs")
    project.change("Other fit", fit_settings=FitSettings(n=7))
    with pytest.raises(ProjectError):
        project.save(tmp_path / "missing" / "sand.mbs")
    assert project.is_modified
    assert project.path == tmp_path / "sand.mbs"


def test_an_empty_project_has_nothing():
    project = Project.new()
    assert project.scan is None
    assert project.grains is None
    assert project.avatars == []
    assert not project.is_modified


def test_a_change_of_one_record_leaves_the_others(scan, state):
    project = Project.new(scan)
    project.change("Find grains", grains=state.grains)
    settings = replace(project.state.fit_settings, seed=9)
    assert project.change("Seed", fit_settings=settings).grains is state.grains
