"""Connected pieces of masks, also of rows of voxels, at which the library gives up for truth values."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains import Grain
from mbstudio.core.grains.pieces import label_pieces, largest_piece
from mbstudio.core.metrics import measure


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("row", [[1, 0, 1], [1, 0, 1, 0, 1], [1, 1, 0, 1]])
def test_pieces_of_a_row_of_voxels(row, axis):
    shape = [1, 1, 1]
    shape[axis] = len(row)
    mask = np.array(row, dtype=bool).reshape(shape)
    pieces, sizes = label_pieces(mask)
    wanted = [len(part) for part in "".join(map(str, row)).split("0")]
    assert sizes.tolist() == wanted
    assert (pieces > 0).ravel().tolist() == mask.ravel().tolist()
    assert largest_piece(mask).sum() == max(wanted)


def test_a_grain_of_two_voxels_apart_is_one_of_its_pieces():
    grain = Grain.from_mask(np.array([[[True, False, True]]]), "10 um", name="two", keep="largest")
    assert grain.voxel_count == 1
    with pytest.raises(MeasureError, match="one voxel thick"):
        measure(grain)
