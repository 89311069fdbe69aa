"""Each edit does what it says, leaves all else as it was, and refuses by name what it cannot do."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy import ndimage

from mbstudio.core.errors import EditError, GrainWarning
from mbstudio.core.grains import FieldOfView, GrainSet, segment
from mbstudio.core.grains.editing import EditOutcome
from mbstudio.core.grains.editing.records import Delete, Exclude, Merge, Shrink
from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.grains.mesh_set import grain_set_from_meshes
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize
from tests.core.grains.editing.placed_grains import (
    ORIGIN,
    SIZE,
    ball,
    placed_grains,
    placed_labels,
    require_sound,
    scan_of,
)


@pytest.fixture
def grains() -> GrainSet:
    return placed_grains()


def require_untouched(before: GrainSet, after: GrainSet, *touched: int) -> None:
    """Grains that are not named are bit for bit where they were, and say the same in the table."""
    for label in before.table["label"]:
        if label not in touched:
            assert np.array_equal(before.labels == label, after.labels == label), f"grain {label} has changed"
            assert before.table[before.table["label"] == label].to_dict("records") == (
                after.table.loc[after.table["label"] == label, before.table.columns].to_dict("records")
            )


# Merging ----------------------------------------------------------------------------------------


def test_merging_keeps_the_first_number(grains):
    merged = grains.merged([2, 1])
    assert merged.table["label"].tolist() == [2, 3, 4]
    assert np.array_equal(merged.labels == 2, np.isin(grains.labels, [1, 2]))
    require_untouched(grains, merged, 1, 2)
    require_sound(merged)
    assert grains.table["label"].tolist() == [1, 2, 3, 4]  # the first set is as it was
    assert (grains.labels == 1).sum() == grains.table["voxels"][0]


def test_merging_what_does_not_touch_is_asked_for(grains):
    with pytest.raises(EditError, match=r"Grains 1 and 3 do not touch.*apart=True"):
        grains.merged([1, 3])
    with pytest.warns(GrainWarning, match="A gap was closed with"):
        merged = grains.merged([1, 3], apart=True)
    require_untouched(grains, merged, 1, 3)
    require_sound(merged)
    joint = merged.labels == 1
    assert joint[np.isin(grains.labels, [1, 3])].all()
    bridge = joint & (grains.labels == 0)
    assert 0 < bridge.sum() < 0.1 * joint.sum()


def test_a_gap_that_is_too_wide_or_taken_is_not_closed(grains):
    with pytest.raises(EditError, match="wider than 16 voxels"):
        grains.merged([1, 4], apart=True)
    labels = np.zeros((20, 20, 30), np.int32)
    labels[5:15, 5:15, 2:10], labels[5:15, 5:15, 14:22] = 1, 2
    labels[:, :, 12] = 3
    with pytest.raises(EditError, match="cannot be closed"):
        build_grain_set(labels, SIZE).merged([1, 2], apart=True)


@pytest.mark.parametrize("labels", [[1], [1, 1], [2, 1, 2]])
def test_merging_needs_two_different_grains(grains, labels):
    with pytest.raises(EditError, match="name two or more, each once"):
        grains.merged(labels)


def test_grains_that_there_are_not_are_named(grains):
    for attempt in (
        lambda: grains.merged([1, 9]),
        lambda: grains.without([9]),
        lambda: grains.excluded([9]),
        lambda: grains.grown(9),
        lambda: grains.split(9, seeds=[(1, 1, 1), (2, 2, 2)]),
    ):
        with pytest.raises(EditError, match="There is no grain 9"):
            attempt()


# Splitting --------------------------------------------------------------------------------------


@pytest.mark.parametrize("with_scan", [False, True])
def test_splitting_by_seeds_finds_the_neck(grains, with_scan):
    scan = scan_of(grains.labels) if with_scan else None
    parted = grains.split(3, seeds=[(25, 33, 20), (25, 33, 34)], scan=scan)
    assert parted.table["label"].tolist() == [1, 2, 3, 4, 5]
    require_untouched(grains, parted, 3)
    require_sound(parted)
    assert np.array_equal(np.isin(parted.labels, [3, 5]), grains.labels == 3)
    # The neck is in the middle between the two balls, at x = 27.
    left = parted.labels[25, 33, 20]
    truth = (grains.labels == 3) & (np.arange(72) <= 27)
    wrong = (parted.labels == left) != truth
    assert wrong[grains.labels == 3].mean() < 0.06


def test_the_largest_part_keeps_the_number(grains):
    joint = grains.merged([1, 2])
    parted = joint.split(1, seeds=[(12, 12, 14), (12, 12, 31)])
    sizes = parted.table.set_index("label")["voxels"]
    assert sizes[1] >= sizes[5]
    assert parted.last_label == 5


def test_a_number_is_never_given_twice(grains):
    parted = grains.split(3, seeds=[(25, 33, 20), (25, 33, 34)])
    again = parted.without([5]).painted(None, [(5, 40, 10)], 4)
    assert again.table["label"].tolist() == [1, 2, 3, 4, 6]


def test_seeds_that_cannot_be_used_are_named(grains):
    with pytest.raises(EditError, match=r"Seed 2 at .*\(12, 12, 14\) lies in grain 1, not in grain 3"):
        grains.split(3, seeds=[(25, 33, 20), (12, 12, 14)])
    with pytest.raises(EditError, match=r"Seed 1 at .*lies outside all grains"):
        grains.split(3, seeds=[(0, 0, 0), (25, 33, 20)])
    with pytest.raises(EditError, match=r"Seed 1 at .*outside the scan of \(40, 48, 72\) voxels"):
        grains.split(3, seeds=[(0, 0, 400), (25, 33, 20)])
    with pytest.raises(
        EditError, match=r"Seeds 1 at \(25, 33, 18\) and 3 at \(25, 33, 22\) lie in one basin"
    ):
        grains.split(3, seeds=[(25, 33, 18), (25, 33, 34), (25, 33, 22)])
    with pytest.raises(EditError, match="two seeds or more"):
        grains.split(3, seeds=[(25, 33, 20)])
    with pytest.raises(EditError, match="three whole numbers"):
        grains.split(3, seeds=[(25.5, 33, 20), (25, 33, 34)])


def test_grey_values_show_a_boundary_that_the_outline_does_not():
    """Two halves of one long box, with a dark layer between them that is not in the middle."""
    labels = np.zeros((24, 24, 60), np.int32)
    labels[4:20, 4:20, 4:56] = 1
    grey = np.where(labels > 0, 200.0, 100.0)
    grey[:, :, 20:22] -= 90.0 * (labels[:, :, 20:22] > 0)
    grains = build_grain_set(labels, SIZE)
    seeds = [(12, 12, 12), (12, 12, 40)]
    with pytest.raises(EditError, match="one basin"):
        grains.split(1, seeds)
    parted = grains.split(1, seeds, scan=Scan(grey.astype(np.float32), SIZE))
    boundary = np.argmax(parted.labels[12, 12, 4:56] != parted.labels[12, 12, 4]) + 4
    assert 19 <= boundary <= 23


def test_a_scan_of_another_shape_is_refused(grains):
    other = Scan(np.zeros((5, 5, 5), np.float32), SIZE)
    with pytest.raises(EditError, match=r"The scan has \(5, 5, 5\) voxels"):
        grains.split(3, seeds=[(25, 33, 20), (25, 33, 34)], scan=other)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_line_parts_a_grain_as_a_sheet_along_the_view(grains, axis):
    line = [(25, 33, 26.5), (26, 34, 26.5)] if axis == 0 else [(20, 33, 26.5), (21, 33, 26.5)]
    parted = grains.split_along(3, line, axis=axis)
    require_untouched(grains, parted, 3)
    require_sound(parted)
    left = (grains.labels == 3) & (np.arange(72) <= 26)
    assert np.array_equal(parted.labels == parted.labels[25, 33, 20], left)


def test_a_bent_line_parts_along_its_bend(grains):
    parted = grains.split_along(3, [(25, 20, 30.5), (25, 33.5, 30.5), (25, 33.5, 60)], axis=0)
    y, x = np.mgrid[:48, :72]
    corner = (x > 30.5) & (y < 33.5)
    inside = grains.labels == 3
    assert np.array_equal(parted.labels == parted.labels[25, 30, 34], inside & corner)


def test_a_line_that_parts_nothing_is_refused(grains):
    with pytest.raises(EditError, match="does not part grain 3"):
        grains.split_along(3, [(25, 0, 60), (25, 10, 60)])
    with pytest.raises(EditError, match="two different points"):
        grains.split_along(3, [(25, 33, 20), (25, 33, 20)])
    with pytest.raises(EditError, match="crosses itself"):
        grains.split_along(3, [(0, 30, 20), (0, 36, 30), (0, 36, 20), (0, 30, 30), (0, 20, 20)])
    with pytest.raises(EditError, match="axis=3"):
        grains.split_along(3, [(25, 33, 20), (25, 33, 21)], axis=3)


def test_parts_that_do_not_hang_together_become_grains_of_their_own():
    """A ring cut across twice by one line falls into two; a U cut below its arms into three."""
    labels = np.zeros((12, 40, 40), np.int32)
    labels[3:9, 5:35, 5:35] = 1
    labels[3:9, 5:25, 13:27] = 0  # a U: two arms on a base
    grains = build_grain_set(labels, SIZE)
    with pytest.warns(GrainWarning, match="came apart: .* became grain 3"):
        parted = grains.split_along(1, [(0, 20.5, 0), (0, 20.5, 10)], axis=0)
    assert len(parted) == 3
    require_sound(parted)


# Deleting, excluding ----------------------------------------------------------------------------


def test_deleting_leaves_void(grains):
    left = grains.without([2, 4])
    assert left.table["label"].tolist() == [1, 3]
    assert not np.isin(left.labels, [2, 4]).any()
    require_untouched(grains, left, 2, 4)
    with pytest.raises(EditError, match="no grain would be left"):
        grains.without([1, 2, 3, 4])


def test_what_is_excluded_is_no_longer_worked_on(grains):
    assert grains.interior_labels == [1, 2, 3]
    left = grains.excluded([2, 3])
    assert left.interior_labels == [1]
    assert left.excluded_labels == {2, 3}
    assert left.table["excluded"].tolist() == [False, True, True, False]
    assert left.labels is grains.labels
    assert left.included([3]).excluded_labels == {2}
    assert "excluded" not in grains.table


def test_parts_of_what_is_excluded_are_excluded(grains):
    parted = grains.excluded([3]).split(3, seeds=[(25, 33, 20), (25, 33, 34)])
    assert parted.excluded_labels == {3, 5}
    assert grains.excluded([1]).merged([2, 1]).excluded_labels == frozenset()


# Brush ------------------------------------------------------------------------------------------


def test_painting_in_space_and_over_void_only(grains):
    painted = grains.painted(1, [(12, 12, 22)], 6)
    stroke = ball(grains.labels.shape, (12, 12, 22), 6)
    assert np.array_equal(painted.labels == 1, (grains.labels == 1) | (stroke & (grains.labels == 0)))
    require_untouched(grains, painted, 1)
    require_sound(painted)
    over = grains.painted(1, [(12, 12, 22)], 6, over="everything")
    assert np.array_equal(over.labels == 1, (grains.labels == 1) | stroke)
    require_sound(over)


def test_painting_in_a_slice_stays_in_it(grains):
    painted = grains.painted(1, [(12, 12, 22), (12, 20, 22)], 4, axis=0)
    gained = (painted.labels == 1) & (grains.labels != 1)
    assert np.flatnonzero(gained.any(axis=(1, 2))).tolist() == [12]
    y, x = np.mgrid[:48, :72]
    stroke = np.hypot(np.maximum(0, np.maximum(12 - y, y - 20)), x - 22) <= 4
    assert np.array_equal(gained[12], stroke & (grains.labels[12] == 0))


def test_a_new_grain_is_painted(grains):
    painted = grains.painted(None, [(5, 40, 10)], 4)
    assert painted.table["label"].tolist() == [1, 2, 3, 4, 5]
    assert np.array_equal(painted.labels == 5, ball(grains.labels.shape, (5, 40, 10), 4))
    require_untouched(grains, painted)
    require_sound(painted)


def test_the_brush_is_round_in_space_where_voxels_are_not_cubes():
    labels = np.zeros((20, 40, 40), np.int32)
    labels[9, 19, 19] = 1
    grains = build_grain_set(labels, VoxelSize(4.0, 2.0, 2.0, "um")).painted(1, [(9, 19, 19)], 6)
    assert np.ptp(np.argwhere(grains.labels == 1), axis=0).tolist() == [6, 12, 12]


def test_nothing_is_painted_beyond_the_field_of_view(grains):
    y, x = np.mgrid[:48, :72]
    footprint = np.hypot((y - 23.5) / 23.5, (x - 35.5) / 35.5) <= 1
    view = FieldOfView(0, footprint, grains.labels.shape)
    seen = replace(grains, view=view)
    painted = seen.painted(None, [(20, 8, 8)], 6)
    new = painted.labels == 5
    assert new.any()
    assert not new[:, ~footprint].any()
    assert bool(painted.table.set_index("label")["touches_border"][5])
    with pytest.raises(EditError, match="beyond the field of view"):
        seen.painted(None, [(20, 0, 0)], 3)
    with pytest.raises(EditError, match="beyond the field of view"):
        grains.painted(None, [(20, 20, 500)], 3)
    with pytest.raises(EditError, match="beyond the field of view"):
        grains.painted(None, [(-2, 20, 20)], 3, axis=0)


def test_erasing_takes_from_one_grain_or_from_all(grains):
    stroke = ball(grains.labels.shape, (12, 12, 22), 4)
    one = grains.erased(1, [(12, 12, 22)], 4)
    assert np.array_equal(one.labels == 1, (grains.labels == 1) & ~stroke)
    require_untouched(grains, one, 1)
    every = grains.erased(None, [(12, 12, 22)], 4)
    assert not every.labels[stroke].any()
    require_sound(every)


def test_erasing_through_a_grain_makes_two_and_crumbs_go(grains):
    cut = [(z, y, 27) for z in range(12, 40, 2) for y in (20, 46)]
    with pytest.warns(GrainWarning, match="Grain 3 came apart.*grain 5"):
        parted = grains.erased(3, cut, 2)
    assert len(parted) == 5
    require_sound(parted)
    with pytest.warns(GrainWarning, match="Crumbs of 7 voxels"):
        crumbly = grains.painted(1, [(30, 5, 60)], 1)  # far away from it
    assert crumbly.table["voxels"].tolist() == grains.table["voxels"].tolist()


def test_strokes_that_change_nothing_or_cannot_be_are_refused(grains):
    with pytest.raises(EditError, match="changes nothing"):
        grains.painted(1, [(12, 12, 14)], 3)
    with pytest.raises(EditError, match="touches no voxel of grain 1"):
        grains.erased(1, [(30, 5, 60)], 2)
    with pytest.raises(EditError, match="touches no voxel of a grain"):
        grains.erased(None, [(30, 5, 60)], 2)
    for radius in (0, -1, float("nan"), 1e9):
        with pytest.raises(EditError, match="is impossible"):
            grains.painted(1, [(12, 12, 22)], radius)
    with pytest.raises(EditError, match="over='all'"):
        grains.painted(1, [(12, 12, 22)], 3, over="all")
    with pytest.raises(EditError, match="one place or more"):
        grains.painted(1, [], 3)
    with pytest.raises(EditError, match="three numbers"):
        grains.painted(1, [(1, 2, float("nan"))], 3)


def test_filling_an_outline_in_a_slice(grains):
    angles = np.linspace(0, 2 * np.pi, 60)
    ring = grains.painted(None, [(20, 14 + 8 * np.sin(a), 60 + 8 * np.cos(a)) for a in angles], 1.5, axis=0)
    filled = ring.filled(5, (20, 14, 60))
    gained = (filled.labels == 5) & (ring.labels != 5)
    assert gained[20].sum() > 100
    assert not np.delete(gained, 20, axis=0).any()
    require_sound(filled)
    with pytest.raises(EditError, match="does not enclose"):
        ring.filled(5, (20, 30, 60))
    with pytest.raises(EditError, match="no void to fill"):
        grains.filled(1, (12, 12, 14))


# Reshaping --------------------------------------------------------------------------------------


def test_growing_and_shrinking_by_a_voxel(grains):
    grown = grains.grown(1)
    wider = ndimage.binary_dilation(grains.labels == 1)
    assert np.array_equal(grown.labels == 1, (grains.labels == 1) | (wider & (grains.labels == 0)))
    require_untouched(grains, grown, 1)
    shrunk = grains.shrunk(1)
    narrower = ndimage.binary_erosion(grains.labels == 1)
    assert np.array_equal(shrunk.labels == 1, narrower)
    require_sound(shrunk)
    both = grains.grown([1, 4])
    assert (both.table["voxels"].to_numpy() > grains.table["voxels"].to_numpy()).tolist() == [
        True,
        False,
        False,
        True,
    ]
    with pytest.raises(EditError, match="too thin to lose 30 voxels"):
        grains.shrunk(1, 30)
    with pytest.raises(EditError, match="by=0"):
        grains.grown(1, 0)


def test_a_face_of_the_scan_is_no_surface_to_shrink_from(grains):
    shrunk = grains.shrunk(4)
    assert (shrunk.labels == 4)[:, :, -1].any()
    smooth = grains.smoothed(4, 1.5)
    at_face = (grains.labels == 4)[:, :, -1]
    assert ((smooth.labels == 4)[:, :, -1] & at_face).sum() > 0.9 * at_face.sum()


def test_smoothing_takes_spikes_and_keeps_the_ball():
    shape = (40, 40, 40)
    labels = ball(shape, (20, 20, 20), 11).astype(np.int32)
    labels[20, 20, 30:38] = 1
    smooth = build_grain_set(labels, SIZE).smoothed(1, 1.5)
    assert not smooth.labels[20, 20, 33:].any()
    same = smooth.labels.astype(bool) == ball(shape, (20, 20, 20), 11)
    assert same.mean() > 0.995
    require_sound(smooth)


def test_filling_holes():
    shape = (30, 30, 30)
    labels = ball(shape, (15, 15, 15), 10).astype(np.int32)
    labels[ball(shape, (15, 15, 15), 3)] = 0
    grains = build_grain_set(labels, SIZE)
    assert np.array_equal(grains.with_holes_filled(1).labels > 0, ball(shape, (15, 15, 15), 10))
    with pytest.raises(EditError, match="no holes"):
        grains.with_holes_filled(1).with_holes_filled(1)


# A click ----------------------------------------------------------------------------------------


def test_a_new_grain_by_a_click(grains):
    scan = scan_of(grains.labels)
    missing = replace(grains.without([3]), edits=())
    found = missing.with_new_grain((25, 33, 20), scan, threshold=150)
    assert found.table["label"].tolist() == [1, 2, 4, 5]
    assert np.array_equal(found.labels == 5, grains.labels == 3)
    assert np.array_equal(missing.with_new_grain((25, 33, 20), scan).labels, found.labels)
    dark = Scan(300 - scan.voxels, SIZE, ORIGIN)
    assert np.array_equal(missing.with_new_grain((25, 33, 20), dark).labels, found.labels)
    require_sound(found)


def test_clicks_that_find_nothing_are_refused(grains):
    scan = scan_of(grains.labels)
    with pytest.raises(EditError, match="belongs to grain 1"):
        grains.with_new_grain((12, 12, 14), scan)
    with pytest.raises(EditError, match="lies outside the scan"):
        grains.with_new_grain((400, 12, 14), scan)
    with pytest.raises(EditError, match="threshold=nan"):
        grains.with_new_grain((30, 5, 60), scan, threshold=float("nan"))


# What follows -----------------------------------------------------------------------------------


def test_an_outcome_tells_what_became_of_the_grains(grains):
    outcome = grains.edit(Merge(labels=(1, 2)))
    assert isinstance(outcome, EditOutcome)
    assert (outcome.changed, outcome.gone, outcome.new) == ({1}, {2}, frozenset())
    assert outcome.grains.edits == (outcome.edit,)
    assert outcome.grains.labels[outcome.edit.anchors[1]] == 1
    outcome = grains.edit(Exclude(labels=(1,)))
    assert (outcome.changed, outcome.gone, outcome.new) == (frozenset(), frozenset(), frozenset())


def test_grains_at_the_edge_of_the_view_stay_cut(grains):
    y, x = np.mgrid[:48, :72]
    view = FieldOfView(0, np.hypot((y - 23.5) / 23.5, (x - 35.5) / 35.5) <= 1, grains.labels.shape)
    labels = np.where(view.mask, placed_labels(), 0).astype(np.int32)
    seen = replace(build_grain_set(labels, SIZE, ORIGIN, view.rim_cutting(labels)), view=view)
    assert seen.table["touches_border"].tolist() == [True, False, False, True]
    merged = seen.merged([2, 1])
    assert merged.table["touches_border"].tolist() == [True, False, True]
    require_sound(merged)
    # Where the view is not known, what it has cut is not taken for whole.
    unknown = replace(seen, view=None).merged([2, 1])
    assert unknown.table["touches_border"].tolist() == [True, False, True]


def test_the_verdict_says_that_it_was_edited():
    shape = (60, 60, 110)
    labels = np.zeros(shape, np.int32)
    for number, x in enumerate((16, 46, 76), start=1):
        labels[ball(shape, (30, 30, x), 12)] = number
    grains = segment(scan_of(labels))
    assert grains.verdict is not None
    assert grains.verdict.edits == 0
    assert grains.verdict.edited_note == ""
    edited = grains.shrunk([int(grains.table["label"][0])]).without([int(grains.table["label"][1])])
    assert edited.verdict.edits == 2
    assert "Edited by hand 2 times" in edited.verdict.edited_note
    assert edited.verdict.figures["solid_share"] < grains.verdict.figures["solid_share"]
    share = (edited.labels > 0).sum() / (grains.labels > 0).sum() * grains.verdict.figures["solid_share"]
    assert edited.verdict.figures["solid_share"] == pytest.approx(share)
    again = type(edited.verdict).from_record(edited.verdict.to_record())
    assert again == edited.verdict


def test_grains_of_mesh_files_keep_their_surfaces(tmp_path):
    for name, radius in (("a", 1.0), ("b", 2.0)):
        trimesh.creation.icosphere(radius=radius).export(tmp_path / f"{name}.stl")
    grains = grain_set_from_meshes([tmp_path / "a.stl", tmp_path / "b.stl"], 24, "mm")
    with pytest.raises(EditError, match="bodies of mesh files"):
        grains.grown(1)
    left = grains.without([1])
    assert set(left.meshes) == {2}
    assert left.name_of(2) == grains.name_of(2)


def test_single_grains_are_cut_out_as_before(grains):
    shrunk = grains.shrunk(3)
    for label in (1, 2, 4):
        assert np.array_equal(shrunk.grain(label).mask, grains.grain(label).mask)
    assert shrunk.grain(3).voxel_count == int((shrunk.labels == 3).sum())


def test_untouched_grains_are_known_again(grains):
    """What was measured of a grain counts until an edit touches it; undone, it counts again."""
    edited = grains.shrunk(3)
    assert [edited.body_key(label) == grains.body_key(label) for label in (1, 2, 3, 4)] == [
        True,
        True,
        False,
        True,
    ]
    assert grains.shrunk(3).body_key(3) != edited.body_key(3)
    assert edited.excluded([3]).body_key(3) == edited.body_key(3)
    assert len({edited.grown(label).body_key(3) for label in (1, 2, 3)}) == 2
    assert replace(grains, voxel_size=VoxelSize(1, 1, 1, "um")).body_key(1) != grains.body_key(1)
    assert placed_grains().body_key(1) != grains.body_key(1)


def test_failed_edits_change_nothing(grains):
    before = grains.labels.copy()
    for edit in (Delete(labels=(1, 2, 3, 4)), Merge(labels=(1, 3)), Shrink(labels=(1, 3), by=30.0)):
        with pytest.raises(EditError):
            grains.edit(edit)
    assert np.array_equal(grains.labels, before)
    assert grains.edits == ()


def test_a_random_row_of_edits_keeps_everything_in_step(rng):
    grains = placed_grains()
    scan = scan_of(grains.labels)
    states = [grains]
    labels = [grains.labels.copy()]
    made = 0
    while made < 60:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", GrainWarning)
            try:
                grains = random_edit(grains, scan, rng)
            except EditError:
                continue
        made += 1
        states.append(grains)
        labels.append(grains.labels.copy())
        if made % 6 == 0:
            require_sound(grains)
    for state, known in zip(states, labels, strict=True):
        assert np.array_equal(state.labels, known)
    assert len({kind for state in states for kind in (type(edit) for edit in state.edits)}) > 8


def random_edit(grains: GrainSet, scan: Scan, rng: np.random.Generator) -> GrainSet:
    """Make one edit drawn by chance; EditError if it cannot be made."""
    labels = grains.table["label"].to_numpy()
    label, other = (int(chosen) for chosen in rng.choice(labels, 2))
    at = tuple(int(index) for index in rng.integers(0, grains.label_volume.shape))
    inside = np.argwhere(grains.labels == label)
    seeds = [tuple(int(index) for index in inside[row]) for row in rng.integers(0, len(inside), 2)]
    radius, axis = float(rng.uniform(2, 7)), int(rng.integers(3))
    choices = [
        lambda: grains.merged([label, other], apart=bool(rng.integers(2))),
        lambda: grains.split(label, seeds, scan=scan if rng.integers(2) else None),
        lambda: grains.split_along(label, seeds, axis=axis),
        lambda: grains.without([label]) if len(grains) > 3 else grains.excluded([label]),
        lambda: grains.excluded([label]),
        lambda: grains.included([label]),
        lambda: grains.painted(label, [seeds[0], at], radius, over="everything"),
        lambda: grains.painted(None, [at], radius),
        lambda: grains.painted(label, [seeds[0]], radius, axis=axis),
        lambda: grains.erased(label, seeds, radius / 2),
        lambda: grains.grown(label),
        lambda: grains.shrunk(label),
        lambda: grains.smoothed(label),
        lambda: grains.with_holes_filled(label),
        lambda: grains.filled(label, at, axis=axis),
        lambda: grains.with_new_grain(at, scan),
    ]
    return choices[int(rng.integers(len(choices)))]()
