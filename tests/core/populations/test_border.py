"""Weights of grains inside a scan: against a count of all places that a grain could have had."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains import GrainSet
from mbstudio.core.populations.border import border_weights
from mbstudio.core.units import VoxelSize


def cubes(size, places, shape):
    """Return cubes of voxels at these corners (z, y, x)."""
    labels = np.zeros(shape, dtype=np.int32)
    rows = []
    for label, (edge, corner) in enumerate(zip(size, places, strict=True), 1):
        ends = [min(c + edge, s) for c, s in zip(corner, shape, strict=True)]
        labels[tuple(slice(c, e) for c, e in zip(corner, ends, strict=True))] = label
        box = {f"{a}{k}": v for a, c, e in zip("zyx", corner, ends, strict=True) for k, v in ((0, c), (1, e))}
        touches = any(c <= 0 or e >= s for c, e, s in zip(corner, ends, shape, strict=True))
        rows.append({"label": label, **box, "touches_border": touches})
    return GrainSet(labels, pd.DataFrame(rows), VoxelSize(1, 1, 1, "mm"))


def test_each_stands_for_as_many_as_were_cut():
    shape = (20, 24, 30)
    grains = cubes([4, 10], [(3, 3, 3), (5, 9, 15)], shape)
    found = border_weights(grains, [1, 2])
    expected = [np.prod([(s - 2) / (s - 2 - edge + 1) for s in shape]) for edge in (4, 10)]
    assert found == pytest.approx(expected)
    assert found[1] > found[0] > 1


def test_the_share_of_large_grains_comes_back():
    """Cubes thrown at random: those inside, weighted, are as many of each size as were thrown into the
    field."""
    rng, shape = np.random.default_rng(1), np.array([40, 40, 40])
    kept = {3: 0, 15: 0}
    for _ in range(4000):
        for edge in kept:
            # Corners anywhere so that the cube may stick out on any side.
            corner = rng.integers(-edge, shape)
            kept[edge] += bool(((corner >= 1) & (corner + edge <= shape - 1)).all())
    grains = cubes([3, 15], [(4, 4, 4), (12, 12, 12)], tuple(shape))
    weights = dict(zip((3, 15), border_weights(grains, [1, 2]), strict=True))
    density = {edge: kept[edge] * weights[edge] / 4000 * np.prod(shape + edge) for edge in kept}
    # As many corners a volume were thrown of each.
    assert density[15] / density[3] == pytest.approx(1.0, rel=0.12)
    assert kept[15] / kept[3] * np.prod(shape + 15) / np.prod(shape + 3) < 0.5, "uncorrected"


def test_what_cannot_be_corrected_is_refused():
    grains = cubes([4, 18, 4], [(0, 3, 3), (1, 1, 1), (5, 5, 25)], (20, 20, 40))
    with pytest.raises(MeasureError, match="cuts grain 1"):
        border_weights(grains, [1])
    with pytest.raises(MeasureError, match="no grain 9"):
        border_weights(grains, [9])
    assert border_weights(grains, [2])[0] > 10
