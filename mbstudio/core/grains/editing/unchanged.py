"""Which grains of one set are, voxel by voxel, grains of another set of the same scan."""

from __future__ import annotations

import numpy as np

from mbstudio.core.grains.editing.boxes import box_of_row
from mbstudio.core.grains.editing.editable import EditableGrains

_BOX = ("z0", "z1", "y0", "y1", "x0", "x1")


def match_unchanged(before: EditableGrains, after: EditableGrains) -> dict[int, int]:
    """Return, by the number of each grain that has the same voxels in both, its number in the other.

    Parameters
    ----------
    before, after : GrainSet
        Nothing matches where they are not of one shape, voxel size and origin.

    Returns
    -------
    dict of int to int
        From numbers in `before` to numbers in `after`, ascending.
    """
    place = (before.label_volume.shape, before.voxel_size, tuple(before.origin))
    if place != (after.label_volume.shape, after.voxel_size, tuple(after.origin)):
        return {}
    columns = ["voxels", *_BOX]
    known = {
        tuple(row): label
        for label, row in zip(
            after.table["label"].tolist(), after.table[columns].to_numpy().tolist(), strict=True
        )
    }
    matched = {}
    for label, row in zip(
        before.table["label"].tolist(), before.table[columns].to_numpy().tolist(), strict=True
    ):
        other = known.get(tuple(row))
        if other is None:
            continue
        box = box_of_row(row[1:])
        # As many voxels in the same box may still be others.
        if np.array_equal(before.label_volume[box] == label, after.label_volume[box] == other):
            matched[label] = other
    return matched
