"""A new grain by flooding from a click."""

from __future__ import annotations

import math

import numpy as np

from mbstudio.core.errors import EditError
from mbstudio.core.grains.editing.boxes import Voxel, widened
from mbstudio.core.grains.editing.label_volume import Box
from mbstudio.core.grains.editing.workbench import CRUMB_VOXELS, Workbench
from mbstudio.core.grains.pieces import label_pieces

_FIRST_REACH = 32  # voxels about the click
_MOST_VOXELS = 20_000_000


def flood_from(bench: Workbench, at: Voxel, threshold: float | None) -> float:
    """Make a grain of what hangs together with a voxel on its side of a threshold and is no grain yet.

    Parameters
    ----------
    at : tuple of int
        The voxel (z, y, x).
    threshold : float or None
        Grey value; None for the middle between grains and void about the voxel.

    Returns
    -------
    float
        The threshold.

    Raises
    ------
    EditError
        If the voxel belongs to a grain, lies beyond the field of view, is hardly joined to any other, or the
        flood comes to no end.
    """
    found = bench.label_at(at, "The place at")
    if found:
        raise EditError(
            f"The voxel (z, y, x) = {tuple(at)} belongs to grain {found}: click outside all grains."
        )
    z, y, x = (slice(index, index + 1) for index in at)
    if not bench.seen((z, y, x)).any():
        raise EditError(f"The voxel (z, y, x) = {tuple(at)} lies beyond the field of view: click inside it.")
    level = _middle_level(bench, at) if threshold is None else float(threshold)
    if not math.isfinite(level):
        raise EditError(f"threshold={threshold} is impossible: give a grey value.")
    about = bench.grey(widened((z, y, x), 1, bench.shape))
    brighter = bool(float(np.median(about)) >= level)
    reach = _FIRST_REACH
    while True:
        box = widened((z, y, x), reach, bench.shape)
        grey, labels = bench.grey(box), bench.read(box)
        solid = ((grey >= level) if brighter else (grey < level)) & (labels == 0) & bench.seen(box)
        place = tuple(index - part.start for index, part in zip(at, box, strict=True))
        if not solid[place]:
            raise EditError(
                f"The voxel (z, y, x) = {tuple(at)} of grey value {float(grey[place]):g} lies on the other "
                f"side of the threshold {level:g} than what is around it: click deeper inside the grain."
            )
        pieces, counts = label_pieces(solid)
        number = int(pieces[place])
        piece = pieces == number
        if counts[number - 1] > _MOST_VOXELS:
            raise EditError(
                f"The flood from (z, y, x) = {tuple(at)} at the threshold {level:g} comes to no end: choose "
                "a threshold that parts the grain from the void."
            )
        if not _reaches_on(piece, box, bench.shape):
            break
        reach *= 2
    if counts[number - 1] <= CRUMB_VOXELS:
        raise EditError(
            f"Only {int(counts[number - 1])} voxels hang together at (z, y, x) = {tuple(at)} at the "
            f"threshold {level:g}: click inside a grain, or choose another threshold."
        )
    values = labels.copy()
    values[piece] = bench.new_label()
    bench.write(box, values)
    return level


def _reaches_on(piece: np.ndarray, box: Box, shape: tuple[int, int, int]) -> bool:
    """Whether a piece may go on beyond its box."""
    for axis, (part, count) in enumerate(zip(box, shape, strict=True)):
        if part.start > 0 and piece.take(0, axis).any():
            return True
        if part.stop < count and piece.take(-1, axis).any():
            return True
    return False


def _middle_level(bench: Workbench, at: Voxel) -> float:
    """Return the grey value in the middle between grains and void about a voxel."""
    z, y, x = (slice(index, index + 1) for index in at)
    box = widened((z, y, x), 2 * _FIRST_REACH, bench.shape)
    labels, grey, seen = bench.read(box), bench.grey(box), bench.seen(box)
    solid, void = grey[labels > 0], grey[(labels == 0) & seen]
    if not len(solid) or not len(void):
        raise EditError(
            "There are no grains about the place from which a threshold could be told: state the threshold."
        )
    return 0.5 * (float(np.median(solid)) + float(np.median(void)))
