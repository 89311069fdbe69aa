"""Impulses: single voxels far brighter or darker than all around them, from dead pixels and stray photons."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Shaped

from mbstudio.core.compiled import compiled

FEWEST = 2e-3
"""Share of the voxels from which impulses harm the finding of grains."""
_RANK = (
    6  # this many of 26 neighbours may be impulses too; a film of one voxel has eight neighbours of its own
)
_STANDING_OUT = 3.5  # deviations of the noise, beyond the sixth of the neighbours
_LEAST = 0.35  # of the range of grey values
_SAMPLED = 2_000_000
_PASSES = 3


def without_impulses(
    voxels: Shaped[np.ndarray, "Z Y X"], seen: Bool[np.ndarray, "Z Y X"]
) -> tuple[Shaped[np.ndarray, "Z Y X"], float]:
    """Return the voxels with each impulse replaced by the median of its 26 neighbours, and their share.

    An impulse is brighter, or darker, than all but five of its neighbours by 3.5 deviations of the noise and
    a third of the range of grey values. Fewer than two in a thousand are left as they are: then the very same
    array is returned.

    Parameters
    ----------
    voxels : array, shape (Z, Y, X)
    seen : bool array, shape (Z, Y, X)
        The field of view.
    """
    if min(voxels.shape) < 3:
        return voxels, 0.0
    readable = voxels
    if not voxels.dtype.isnative or voxels.dtype == np.float16:  # which compiled code does not read
        readable = voxels.astype(np.float32 if voxels.dtype == np.float16 else voxels.dtype.newbyteorder("="))
    places = _find(readable, seen, _least_step(readable, seen), _RANK)
    share = len(places) / max(int(np.count_nonzero(seen)), 1)
    if share < FEWEST:
        return voxels, share
    # No other copy is made: how much memory a segmentation takes is told before it begins.
    mended = readable.copy() if readable is voxels else readable
    mended[tuple(places.T)] = _medians(mended, places)
    for _ in range(_PASSES - 1):  # those that lay side by side
        places = _find(mended, seen, _least_step(mended, seen), _RANK)
        mended[tuple(places.T)] = _medians(mended, places)
    return mended, share


def _least_step(voxels: Shaped[np.ndarray, "Z Y X"], seen: Bool[np.ndarray, "Z Y X"]) -> float:
    """Return how far an impulse stands out: beyond noise and beyond what blurred edges leave."""
    step = max(1, round((voxels.size / _SAMPLED) ** (1 / 3)))
    inner = (slice(1, -1, step),) * 3
    middle = voxels[inner].astype(np.float64)
    around = np.zeros_like(middle)
    for axis, count in enumerate(voxels.shape):
        for shift in (0, 2):
            moved = list(inner)
            moved[axis] = slice(shift, count - 2 + shift, step)
            around += voxels[tuple(moved)]
    chosen = seen[inner]
    if not chosen.any():
        return np.inf
    away, grey = (middle - around / 6.0)[chosen], middle[chosen]
    # The median absolute deviation from six neighbours' mean, as that of one voxel.
    noise = 1.4826 * float(np.median(np.abs(away - np.median(away)))) / np.sqrt(7.0 / 6.0)
    low, high = np.quantile(grey, (0.1, 0.9))  # a tenth may be impulses
    return float(max(_STANDING_OUT * noise, _LEAST * float(high - low)))


@compiled()
def _find(  # noqa: C901  # pragma: no cover - compiled, one loop over the neighbours
    voxels: np.ndarray, seen: np.ndarray, least: float, rank: int
) -> np.ndarray:
    """Return the places (z, y, x) of impulses."""
    nz, ny, nx = voxels.shape
    room = 4096
    places = np.empty((room, 3), np.int64)
    count = 0
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                if not seen[z, y, x]:
                    continue
                value = float(voxels[z, y, x])
                brighter, darker, around = 0, 0, 0
                for k in range(27):
                    i, j, m = z + k // 9 - 1, y + (k // 3) % 3 - 1, x + k % 3 - 1
                    if k == 13 or i < 0 or j < 0 or m < 0 or i >= nz or j >= ny or m >= nx:
                        continue
                    if not seen[i, j, m]:
                        continue
                    around += 1
                    step = value - float(voxels[i, j, m])
                    if step > least:
                        brighter += 1
                    elif step < -least:
                        darker += 1
                    # Most voxels are left after their first six neighbours.
                    if around - max(brighter, darker) >= rank:
                        break
                # On the faces of the box and at the rim of what is seen there are fewer.
                if around < 9 or around - max(brighter, darker) >= max(1, rank * around // 26):
                    continue
                if count == room:
                    room *= 2
                    more = np.empty((room, 3), np.int64)
                    more[:count] = places
                    places = more
                places[count, 0], places[count, 1], places[count, 2] = z, y, x
                count += 1
    return places[:count].copy()


@compiled()
def _medians(voxels: np.ndarray, places: np.ndarray) -> np.ndarray:  # pragma: no cover
    """Return the median of the neighbours of each place."""
    nz, ny, nx = voxels.shape
    values = np.empty(26, voxels.dtype)
    found = np.empty(len(places), voxels.dtype)
    for row in range(len(places)):
        z, y, x = places[row, 0], places[row, 1], places[row, 2]
        count = 0
        for i in range(max(z - 1, 0), min(z + 2, nz)):
            for j in range(max(y - 1, 0), min(y + 2, ny)):
                for k in range(max(x - 1, 0), min(x + 2, nx)):
                    if i != z or j != y or k != x:
                        values[count] = voxels[i, j, k]
                        count += 1
        ordered = np.sort(values[:count])
        found[row] = ordered[count // 2]
    return found
