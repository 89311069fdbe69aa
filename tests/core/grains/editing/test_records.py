"""Edits are plain records, and can be made again on other grains of the same scan."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.errors import EditError, GrainWarning
from mbstudio.core.grains import GrainSet
from mbstudio.core.grains.editing import read_edit, replay
from mbstudio.core.grains.editing.records import (
    KINDS,
    Accept,
    Delete,
    Erase,
    Exclude,
    Fill,
    FillHoles,
    Grow,
    Include,
    Merge,
    NewGrain,
    Paint,
    Shrink,
    Smooth,
    Split,
    SplitAlong,
)
from mbstudio.core.grains.labelling import build_grain_set
from tests.core.grains.editing.placed_grains import SIZE, placed_grains, scan_of

EXAMPLES = (
    Merge(labels=(3, 7), anchors=((1, 2, 3), (4, 5, 6)), apart=True),
    Split(labels=(5,), anchors=((1, 2, 3),), seeds=((1, 2, 3), (7, 8, 9)), by_grey=True),
    SplitAlong(labels=(5,), anchors=((1, 2, 3),), points=((1.5, 2.25, 3.0), (0.1, 0.2, 0.3)), axis=2),
    Delete(labels=(1, 2), anchors=((0, 0, 0), (1, 1, 1))),
    Exclude(labels=(9,), anchors=((0, 0, 0),)),
    Include(labels=(9,), anchors=((0, 0, 0),)),
    Accept(labels=(9,), anchors=((0, 0, 0),)),
    Paint(labels=(), centres=((1.0, 2.0, 3.5),), radius=2.5, over="everything", axis=1),
    Erase(labels=(4,), anchors=((3, 3, 3),), centres=((1.0, 2.0, 3.5),), radius=2.0),
    Fill(labels=(4,), anchors=((3, 3, 3),), at=(4, 5, 6), axis=1),
    Grow(labels=(4,), anchors=((3, 3, 3),), by=2.0),
    Shrink(labels=(4,), anchors=((3, 3, 3),), by=1.0),
    Smooth(labels=(4,), anchors=((3, 3, 3),), sigma=1.5),
    FillHoles(labels=(4,), anchors=((3, 3, 3),)),
    NewGrain(at=(9, 8, 7), threshold=120.5),
)


@pytest.mark.parametrize("edit", EXAMPLES, ids=lambda edit: edit.kind)
def test_a_record_says_all_and_is_read_back(edit):
    text = json.dumps(edit.to_record(), allow_nan=False)
    assert read_edit(json.loads(text), (20, 20, 20)) == edit
    assert edit.described()


def test_every_kind_has_an_example():
    assert {edit.kind for edit in EXAMPLES} == set(KINDS)


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "explode"},
        {"kind": None},
        {"colour": 3},
        {"labels": 3},
        {"labels": [0, 1]},
        {"labels": [True, 2]},
        {"labels": [2.0, 3]},
        {"anchors": [[1, 2, 3]]},
        {"anchors": [[1, 2], [3, 4]]},
        {"anchors": [[1, 2, 3], [4, 5, 99]]},
        {"anchors": [[1, 2, 3], [4, 5, float("nan")]]},
        {"apart": 1},
    ],
)
def test_damaged_records_are_refused(change):
    with pytest.raises(EditError):
        read_edit({**EXAMPLES[0].to_record(), **change}, (20, 20, 20))


@pytest.mark.parametrize(
    "change",
    [
        {"radius": "2"},
        {"radius": float("inf")},
        {"axis": 3},
        {"axis": True},
        {"over": "all"},
        {"centres": [1]},
    ],
)
def test_damaged_strokes_are_refused(change):
    with pytest.raises(EditError):
        read_edit({**EXAMPLES[6].to_record(), **change})


def edited(grains: GrainSet) -> GrainSet:
    """Make an edit of most kinds."""
    scan = scan_of(grains.labels)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GrainWarning)
        return (
            grains.merged([1, 2])
            .split(3, [(25, 33, 20), (25, 33, 34)], scan=scan)
            .excluded([4])
            .painted(1, [(12, 12, 40)], 5)
            .grown(3)
            .smoothed(5)
            .erased(None, [(20, 30, 40)], 3)
        )


def renumbered(grains: GrainSet) -> GrainSet:
    """Return the same grains under other numbers, as another segmentation may find them."""
    labels = np.array([0, 3, 1, 4, 2], np.int32)[grains.labels]
    return build_grain_set(labels, grains.voxel_size, grains.origin)


def test_edits_are_made_again_on_grains_of_other_numbers():
    grains = placed_grains()
    first = edited(grains)
    again = replay(first.edits, renumbered(grains), scan_of(grains.labels))
    assert again.left_out == ()
    assert len(again.made) == len(first.edits) == len(again.grains.edits)
    ours, theirs = first.labels, again.grains.labels
    assert np.array_equal(ours > 0, theirs > 0)
    pairs = {(int(a), int(b)) for a, b in zip(ours.ravel(), theirs.ravel(), strict=True)}
    assert len(pairs) == len(np.unique(ours)) == len(np.unique(theirs))
    assert len(again.grains.excluded_labels) == 1


def test_what_cannot_be_made_again_is_told_by_name():
    grains = placed_grains()
    first = edited(grains)
    joined = grains.merged([1, 2]).without([4]).split(3, [(25, 33, 20), (25, 33, 34)])
    again = replay(first.edits, joined)
    told = [(edit.kind, reason) for edit, reason in again.left_out]
    assert [kind for kind, _ in told] == ["merge", "split", "exclude"]
    assert "what were several grains is grain 1 alone" in told[0][1]
    assert "the seeds lie in 2 grains already: 3, 5" in told[1][1]
    assert "there is no grain at (z, y, x)" in told[2][1]
    assert "where grain 4 was" in told[2][1]
    assert len(again.made) == 4


def test_a_split_by_grey_values_is_not_made_again_without_the_scan():
    grains = placed_grains()
    parted = grains.split(3, [(25, 33, 20), (25, 33, 34)], scan=scan_of(grains.labels))
    (left_out,) = replay(parted.edits, grains).left_out
    assert "give the scan" in left_out[1]


def test_places_outside_another_scan_are_told():
    grains = placed_grains().grown(4)
    small = build_grain_set(placed_grains().labels[:20, :30, :40].copy(), SIZE)
    (left_out,) = replay(grains.edits, small).left_out
    assert "lies outside this scan" in left_out[1]
    (left_out,) = replay([replace(grains.edits[0], anchors=())], placed_grains()).left_out
    assert "not noted where its grains lay" in left_out[1]


def test_anchors_lie_inside_also_where_the_middle_does_not():
    labels = np.zeros((20, 40, 40), np.int32)
    y, x = np.mgrid[:40, :40]
    labels[5:15, (np.hypot(y - 20, x - 20) < 15) & (np.hypot(y - 20, x - 20) > 9)] = 1
    labels[5:15, :3, :3] = 2
    (anchor,) = build_grain_set(labels, SIZE).shrunk(1).edits[0].anchors
    assert labels[anchor] == 1
