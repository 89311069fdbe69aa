from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import SegmentationError
from mbstudio.core.grains.agreement import agreement


def test_the_truth_agrees_with_itself_whatever_its_numbers(rng):
    truth = rng.integers(0, 6, (5, 6, 7))
    renumbered = np.array([0, 40, 3, 9, 12, 700])[truth]
    scored = agreement(renumbered, truth)
    assert (scored.foreground_iou, scored.f1, scored.matched) == (1.0, 1.0, 5)


def test_scores_worked_out_by_hand():
    truth = np.array([[1, 1, 1, 0, 2, 2, 2, 2, 0, 3]])
    found = np.array([[5, 5, 0, 0, 6, 6, 7, 7, 7, 0]])
    # 5 matches 1 (2 of 3); 6 shares exactly half of 2, which is not more than half; 7 shares 2
    # of 5; 3 is missed. Foreground: 6 shared of 9.
    scored = agreement(found, truth)
    assert scored.foreground_iou == pytest.approx(6 / 9)
    assert (scored.matched, scored.found, scored.true) == (1, 3, 3)
    assert scored.f1 == pytest.approx(2 * 1 / 6)


def test_images_without_void_have_no_hidden_grain():
    scored = agreement(np.array([[1, 1, 2]]), np.array([[4, 4, 4]]))
    assert (scored.found, scored.true, scored.matched) == (2, 1, 1)
    assert scored.foreground_iou == 1.0


def test_nothing_found_of_nothing():
    scored = agreement(np.zeros((2, 2), int), np.zeros((2, 2), int))
    assert (scored.f1, scored.foreground_iou) == (1.0, 1.0)


def test_shapes_must_agree():
    with pytest.raises(SegmentationError, match="cannot be scored"):
        agreement(np.zeros((2, 2), int), np.zeros((2, 3), int))
