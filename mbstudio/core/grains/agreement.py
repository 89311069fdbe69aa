"""How well a segmentation agrees with labels that are known to be true."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import SegmentationError


@dataclass(frozen=True)
class Agreement:
    """Scores of a label image against the truth.

    Attributes
    ----------
    foreground_iou : float
        Intersection over union of all grains together against all true grains together.
    f1 : float
        Harmonic mean of precision and recall of single grains; a grain counts as found when it
        and a true one share more than half of their union.
    matched, found, true : int
        Pairs that match, grains found, true grains.
    """

    foreground_iou: float
    f1: float
    matched: int
    found: int
    true: int


def agreement(labels: Int[np.ndarray, "*shape"], truth: Int[np.ndarray, "*shape"]) -> Agreement:
    """Score labels against true labels of the same shape (2-D or 3-D); 0 is void.

    Raises
    ------
    SegmentationError
        If the shapes differ.

    References
    ----------
    The matching at an IoU above 0.5 is that of the panoptic quality (Kirillov et al. 2019): no
    grain can match two.
    """
    if labels.shape != truth.shape:
        raise SegmentationError(
            f"Labels of shape {labels.shape} cannot be scored against {truth.shape}: "
            "give images of one shape."
        )
    _, found_index = np.unique(labels, return_inverse=True)
    _, true_index = np.unique(truth, return_inverse=True)
    # numpy numbers the values by size: 0, the void, comes first. Room is left for it where there is none.
    found_index = found_index.ravel() + (not (labels == 0).any())
    true_index = true_index.ravel() + (not (truth == 0).any())
    columns = int(true_index.max()) + 1
    rows = int(found_index.max()) + 1
    shared = np.bincount(found_index * columns + true_index, minlength=rows * columns).reshape(rows, columns)
    union = shared.sum(axis=1, keepdims=True) + shared.sum(axis=0, keepdims=True) - shared
    matched = int(np.count_nonzero(2 * shared[1:, 1:] > union[1:, 1:]))
    found, true = rows - 1, columns - 1
    both = int(shared[1:, 1:].sum())
    either = int(shared.sum() - shared[0, 0])
    return Agreement(
        foreground_iou=both / either if either else 1.0,
        f1=2 * matched / (found + true) if found + true else 1.0,
        matched=matched,
        found=found,
        true=true,
    )
