"""Corrections by hand in a project: recorded, undone bit by bit, kept in its file, made again."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from types import MappingProxyType

import h5py
import numpy as np
import pytest

from mbstudio.core.errors import EditError, GrainWarning, ProjectError
from mbstudio.core.grains import FieldOfView
from mbstudio.core.grains.editing.records import Delete, Exclude, Grow, Include, Merge, NewGrain, Paint, Split
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.project.file import read_project, write_project
from mbstudio.core.project.merging import merge_states
from mbstudio.core.scan import Scan
from tests.core.grains.editing.placed_grains import ORIGIN, SIZE, placed_grains, scan_of
from tests.core.grains.editing.test_edits import random_edit
from tests.core.project.conftest import make_fit
from tests.core.project.test_file import assert_same


@pytest.fixture
def project(rng) -> Project:
    """A project with a scan, four grains and an avatar of each."""
    project = Project.new(scan_of(placed_grains().labels), embed_scan=True)
    project.change("Find grains", grains=placed_grains())
    project.add_fits({label: make_fit(label, 4, rng) for label in (1, 2, 3, 4)})
    return project


def test_what_is_untouched_keeps_its_avatar_and_what_changed_is_marked(project):
    fits = dict(project.fits)
    outcome = project.edit_grains(Merge(labels=(1, 2)))
    assert outcome.gone == {2}
    assert set(project.fits) == {1, 3, 4}
    assert all(project.fits[label] is fits[label] for label in (1, 3, 4))
    assert project.state.changed_labels == {1}
    project.edit_grains(Grow(labels=(3,)))
    project.edit_grains(Exclude(labels=(4,)))
    assert project.state.changed_labels == {1, 3}
    assert list(project.state.included_fits) == [1, 3]
    assert project.history.titles[-3:] == ["Merge grains 1, 2", "Grow grains 3", "Exclude grains 4"]


def test_a_new_fit_takes_the_mark_away(project, rng):
    project.edit_grains(Grow(labels=(1, 3)))
    project.add_fits({1: make_fit(1, 5, rng)})
    assert project.state.changed_labels == {3}
    project.undo()
    assert project.state.changed_labels == {1, 3}
    project.undo()
    assert project.state.changed_labels == frozenset()


def test_other_grains_forget_all_marks(project):
    project.edit_grains(Grow(labels=(1,)))
    project.change("Find grains", grains=placed_grains(), fits={})
    assert project.state.changed_labels == frozenset()


def test_an_edit_that_fails_is_no_change(project):
    before = project.state
    with pytest.raises(EditError):
        project.edit_grains(Delete(labels=(1, 2, 3, 4)))
    assert project.state is before
    with pytest.raises(ProjectError, match="no grains to correct"):
        Project.new().edit_grains(Grow(labels=(1,)))


def test_grey_values_come_from_the_scan_of_the_project(project):
    outcome = project.edit_grains(Split(labels=(3,), seeds=((25, 33, 20), (25, 33, 34)), by_grey=True))
    assert outcome.new == {5}
    project.edit_grains(Delete(labels=(4,)))
    assert project.edit_grains(NewGrain(at=(22, 24, 68))).new == {6}


def test_the_field_of_view_of_an_older_project_is_found_before_an_edit():
    labels = placed_grains().labels
    y, x = np.mgrid[:48, :72]
    seen = np.hypot((y - 23.5) / 23.5, (x - 35.5) / 35.5) <= 1
    grey = np.where(seen, scan_of(labels).voxels, 0).astype(np.float32)
    project = Project.new(Scan(grey, SIZE, ORIGIN), embed_scan=True)
    project.change("Find grains", grains=placed_grains())
    assert project.grains.view is None
    project.edit_grains(Paint(centres=((20, 8, 8),), radius=6.0))
    assert np.array_equal(project.grains.view.footprint, seen)
    assert not (project.grains.labels == 5)[:, ~seen].any()


def test_five_hundred_edits_are_undone_bit_by_bit(rng):
    project = Project(ProjectState(grains=placed_grains()))
    scan = scan_of(placed_grains().labels)
    first = project.grains.labels.copy()
    labels = [first]
    while len(labels) <= 500:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", GrainWarning)
            try:
                made = random_edit(project.grains, scan, rng)
            except EditError:
                continue
        project.change("Edit", grains=made)
        labels.append(np.asarray(made.label_volume).copy() if len(labels) % 50 == 0 else None)
    assert len(project.grains.edits) == 500
    last = project.grains.labels.copy()
    for known in labels[-2::-1]:
        project.undo()
        if known is not None:
            assert np.array_equal(project.grains.labels, known)
    assert not project.history.can_undo
    assert project.grains.edits == ()
    assert np.array_equal(project.grains.labels, first)
    project.go_to(500)
    assert np.array_equal(project.grains.labels, last)


def test_edits_come_back_from_a_file(project, tmp_path):
    y, x = np.mgrid[:48, :72]
    view = FieldOfView(0, np.hypot((y - 23.5) / 26, (x - 35.5) / 40) <= 1, (40, 48, 72), True)
    project.change("View", grains=replace(project.grains, view=view))
    project.edit_grains(Merge(labels=(1, 2)))
    project.edit_grains(Paint(centres=((5.5, 40, 10),), radius=4.0))
    project.edit_grains(Delete(labels=(5,)))
    project.edit_grains(Exclude(labels=(4,)))
    project.save(tmp_path / "sand.mbs")
    with h5py.File(tmp_path / "sand.mbs") as file:
        assert file.attrs["schema"] == 6
    again = Project.open(tmp_path / "sand.mbs")
    grains = replace(project.grains, stamps=again.grains.stamps)  # these tell forms apart in memory
    assert_same(replace(project.state, scan=None, grains=grains), replace(again.state, scan=None))
    assert again.state.changed_labels == {1}
    assert again.edit_grains(Paint(centres=((5.5, 40, 10),), radius=4.0)).new == {6}  # 5 was given before


def test_a_project_that_was_never_edited_is_readable_to_older_versions(project, tmp_path):
    project.save(tmp_path / "sand.mbs")
    with h5py.File(tmp_path / "sand.mbs") as file:
        assert file.attrs["schema"] == 1
    project.edit_grains(Exclude(labels=(4,)))
    project.edit_grains(Include(labels=(4,)))
    project.save()
    with h5py.File(tmp_path / "sand.mbs") as file:
        assert file.attrs["schema"] == 6


def damaged_text(file, change) -> None:
    texts = [json.loads(text) for text in file["grains/edits"].asstr()[:]]
    change(texts[0])
    file["grains/edits"][...] = [json.dumps(text) for text in texts]


@pytest.mark.parametrize(
    "damage",
    [
        lambda file: damaged_text(file, lambda text: text.update(kind="explode")),
        lambda file: damaged_text(file, lambda text: text.update(anchors=[[1, 2, 3]])),
        lambda file: damaged_text(file, lambda text: text.update(anchors=[[1, 2, 300], [1, 2, 3]])),
        lambda file: damaged_text(file, lambda text: text.update(labels=[-1, 2])),
        lambda file: file["grains/edits"].write_direct(np.array(["no JSON"] * 2, object)),
        lambda file: file["grains"].attrs.modify("last_label", -4),
        lambda file: file["grains/view"].attrs.modify("axis", 1),
        lambda file: file["grains/view"].write_direct(np.zeros((48, 72), bool)),
        lambda file: file["fits/changed"].write_direct(np.array([77])),
    ],
)
def test_damaged_records_of_edits_are_refused(project, tmp_path, edit_project, damage):
    view = FieldOfView(0, np.ones((48, 72), bool), (40, 48, 72))
    project.change("View", grains=replace(project.grains, view=view))
    project.edit_grains(Merge(labels=(1, 2)))
    project.edit_grains(Exclude(labels=(4,)))
    path = tmp_path / "sand.mbs"
    write_project(path, replace(project.state, scan=None))
    with edit_project(path) as file:
        damage(file)
    with pytest.raises(ProjectError, match=r"sand\.mbs is not an mbstudio project, or it is damaged"):
        read_project(path)


def test_edits_are_replayed_as_one_change(project):
    project.edit_grains(Merge(labels=(1, 2)))
    project.edit_grains(Exclude(labels=(4,)))
    other = Project(ProjectState(grains=placed_grains().without([4])))
    replayed = other.replay_edits(project.grains.edits)
    assert [edit.kind for edit, _ in replayed.left_out] == ["exclude"]
    assert other.grains.table["label"].tolist() == [1, 3]
    assert other.history.titles == ["Replay edits"]
    before = other.state
    assert other.replay_edits(project.grains.edits[1:]).made == ()
    assert other.state is before


def test_marks_survive_a_merge_with_the_file(project, rng):
    project.edit_grains(Grow(labels=(1, 3)))
    base = project.state
    theirs = base.with_fits({3: make_fit(3, 6, rng), 2: make_fit(2, 6, rng)})
    assert merge_states(base, base, theirs).state.changed_labels == {1}
    ours = base.with_fits({1: make_fit(1, 6, rng)})
    assert merge_states(base, ours, theirs).state.changed_labels == frozenset()
    assert isinstance(merge_states(base, ours, theirs).state.outdated, MappingProxyType)
