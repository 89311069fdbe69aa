"""Grains that are several, or parts of one, stand at the head of the list, with the reason."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import GrainError
from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.grains.suspicion.scoring import BORDERLINE
from mbstudio.core.scan import Scan
from tests.core.grains.degraded import packed, scanned
from tests.core.grains.editing.placed_grains import SIZE, ball, placed_grains, scan_of


def test_a_fused_grain_comes_first_with_its_neck():
    grains = placed_grains()
    ranked = grains.suspicion(scan_of(grains.labels))
    assert ranked["label"].iloc[0] == 3
    assert ranked["kind"].iloc[0] == "merged"
    assert ranked["score"].iloc[0] > BORDERLINE > ranked["score"].iloc[1]
    assert "a neck" in ranked["reasons"].iloc[0]
    assert "of its convex hull" in ranked["reasons"].iloc[0]
    assert sorted(ranked["label"]) == [1, 2, 3, 4]


def test_halves_of_a_ball_are_more_suspicious_than_balls_that_touch():
    shape = (40, 40, 90)
    labels = np.zeros(shape, np.int32)
    labels[ball(shape, (20, 20, 18), 13)] = 1
    labels[:, :, 19:][labels[:, :, 19:] == 1] = 2
    labels[ball(shape, (20, 20, 50), 10)] = 3
    labels[ball(shape, (20, 20, 69), 10) & (labels == 0)] = 4
    ranked = build_grain_set(labels, SIZE).suspicion()
    assert set(ranked["label"].iloc[:2]) == {1, 2}
    assert ranked["kind"].iloc[0] == "split"
    assert ranked.set_index("label")["neighbour"][1] == 2
    assert "convex together with grain" in ranked["reasons"].iloc[0]


def test_merged_grains_of_a_packing_are_found_first():
    truth = packed(3)
    grains = build_grain_set(truth.copy(), SIZE)
    scan = Scan(scanned(truth), SIZE)
    ranked = grains.suspicion(scan).set_index("label")
    pairs = [(int(label), int(ranked["neighbour"][label])) for label in ranked.index]
    one, other = next((a, b) for a, b in pairs if b and ranked["shared"][a] > 0.1)
    merged = grains.merged([one, other])
    again = merged.suspicion(scan)
    assert again.set_index("label")["score"][one] > 2 * ranked["score"][one]
    assert one in again["label"].iloc[: max(3, len(again) // 10)].tolist()


def test_a_large_residual_of_the_fit_speaks_against_a_grain():
    grains = placed_grains()
    plain = grains.suspicion().set_index("label")["score"]
    ranked = grains.suspicion(residuals={1: 0.01, 2: 0.05, 3: 0.01, 4: 0.01}).set_index("label")
    assert ranked["score"][2] > 2 * plain[2]
    assert ranked["score"][1] == plain[1]
    assert "its avatar is off by 5.0%" in ranked["reasons"][2]


def test_a_scan_of_another_shape_is_refused():
    with pytest.raises(GrainError, match="give the scan that the grains were found in"):
        placed_grains().suspicion(Scan(np.zeros((5, 5, 5), np.float32), SIZE))
