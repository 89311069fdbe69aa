"""Which voxels are grain: one threshold, or one that follows the interfaces from place to place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32
from scipy import ndimage

from mbstudio.core.grains.phases import Phases

UNEVEN = 0.2
"""Spread of the interfaces' middles, in contrasts, from which one threshold does not serve the whole scan."""
_AGREEING = 0.12  # contrasts between Otsu's threshold and the middle of the phases
_NEAR, _FAR = 2.5, 14.0  # voxels: over which the middles of interfaces are averaged
_COARSE = 4  # voxels to an edge of the grid for the wider average
_SLAB = 48


@dataclass(frozen=True, eq=False)
class LocalThreshold:
    """A threshold that is half-way between the phases wherever they meet.

    From the middles of the interfaces nearby, by weights that fall with the distance; far from all of
    them the threshold goes over to wider averages, and to one value. Interpolating a threshold between
    edges is the way of Yanowitz and Bruckstein (1989), *Computer Vision, Graphics, and Image Processing*
    46, 82.

    Attributes
    ----------
    shape : tuple of int
    places : int32 array, shape (m, 3)
    middles : float32 array, shape (m,)
    overall : float
        The value far from all interfaces.
    near : bool
        Whether interfaces are averaged over a few voxels, so that each grain has a threshold of its
        own; otherwise over many, which follows what drifts across the scan.
    """

    shape: tuple[int, int, int]
    places: Int32[np.ndarray, "m 3"]
    middles: Float32[np.ndarray, " m"]
    overall: float
    near: bool

    def slabs(self) -> Iterator[tuple[slice, Float32[np.ndarray, "z Y X"]]]:
        """Return the threshold, a slab along z at a time."""
        wide = self._wider_average()
        margin = int(np.ceil(4 * _NEAR))
        density = self._usual_density()
        for start in range(0, self.shape[0], _SLAB):
            stop = min(start + _SLAB, self.shape[0])
            if not self.near:
                yield slice(start, stop), _refined(wide, self.shape, start, stop)
                continue
            low, high = max(start - margin, 0), min(stop + margin, self.shape[0])
            first, last = np.searchsorted(self.places[:, 0], [low, high])
            middles, counts = self._scattered(slice(first, last), low, high)
            middles = ndimage.gaussian_filter(middles, _NEAR, mode="constant")[start - low : stop - low]
            counts = ndimage.gaussian_filter(counts, _NEAR, mode="constant")[start - low : stop - low]
            weight = np.float32(0.02 * density)
            yield (
                slice(start, stop),
                (middles + weight * _refined(wide, self.shape, start, stop)) / (counts + weight),
            )

    def _scattered(self, rows: slice, low: int, high: int) -> tuple[np.ndarray, np.ndarray]:
        """Return sums of middles, less the overall one, and counts in the voxels of a slab."""
        shape = (high - low, *self.shape[1:])
        places = self.places[rows]
        flat = np.ravel_multi_index((places[:, 0] - low, places[:, 1], places[:, 2]), shape)
        counts = np.zeros(int(np.prod(shape)), np.float32)
        sums = counts.copy()
        counts[flat] = 1.0
        sums[flat] = self.middles[rows]
        return sums.reshape(shape), counts.reshape(shape)

    def _usual_density(self) -> float:
        """Return about what the weights of the nearer average come to at an interface: those of a plane."""
        return float(1.0 / (np.sqrt(2.0 * np.pi) * _NEAR))

    def _wider_average(self) -> Float32[np.ndarray, "a b c"]:
        """Return the wider average on a coarse grid."""
        shape = tuple(-(-count // _COARSE) for count in self.shape)
        flat = np.ravel_multi_index(tuple((self.places // _COARSE).T), shape)
        size = int(np.prod(shape))
        counts = np.bincount(flat, minlength=size).reshape(shape).astype(np.float32)
        sums = np.bincount(flat, weights=self.middles, minlength=size).reshape(shape).astype(np.float32)
        counts = ndimage.gaussian_filter(counts, _FAR / _COARSE, mode="constant")
        sums = ndimage.gaussian_filter(sums, _FAR / _COARSE, mode="constant")
        weight = np.float32(1e-3 * float(counts.max()))
        return np.asarray((sums + weight * np.float32(self.overall)) / (counts + weight))


def _refined(
    coarse: Float32[np.ndarray, "a b c"], shape: tuple[int, int, int], start: int, stop: int
) -> Float32[np.ndarray, "z Y X"]:
    """Return a slab of a coarse grid's values on the voxels, linear in between."""
    fine = coarse
    for axis, (count, first, last) in enumerate(
        zip(shape, (start, 0, 0), (stop, shape[1], shape[2]), strict=True)
    ):
        at = np.clip((np.arange(first, last) - 0.5 * (_COARSE - 1)) / _COARSE, 0, coarse.shape[axis] - 1)
        below = np.minimum(at.astype(np.intp), max(coarse.shape[axis] - 2, 0))
        share = (at - below).astype(np.float32).reshape([-1 if a == axis else 1 for a in range(3)])
        above = np.minimum(below + 1, coarse.shape[axis] - 1)
        fine = np.take(fine, below, axis=axis) * (1 - share) + np.take(fine, above, axis=axis) * share
        del count
    return fine


def threshold_of(phases: Phases, otsu: float, shape: tuple[int, int, int]) -> float | LocalThreshold:
    """Return the threshold that parts grains from what lies between them.

    Parameters
    ----------
    phases : Phases
    otsu : float
        Otsu's threshold. It is kept where it agrees with the interfaces: it makes use of all voxels.
    shape : tuple of int
        (Z, Y, X) of the scan.
    """
    if phases.liquid is None and (len(phases.tones) > 1 or phases.spread > UNEVEN):
        own = phases.interfaces
        if len(phases.tones) > 1:
            return LocalThreshold(shape, own.places, own.middles, phases.middle, near=True)
        places, middles = phases.whole_middles
        return LocalThreshold(shape, places, middles, float(np.median(middles)), near=False)
    if abs(otsu - phases.middle) <= _AGREEING * phases.contrast and phases.liquid is None:
        return otsu
    return phases.middle


def brighter_than(
    grey: Float[np.ndarray, "Z Y X"], threshold: float | LocalThreshold
) -> Bool[np.ndarray, "Z Y X"]:
    """Return which voxels are brighter than a threshold."""
    if isinstance(threshold, LocalThreshold):
        bright = np.empty(grey.shape, np.bool_)
        for rows, values in threshold.slabs():
            np.greater(grey[rows], values, out=bright[rows])
        return bright
    return np.asarray(grey > threshold)
