"""Corrections are put into the overview where they were made, and give what drawing all anew gives."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.scene.grain_overview import GrainOverview
from mbstudio.scene.surfaces import label_surface
from tests.core.grains.editing.placed_grains import ORIGIN, SIZE, ball, placed_grains

LONGEST = 200


def triangles_of(surface):
    """Return each triangle with its label as one row of corners, sorted."""
    rows = np.column_stack([surface.points[surface.triangles].reshape(-1, 9), surface.labels])
    rows = rows.round(3)
    return rows[np.lexsort(rows.T[::-1])]


def same(surface, grains, longest=LONGEST):
    whole = label_surface(grains, longest)
    assert len(surface.triangles) == len(whole.triangles)
    np.testing.assert_allclose(triangles_of(surface), triangles_of(whole), atol=2e-3)
    lengths = np.linalg.norm(surface.normals, axis=1)
    np.testing.assert_allclose(lengths, 1, atol=1e-4)


def large_grains():
    shape = (60, 60, 150)
    labels = np.zeros(shape, np.int32)
    for number, x in enumerate((12, 31, 60, 90, 120), 1):
        labels[ball(shape, (30, 30, x), 10) & (labels == 0)] = number
    return build_grain_set(labels, SIZE, ORIGIN)


EDITS = {
    "merge": lambda grains: grains.merged([1, 2]),
    "delete": lambda grains: grains.without([2]),
    "grow": lambda grains: grains.grown([1]),
    "split": lambda grains: grains.split_along(1, [(30, 0, 12), (30, 60, 12)]),
    "two, one after the other": lambda grains: grains.shrunk([1]).grown([2]),
}


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
@pytest.mark.parametrize("longest", [200, 50], ids=["every voxel", "every third"])
def test_what_is_put_in_is_what_drawing_anew_gives(edit, longest):
    before = large_grains()
    overview = GrainOverview.of(before, longest, 10**6)
    same(overview.surface, before, longest)
    after = edit(before)
    assert overview.follows(after)
    corrected = overview.updated(after)
    same(corrected.surface, after, longest)
    # And undone.
    same(corrected.updated(before).surface, before, longest)


def test_the_rest_is_not_touched():
    before = large_grains()
    overview = GrainOverview.of(before, LONGEST, 10**6)
    corrected = overview.updated(before.grown([1]))
    far = overview.surface.labels == 5
    again = corrected.surface.labels == 5
    assert np.array_equal(
        overview.surface.points[overview.surface.triangles[far]],
        corrected.surface.points[corrected.surface.triangles[again]],
    )


def test_marks_change_nothing_and_other_grains_are_drawn_anew():
    grains = large_grains()
    overview = GrainOverview.of(grains, LONGEST, 10**6)
    assert overview.updated(grains.excluded([3])).surface is overview.surface
    assert not overview.follows(placed_grains())
