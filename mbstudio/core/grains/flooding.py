"""Watershed by flooding with a depth rule: parts touching grains where the neck between them is narrow."""

from __future__ import annotations

import edt
import numpy as np
from jaxtyping import Bool, Float, Int

from mbstudio.core.compiled import compiled

_LEVELS = 65_000


def map_distances(
    solid: Bool[np.ndarray, "Z Y X"], anisotropy: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> Float[np.ndarray, "Z Y X"]:
    """Return the landscape that grains are parted by: distances to the surface, not above 0 outside.

    What lies beyond the box counts as solid: a grain that is cut off is not the narrower for it.

    Parameters
    ----------
    solid : bool array, shape (Z, Y, X)
    anisotropy : tuple of float
        Edges (z, y, x) of a voxel over its shortest, in which distances are given.
    """
    distances: np.ndarray = edt.edt(
        np.ascontiguousarray(solid), anisotropy=anisotropy, black_border=False, parallel=0
    )
    np.nan_to_num(distances, copy=False, posinf=float(max(solid.shape)))
    # From the middle of the nearest void voxel to the surface: otherwise small necks look wide.
    distances -= 0.5
    distances *= solid
    return distances


def split_by_necks(
    landscape: Float[np.ndarray, "Z Y X"], splitting: float, least_depth: float
) -> tuple[Int[np.ndarray, "Z Y X"], int]:
    """Divide the positive part of a landscape (a distance map) into basins about its peaks.

    Voxels are flooded from the highest down. Where two basins meet, at the highest point of the
    neck between them, they are one grain if the neck is at least `splitting` times as high as
    the lower of their two peaks, or less than `least_depth` lower than it.

    Parameters
    ----------
    landscape : float32 array, shape (Z, Y, X)
        At most 0 outside; C-contiguous.
    splitting : float
        0 parts nothing that touches, 1 parts at every neck.
    least_depth : float
        In the unit of the landscape; takes out peaks that the voxel grid makes.

    Returns
    -------
    labels : int32 array, shape (Z, Y, X)
        Basins 1..n, 0 outside; each is one 26-connected piece.
    n : int

    Notes
    -----
    Where the landscape is a distance map, the height of a peak is the radius of the largest ball
    in the grain and that of the neck the radius of the largest ball that passes through it: the
    rule compares lengths, whatever the size of the grains.
    """
    top = float(landscape.max())
    if top <= 0:
        return np.zeros(landscape.shape, np.int32), 0
    index_type = np.int64 if landscape.size > np.iinfo(np.int32).max else np.int32
    order = np.empty(int(np.count_nonzero(landscape > 0)), index_type)
    _from_highest(landscape.reshape(-1), top, order)
    labels = np.zeros(landscape.shape, np.int32)
    parents = _flood(landscape, order, labels, splitting, least_depth)
    count = _renumber(labels.reshape(-1), parents)
    return labels, count


@compiled()
def _from_highest(heights: np.ndarray, top: float, order: np.ndarray) -> None:
    """Fill `order` with the flat indices of positive heights, highest first (counting sort, stable)."""
    scale = _LEVELS / top
    counts = np.zeros(_LEVELS + 2, np.int64)
    for index in range(heights.size):
        if heights[index] > 0:
            counts[_LEVELS - int(heights[index] * scale) + 1] += 1
    starts = np.cumsum(counts)
    for index in range(heights.size):
        if heights[index] > 0:
            level = _LEVELS - int(heights[index] * scale)
            order[starts[level]] = index
            starts[level] += 1


@compiled()
def _root(parents: np.ndarray, label: int) -> int:
    while parents[label] != label:
        parents[label] = parents[parents[label]]
        label = parents[label]
    return label


@compiled()
def _flood(  # noqa: C901 - compiled, one loop over the neighbours
    landscape: np.ndarray, order: np.ndarray, labels: np.ndarray, splitting: float, least_depth: float
) -> np.ndarray:
    """Flood the voxels in order; return the parents that merge the basins' first labels."""
    nz, ny, nx = landscape.shape
    parents = np.zeros(1024, np.int32)
    peaks = np.zeros(1024, np.float32)
    count = 0
    roots = np.zeros(26, np.int32)
    for position in range(order.size):
        index = order[position]
        z, rest = divmod(index, ny * nx)
        y, x = divmod(rest, nx)
        height = landscape[z, y, x]
        found, chosen, chosen_height = 0, 0, np.float32(-1)
        for dz in range(-1, 2):
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    kz, ky, kx = z + dz, y + dy, x + dx
                    if kz < 0 or ky < 0 or kx < 0 or kz >= nz or ky >= ny or kx >= nx:
                        continue
                    if labels[kz, ky, kx] == 0:
                        continue
                    root = _root(parents, labels[kz, ky, kx])
                    roots[found] = root
                    found += 1
                    if landscape[kz, ky, kx] > chosen_height:
                        chosen, chosen_height = root, landscape[kz, ky, kx]
        if found == 0:
            count += 1
            if count == parents.size:
                parents = np.concatenate((parents, np.zeros(count, np.int32)))
                peaks = np.concatenate((peaks, np.zeros(count, np.float32)))
            parents[count] = count
            peaks[count] = height
            labels[z, y, x] = count
            continue
        labels[z, y, x] = chosen
        for k in range(found):
            other, own = _root(parents, roots[k]), _root(parents, chosen)
            if other == own:
                continue
            lower = min(peaks[other], peaks[own])
            if height >= splitting * lower or lower - height < least_depth:
                if peaks[other] > peaks[own] or (peaks[other] == peaks[own] and other < own):
                    parents[own] = other
                else:
                    parents[other] = own
    return parents[: count + 1]


@compiled()
def _renumber(labels: np.ndarray, parents: np.ndarray) -> int:
    """Give merged basins one number each, 1..n, in order of their first voxel; return n."""
    numbers = np.zeros(parents.size, np.int32)
    count = 0
    for index in range(labels.size):
        if labels[index]:
            root = _root(parents, labels[index])
            if numbers[root] == 0:
                count += 1
                numbers[root] = count
            labels[index] = numbers[root]
    return count
