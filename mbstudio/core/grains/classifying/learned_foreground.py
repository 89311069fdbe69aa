"""Which voxels are grain by a classifier, and what lies between touching grains."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Int, Int64, Shaped

from mbstudio.core.compiled import compiled
from mbstudio.core.grains.classifying.grey_levels import GreyLevels
from mbstudio.core.grains.classifying.voxel_classifier import BORDER, VOID, VoxelClassifier
from mbstudio.core.scan.field_of_view import FieldOfView
from mbstudio.core.scan.scan import Scan

Progress = Callable[[float, str], None]


def classify_foreground(
    classifier: VoxelClassifier,
    scan: Scan,
    voxels: Shaped[np.ndarray, "Z Y X"],
    view: FieldOfView,
    progress: Progress,
) -> tuple[Bool[np.ndarray, "Z Y X"], Bool[np.ndarray, "Z Y X"]]:
    """Return which voxels are solid, and which of these are borders between grains.

    Parameters
    ----------
    classifier : VoxelClassifier
    scan : Scan
    voxels : array, shape (Z, Y, X)
        Its grey values, finite ones.
    view : FieldOfView
    progress : callable
        ``progress(fraction, message)``; what it raises ends the work.

    Raises
    ------
    ClassifierError
        If the scan is unlike the one that was learned in.
    """
    levels = GreyLevels.of(scan, voxels, view)
    classifier.require_fits(levels, scan)
    kinds = classifier.classified(levels, progress=progress)
    return kinds != VOID, kinds == BORDER


def grow_into_borders(labels: Int[np.ndarray, "Z Y X"], border: Bool[np.ndarray, "Z Y X"]) -> None:
    """Give the voxels of borders to the grains beside them, in place, one layer after the other.

    Of several grains that touch a voxel with a face, that with most faces takes it, of equal ones the lower
    number.
    """
    waiting = np.flatnonzero(border & (labels == 0))
    while len(waiting):
        taken = np.zeros(len(waiting), labels.dtype)
        _choose(labels, waiting, taken)
        if not taken.any():
            return
        labels.reshape(-1)[waiting] = taken
        waiting = waiting[taken == 0]


@compiled()
def _choose(labels: Int[np.ndarray, "Z Y X"], waiting: Int64[np.ndarray, " n"], taken: np.ndarray) -> None:
    nz, ny, nx = labels.shape
    beside = np.zeros(6, np.int64)
    for row in range(waiting.size):
        z, rest = divmod(waiting[row], ny * nx)
        y, x = divmod(rest, nx)
        count = 0
        for axis in range(3):
            for step in (-1, 1):
                a = z + step if axis == 0 else z
                b = y + step if axis == 1 else y
                c = x + step if axis == 2 else x
                if 0 <= a < nz and 0 <= b < ny and 0 <= c < nx and labels[a, b, c] > 0:
                    beside[count] = labels[a, b, c]
                    count += 1
        best, most = 0, 0
        for i in range(count):
            same = 0
            for j in range(count):
                same += beside[j] == beside[i]
            if same > most or (same == most and beside[i] < best):
                best, most = beside[i], same
        taken[row] = best
