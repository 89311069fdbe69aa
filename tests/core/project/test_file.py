from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
import textwrap
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

from mbstudio.core.errors import ProjectError
from mbstudio.core.grains.editing import LabelVolume
from mbstudio.core.grains.segmentation import SegmentationSettings
from mbstudio.core.grains.verdict import SegmentationVerdict
from mbstudio.core.imaging.fast.refine import RefineSettings
from mbstudio.core.project import ProjectState
from mbstudio.core.project.file import read_project, write_project
from mbstudio.core.sealing import seal_image


def assert_same(left, right, place="state"):
    """Compare two records field by field, whatever fields they come to have."""
    assert type(left) is type(right) or left is None or isinstance(left, int | float), place
    if isinstance(left, LabelVolume):
        left, right = left.whole(), right.whole()
    if is_dataclass(left):
        for field in fields(left):
            assert_same(getattr(left, field.name), getattr(right, field.name), f"{place}.{field.name}")
    elif isinstance(left, np.ndarray):
        assert left.dtype == right.dtype, place
        np.testing.assert_array_equal(left, right, err_msg=place)
    elif isinstance(left, pd.DataFrame):
        assert list(left.columns) == list(right.columns)
        assert left.to_dict("list") == right.to_dict("list")
    elif hasattr(left, "items"):
        assert list(left) == list(right), place
        for key in left:
            assert_same(left[key], right[key], f"{place}[{key}]")
    else:
        assert left == right, place


def test_every_field_comes_back(tmp_path, state):
    state = replace(state, segmentation=SegmentationSettings(splitting=0.31, threshold=1234.5))
    path = tmp_path / "sand.mbs"
    write_project(path, state)
    assert_same(state, read_project(path))


def test_the_verdict_on_the_grains_comes_back(tmp_path, state):
    verdict = SegmentationVerdict({"solidity": 0.71, "contrast_to_noise": 3.3}, 2, "the whole box")
    write_project(tmp_path / "a.mbs", replace(state, grains=replace(state.grains, verdict=verdict)))
    assert read_project(tmp_path / "a.mbs").grains.verdict == verdict


def test_a_verdict_by_other_rules_is_left_out(tmp_path, state, edit_project):
    verdict = SegmentationVerdict({"solidity": 0.71}, 2, "the whole box")
    write_project(tmp_path / "a.mbs", replace(state, grains=replace(state.grains, verdict=verdict)))
    with edit_project(tmp_path / "a.mbs") as file:
        record = {**json.loads(file["grains"].attrs["verdict"]), "rules": 1}
        file["grains"].attrs["verdict"] = json.dumps(record)
    assert read_project(tmp_path / "a.mbs").grains.verdict is None


def test_an_automatic_threshold_comes_back_as_none(tmp_path):
    state = ProjectState(segmentation=SegmentationSettings(threshold=None))
    write_project(tmp_path / "a.mbs", state)
    assert read_project(tmp_path / "a.mbs").segmentation == state.segmentation


def test_an_empty_project_comes_back(tmp_path):
    write_project(tmp_path / "empty.mbs", ProjectState())
    assert_same(ProjectState(), read_project(tmp_path / "empty.mbs"))


def test_names_of_files_may_hold_any_letters(tmp_path, state):
    path = tmp_path / "Körner 砂 п.mbs"
    write_project(path, state)
    assert_same(state, read_project(path))


def test_labels_are_compressed(tmp_path, state):
    labels = np.zeros((64, 64, 64), np.int32)
    labels[10:50, 10:50, 10:50] = 3
    write_project(
        tmp_path / "sand.mbs", replace(state, grains=replace(state.grains, label_volume=LabelVolume(labels)))
    )
    assert (tmp_path / "sand.mbs").stat().st_size < labels.nbytes / 10


def test_nothing_is_pickled(tmp_path, state):
    write_project(tmp_path / "sand.mbs", state)
    with h5py.File(tmp_path / "sand.mbs") as file:
        kinds = []
        file.visititems(lambda _, node: kinds.append(node.dtype) if isinstance(node, h5py.Dataset) else None)
    for kind in kinds:
        string = h5py.check_string_dtype(kind)
        assert kind.kind in "biuf" or string.encoding == "utf-8"


@pytest.mark.parametrize("part", [0.0, 0.1, 0.5, 0.9])
def test_a_file_cut_off_is_named(tmp_path, state, part):
    path = tmp_path / "sand.mbs"
    write_project(path, state)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * part)])
    with pytest.raises(ProjectError, match=r"sand\.mbs is .*damaged"):
        read_project(path)


def test_damaged_labels_are_noticed(tmp_path, state):
    path = tmp_path / "sand.mbs"
    write_project(path, state)
    with h5py.File(path) as file:
        place = file["grains/labels"].id.get_chunk_info(0)
    content = bytearray(path.read_bytes())
    content[place.byte_offset + place.size // 2] ^= 0xFF
    seal_image(content)
    path.write_bytes(content)
    with pytest.raises(ProjectError, match=r"sand\.mbs"):
        read_project(path)


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89HDF\r\n\x1a\n"])
def test_what_is_not_hdf5_is_named(tmp_path, content):
    path = tmp_path / "notes.mbs"
    path.write_bytes(content)
    with pytest.raises(ProjectError, match=r"notes\.mbs is not an mbstudio project"):
        read_project(path)


def test_another_programs_hdf5_is_named(tmp_path):
    with h5py.File(tmp_path / "other.mbs", "w") as file:
        file["x"] = [1]
    with pytest.raises(ProjectError, match=r"other\.mbs is an HDF5 file, but not an mbstudio project"):
        read_project(tmp_path / "other.mbs")


def test_a_newer_format_is_named(tmp_path, edit_project):
    path = tmp_path / "later.mbs"
    write_project(path, ProjectState())
    with edit_project(path) as file:
        file.attrs["schema"] = 99
        file.attrs["written_by"] = "mbstudio 7.0"
    with pytest.raises(ProjectError, match=r"later\.mbs was written by mbstudio 7\.0 in format 99.*update"):
        read_project(path)


@pytest.mark.parametrize("missing", ["fits/weights", "fits/centers_offsets", "fit_settings", "grains/labels"])
def test_a_missing_part_is_named(tmp_path, state, missing, edit_project):
    path = tmp_path / "sand.mbs"
    write_project(path, state)
    with edit_project(path) as file:
        del file[missing]
    with pytest.raises(ProjectError, match=r"sand\.mbs"):
        read_project(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ProjectError, match=r"nowhere\.mbs does not exist"):
        read_project(tmp_path / "nowhere.mbs")


def test_a_folder_is_no_project(tmp_path):
    with pytest.raises(ProjectError, match="is a folder"):
        write_project(tmp_path, ProjectState())


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(ProjectError, match=r"no.such.sand\.mbs cannot be saved"):
        write_project(tmp_path / "no" / "such" / "sand.mbs", ProjectState())
    assert list(tmp_path.iterdir()) == []


def fail_in(monkeypatch, step: str) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def raise_full(*_args, **_kwargs):
        raise full

    if step == "fsync":
        monkeypatch.setattr(os, "fsync", raise_full)
    else:
        monkeypatch.setattr(Path, "replace", raise_full)


@pytest.mark.parametrize("step", ["fsync", "rename"])
@pytest.mark.parametrize("there_before", [True, False])
def test_a_failure_at_any_step_leaves_what_was_there(tmp_path, state, monkeypatch, step, there_before):
    path = tmp_path / "sand.mbs"
    if there_before:
        write_project(path, ProjectState())
    before = {entry.name: entry.read_bytes() for entry in tmp_path.iterdir()}
    fail_in(monkeypatch, step)
    with pytest.raises(ProjectError, match=r"sand\.mbs cannot be saved \(No space left"):
        write_project(path, state)
    assert {entry.name: entry.read_bytes() for entry in tmp_path.iterdir()} == before


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits the size of files as Linux does")
@pytest.mark.parametrize("limit", [0, 512, 4096, 20_000, 60_000])
def test_a_disk_that_is_really_full(tmp_path, limit):
    """The kernel refuses writes beyond a limit, as a full disk does, wherever HDF5 happens to be."""
    path = tmp_path / "sand.mbs"
    path.write_bytes(b"saved before")
    script = textwrap.dedent(f"""
        import resource, signal, sys
        from pathlib import Path
        import numpy as np, pandas as pd
        from mbstudio.core.errors import ProjectError
        from mbstudio.core.grains.grain_set import GrainSet
        from mbstudio.core.project import ProjectState
        from mbstudio.core.project.file import write_project
        from mbstudio.core.units import VoxelSize
        labels = np.random.default_rng(0).integers(0, 2**30, (32, 32, 32), dtype=np.int32)
        grains = GrainSet(labels, pd.DataFrame({{"label": [1]}}), VoxelSize(1, 1, 1, "um"))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
        try:
            write_project(Path({str(path)!r}), ProjectState(grains=grains))
        except ProjectError as error:
            print("ProjectError", error)
    """)
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "ProjectError" in run.stdout
    assert "sand.mbs cannot be saved" in run.stdout
    assert path.read_bytes() == b"saved before"
    assert [entry.name for entry in tmp_path.iterdir()] == ["sand.mbs"]


def test_a_read_only_folder(read_only_folder):
    with pytest.raises(ProjectError, match=r"sand\.mbs cannot be saved"):
        write_project(read_only_folder / "sand.mbs", ProjectState())


@pytest.mark.skipif(os.name == "nt", reason="Windows has no permission bits")
def test_permissions_and_links_stay(tmp_path):
    target = tmp_path / "real.mbs"
    write_project(target, ProjectState())
    target.chmod(0o640)
    link = tmp_path / "link.mbs"
    link.symlink_to(target)
    write_project(link, ProjectState(fit_settings=replace(ProjectState().fit_settings, n=3)))
    assert link.is_symlink()
    assert target.stat().st_mode & 0o777 == 0o640
    assert read_project(target).fit_settings.n == 3


def test_a_reader_never_sees_a_half_written_file(tmp_path, state, monkeypatch):
    """The file keeps its old content until the new one lies on the disk."""
    path = tmp_path / "sand.mbs"
    write_project(path, ProjectState())
    seen = []
    flush = os.fsync

    def look(handle):
        flush(handle)
        seen.append(len(read_project(path).fits))

    monkeypatch.setattr(os, "fsync", look)
    write_project(path, state)
    assert seen[0] == 0
    assert len(read_project(path).fits) == 2


def test_fits_of_a_file_from_before_necks_were_measured_can_be_read(tmp_path, state, edit_project):
    path = tmp_path / "old.mbs"
    write_project(path, state)
    with edit_project(path) as file:
        del file["fits/smallest_neck"]
    fits = read_project(path).fits
    assert [fit.verdict.smallest_neck for fit in fits.values()] == [None, None]
    assert fits[2].verdict == replace(state.fits[2].verdict, smallest_neck=None)


def test_files_of_before_the_options_have_none(tmp_path, state, edit_project):
    path = tmp_path / "old.mbs"
    write_project(path, state)
    with edit_project(path) as file:
        del file["fits/options"]
        del file["fit_settings"].attrs["options"]
    old = read_project(path)
    assert old.fit_settings == replace(state.fit_settings, options={})
    assert [dict(fit.options) for fit in old.fits.values()] == [{}, {}]


def test_constants_of_the_fast_search_are_written_as_a_record(tmp_path, state):
    changed = replace(state.fits[2], options={"refine": RefineSettings(noise=0.5)})
    write_project(tmp_path / "sand.mbs", state.with_fits({2: changed}))
    assert read_project(tmp_path / "sand.mbs").fits[2].options["refine"]["noise"] == 0.5


def test_a_file_from_before_targets(tmp_path, state, edit_project):
    path = tmp_path / "old.mbs"
    write_project(path, state)
    with edit_project(path) as file:
        del file["fits/target"]
        del file["fits/reached"]
        del file["fit_settings"].attrs["target"]
    old = read_project(path)
    assert [(fit.target, dict(fit.reached)) for fit in old.fits.values()] == [("", {}), ("", {})]
    assert old.fit_settings == replace(state.fit_settings, target="")
