"""``mbstudio edit`` corrects grains by hand and keeps what it did."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import tifffile

from mbstudio.cli.fit import choose_labels
from mbstudio.core.grains.editing.records import Grow
from mbstudio.core.project import FitSettings, Project, ProjectState
from tests.core.grains.editing.placed_grains import placed_grains, scan_of
from tests.core.project.conftest import make_fit


@pytest.fixture
def path(tmp_path, rng):
    """A project of four grains with an avatar each."""
    project = Project.new(scan_of(placed_grains().labels), embed_scan=True)
    project.change("Find grains", grains=placed_grains())
    project.add_fits({label: make_fit(label, 4, rng) for label in (1, 2, 3, 4)})
    return project.save(tmp_path / "sand.mbs")


def edited(mbstudio, path, *options):
    ran = mbstudio("edit", path, *options, "--json")
    assert ran.code == 0, ran.err
    return json.loads(ran.out)


def test_edits_are_made_in_the_order_of_the_options(mbstudio, path):
    result = edited(
        mbstudio, path, "--merge", "1,2", "--split", "3@25,33,20;25,33,34", "--exclude", "4",
        "--merge", "3,5", "--delete", "4",
    )  # fmt: skip
    assert [edit["kind"] for edit in result["edits"]] == ["merge", "split", "exclude", "merge", "delete"]
    assert (result["grains"], result["interior"], result["excluded"], result["made"]) == (2, 2, 0, 5)
    assert result["changed_since_fitted"] == [1, 3]
    project = Project.open(path)
    assert project.grains.table["label"].tolist() == [1, 3]
    assert set(project.fits) == {1, 3}
    assert np.array_equal(project.grains.labels == 3, placed_grains().labels == 3)


def test_every_option_makes_its_edit(mbstudio, path, tmp_path):
    labels = tmp_path / "labels.tif"
    result = edited(
        mbstudio, path, "--split-along", "3@0,33,26.5;0,34,26.5", "--grow", "1", "--shrink", "2@2",
        "--smooth", "3@1.5", "--paint", "new@4@5,40,10;5,40,14", "--erase", "all@3@12,12,14",
        "--fill-holes", "1", "--erase", "2@2@12,12,31", "--delete", "4", "--new-grain", "22,24,68@150",
        "--include", "1", "--write-labels", labels,
    )  # fmt: skip
    assert [edit["kind"] for edit in result["edits"]] == [
        "split along", "grow", "shrink", "smooth", "paint", "erase", "fill holes", "erase", "delete",
        "new grain", "include",
    ]  # fmt: skip
    grains = Project.open(path).grains
    assert np.array_equal(tifffile.imread(labels), grains.labels)
    assert [edit.kind for edit in grains.edits] == [edit["kind"] for edit in result["edits"]]
    assert grains.edits[2].by == 2


def test_merging_apart_and_splitting_by_shape(mbstudio, path):
    ran = mbstudio("edit", path, "--merge", "1,3")
    assert ran.code == 1
    assert "Grains 1 and 3 do not touch" in ran.err
    ran = mbstudio("edit", path, "--merge", "1,3", "--apart", "--split", "2@12,12,31;12,12,33", "--by-shape")
    assert "lie in one basin" in ran.err
    assert Project.open(path).grains.edits == ()  # nothing was saved
    ran = mbstudio("edit", path, "--merge", "1,3", "--apart")
    assert "A gap was closed" in ran.err
    assert "grains" in ran.out


def test_another_project_is_written(mbstudio, path, tmp_path):
    before = path.read_bytes()
    edited(mbstudio, path, "--delete", "4", "-o", tmp_path / "other.mbs")
    assert path.read_bytes() == before
    assert len(Project.open(tmp_path / "other.mbs").grains) == 3


def test_edits_are_made_again_on_another_project(mbstudio, path, tmp_path):
    other = tmp_path / "other.mbs"
    shutil.copy(path, other)
    edited(mbstudio, other, "--delete", "4")
    edited(mbstudio, path, "--merge", "1,2", "--exclude", "4")
    result = edited(mbstudio, other, "--replay", path)
    assert [edit["kind"] for edit in result["edits"]] == ["merge"]
    assert "there is no grain at" in result["left_out"][0]["reason"]
    ran = mbstudio("edit", other, "--replay", path)
    assert "left out: Merge grains 1, 2: what were several grains is grain 1 alone here" in ran.err
    Project(ProjectState(grains=placed_grains())).save(tmp_path / "never.mbs")
    assert "holds no edits" in mbstudio("edit", other, "--replay", tmp_path / "never.mbs").err


def test_without_an_edit_they_are_listed(mbstudio, path):
    edited(mbstudio, path, "--merge", "1,2", "--exclude", "4")
    before = path.read_bytes()
    ran = mbstudio("edit", path)
    assert "2 edits by hand" in ran.out
    assert "Exclude grains 4" in ran.out
    assert [edit["kind"] for edit in edited(mbstudio, path)["edits"]] == ["merge", "exclude"]
    assert path.read_bytes() == before


def test_the_most_suspicious_grains_are_listed(mbstudio, path):
    before = path.read_bytes()
    found = json.loads(mbstudio("edit", path, "--suspicious", 2, "--json").out)["suspicious"]
    assert found[0]["label"] == 3
    assert len(found) == 2
    assert found[0]["kind"] == "merged"
    ran = mbstudio("edit", path, "--suspicious", 2)
    assert "a neck" in ran.out
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--merge", "a,b"], "--merge 'a,b' cannot be read"),
        (["--split", "5"], "write it as LABEL@PLACES"),
        (["--split", "3@1,2"], "are no places"),
        (["--split", "3@1.5,2,3;4,5,6"], "is no voxel"),
        (["--paint", "1@2"], "write it as LABEL@RADIUS@PLACES"),
        (["--paint", "1@wide@1,2,3"], "'wide' is no number"),
        (["--axis", "w", "--grow", "1"], "--axis 'w' is not known"),
        (["--delete", "9"], "There is no grain 9"),
        (["--delete", "1-4"], "no grain would be left"),
        (["--grow", "1", "--write-labels", "labels.xyz"], "labels.xyz"),
    ],
)
def test_what_cannot_be_done_is_one_message(mbstudio, path, options, told):
    ran = mbstudio("edit", path, *options)
    assert ran.code == 1
    assert told in ran.err
    assert Project.open(path).grains.edits == ()


def test_a_scan_is_no_project(mbstudio, small_scan_file):
    ran = mbstudio("edit", small_scan_file, "--grow", "1")
    assert ran.code == 1
    assert "is not a project" in ran.err


def test_commands_obey_what_is_excluded(mbstudio, path, tmp_path):
    edited(mbstudio, path, "--exclude", "2")
    for command in (
        ["measure", path, "--grains", "2"],
        ["fit", path, "--grains", "2"],
        ["export", path, "--to", "metaball", "-o", tmp_path / "a", "--select", "2"],
    ):
        ran = mbstudio(*command)
        assert ran.code in (1, 2), command
        assert "grain 2 is excluded by hand" in ran.err, command
    project = Project.open(path)
    assert [avatar.label for avatar in project.avatars] == [1, 3, 4]


def test_changed_grains_are_fitted_again_on_demand(path):
    project = Project.open(path)
    done = project.fits[1]
    project.add_fits({label: replace(fit, options=done.options) for label, fit in project.fits.items()})
    project.change("Settings", fit_settings=FitSettings(4 + 1, done.method, 17, done.options, done.target))
    assert choose_labels(project, None, None, False) == []
    project.edit_grains(Grow(labels=(3,)))
    assert choose_labels(project, None, None, False) == [3]


def test_the_voxel_size_is_corrected(mbstudio, path):
    result = edited(mbstudio, path, "--correct-voxel-size", "4 um")
    assert (result["voxel_size_before"], result["voxel_size"], result["factor"]) == ("2 µm", "4 µm", 2.0)
    with Project.open(path) as project:
        assert project.grains.voxel_size.zyx == (4.0, 4.0, 4.0)
        assert project.state.scan.voxel_size.zyx == (4.0, 4.0, 4.0)
    ran = mbstudio("edit", path, "--correct-voxel-size", "4 um")
    assert ran.code == 1
    assert "is 4 µm already" in ran.err
