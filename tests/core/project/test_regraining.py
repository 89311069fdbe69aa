"""Other grains for a project: what did not change keeps its avatar, flags and corrections."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.grains.editing.records import Exclude, Grow, Merge
from mbstudio.core.grains.editing.unchanged import match_unchanged
from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.grains.segmentation import SegmentationSettings
from mbstudio.core.project import Project
from mbstudio.core.project.regraining import regrain
from tests.core.grains.editing.placed_grains import ORIGIN, SIZE, placed_grains, scan_of
from tests.core.project.conftest import make_fit


@pytest.fixture
def project(rng) -> Project:
    project = Project.new(scan_of(placed_grains().labels), embed_scan=True)
    project.change("Find grains", grains=placed_grains())
    project.add_fits({label: make_fit(label, 4, rng) for label in (1, 2, 3, 4)})
    return project


def found_anew(change=None):
    """Return the placed grains as another segmentation finds them: numbered from behind, one changed."""
    labels = np.array(placed_grains().labels)
    count = labels.max()
    turned = np.where(labels > 0, count + 1 - labels, 0).astype(np.int32)
    if change is not None:
        change(turned)
    return build_grain_set(turned, SIZE, ORIGIN, None)


def test_grains_of_the_same_voxels_are_matched_whatever_their_numbers():
    before, after = placed_grains(), found_anew()
    count = int(before.labels.max())
    assert match_unchanged(before, after) == {label: count + 1 - label for label in range(1, count + 1)}
    assert match_unchanged(before, replace(after, origin=(0.0, 0.0, 1.0))) == {}


def test_as_many_voxels_in_the_same_box_are_not_the_same():
    labels = np.zeros((3, 4, 4), np.int32)
    labels[1, 1:3, 1:3] = 1
    other = labels.copy()
    labels[1, 1, 1], other[1, 2, 2] = 0, 0  # another corner is missing
    one, two = (build_grain_set(array, SIZE, ORIGIN, None) for array in (labels, other))
    assert one.table["voxels"].tolist() == two.table["voxels"].tolist()
    assert match_unchanged(one, two) == {}


def test_avatars_of_unchanged_grains_stay_under_their_new_number(project):
    count = len(placed_grains())
    fits = dict(project.fits)

    def cut(labels):
        at = tuple(np.argwhere(labels == count)[0])  # a voxel of what was grain 1
        labels[at] = 0

    regraining = project.use_grains(found_anew(cut), SegmentationSettings(splitting=0.5))
    assert regraining.discarded == (1,)
    assert regraining.kept == 3
    assert set(project.fits) == {count + 1 - label for label in (2, 3, 4)}
    assert all(project.fits[count + 1 - label] is fits[label] for label in (2, 3, 4))
    assert project.state.segmentation.splitting == 0.5
    project.undo()
    assert dict(project.fits) == fits


def test_it_is_told_before_anything_changes(project):
    state = project.state
    regraining = regrain(state, found_anew(), None)
    assert not regraining.loses_something
    assert regraining.kept == 4
    assert project.state is state


def test_flags_and_corrections_are_made_again(project):
    count = len(placed_grains())
    project.edit_grains(Exclude(labels=(4,)))
    project.edit_grains(Merge(labels=(1, 2)))
    project.edit_grains(Grow(labels=(3,)))
    fits = dict(project.fits)
    regraining = project.use_grains(found_anew(), None)
    assert not regraining.left_out
    assert project.grains.excluded_labels == {count + 1 - 4}
    merged = int(project.grains.label_volume[tuple(np.argwhere(placed_grains().labels == 1)[0])])
    assert project.fits[merged] is fits[1]  # the merged grain is the same again, and still marked
    assert {merged, count + 1 - 3} == project.state.changed_labels
    assert project.fits[count + 1 - 4] is fits[4]


def test_corrections_without_their_grain_are_named(project):
    project.edit_grains(Merge(labels=(1, 2)))
    count = len(placed_grains())

    def remove(labels):
        labels[labels == count] = 0  # what was grain 1

    regraining = regrain(project.state, found_anew(remove), None)
    assert regraining.loses_something
    assert len(regraining.left_out) == 1
    assert "no grain" in regraining.left_out[0][1]


def test_the_first_grains_of_a_project_are_taken_as_they_are(project):
    bare = Project.new(scan_of(placed_grains().labels), embed_scan=True)
    assert bare.use_grains(placed_grains(), None).kept == 0
    assert len(bare.grains) == len(placed_grains())
