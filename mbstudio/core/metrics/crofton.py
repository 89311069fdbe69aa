"""Surface area of a voxel grain by Crofton's formula, without meshing it.

A quarter of the area of a convex body is its mean projected area, and for any body the mean
number of times that lines enter it. The lines run through neighbouring voxels in 13 directions,
each weighted by the share of the sphere that is closer to it than to the others.

Three errors are left, and :func:`corrected_crofton_area` takes them away:

* A line looks at the body only once a step, and misses chords (and gaps) shorter than that. Where
  faces meet in an edge, chords of every length down to none occur: a cube 24 voxels wide loses
  2 %. If chords between lengths 0 and 3 steps are spread by a law linear in length, which holds near
  edges (evenly) and near a smooth rim (in proportion to length), the number missed is
  5/6 of the runs of one voxel less 1/3 of those of two.
* 13 directions weigh flat faces up to 3 % wrong, by how they happen to lie. Which way
  the surface faces is known from a smoothed copy of the mask well enough to divide this out.
* Few lines meet a small grain, so that the count scatters. Where the grain is thick enough for
  longer steps, 25 or 49 directions are used.

References
----------
Legland, Kieu & Devaux (2007), Computation of Minkowski measures on 2D and 3D binary images,
Image Analysis & Stereology 26, 83-92.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from math import gcd

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage
from scipy.spatial import SphericalVoronoi

from mbstudio.core.compiled import compiled
from mbstudio.core.units import VoxelSize

Direction = tuple[tuple[int, ...], float, float]
"""Shift (z, y, x) in voxels, step length in unit, weight."""

_MISSED = (5.0 / 6.0, -1.0 / 3.0)
"""Chords missed for each run of one and of two voxels; see the module's text."""
_SQUARED_STEPS = (5, 9)
"""Lattice vectors up to these squared lengths: 25 and 49 directions."""
_STEPS_IN_CHORD = 3.5
"""A set of directions is used where its longest step goes so often into the mean chord 4 V / A."""
_REACH = 2
"""Largest component of any direction's step, in voxels."""
_SMOOTHING = 1.4
"""Of the mask whose gradient says where its faces look, in longest voxel edges."""
_MOST_VOXELS = 130
"""Longest side of the mask that is smoothed; larger ones are averaged in blocks."""


def crofton_area(mask: Bool[np.ndarray, "Z Y X"], voxel_size: VoxelSize) -> float:
    """Return the surface area of a mask in unit**2, by the plain formula.

    Parameters
    ----------
    mask : bool array, shape (Z, Y, X)
        Everything outside the array counts as empty.
    voxel_size : VoxelSize
        May be anisotropic: the weights of the directions follow.
    """
    directions = _directions(voxel_size.zyx)
    runs, _ = _runs_and_gaps(mask, directions)
    return _sum_area(runs.sum(axis=1), directions, voxel_size)


def corrected_crofton_area(mask: Bool[np.ndarray, "Z Y X"], voxel_size: VoxelSize) -> float:
    """Return the surface area of a mask in unit**2, corrected for missed chords and for faces.

    Parameters
    ----------
    mask : bool array, shape (Z, Y, X)
        Everything outside the array counts as empty.
    voxel_size : VoxelSize

    Notes
    -----
    Of solids from 15 voxels radius upwards, round or sharp-edged, the mean over poses is within
    0.3 %. A plate thinner than three voxels looks like a wedge and comes out too large.
    """
    edges = voxel_size.zyx
    candidates = [_directions(edges), *(_directions(edges, most) for most in _SQUARED_STEPS)]
    directions = candidates[0]
    runs, gaps = _runs_and_gaps(mask, directions)
    entries = runs.sum(axis=1) + (runs[:, :2] + gaps[:, :2]) @ np.array(_MISSED)
    volume = int(np.count_nonzero(mask)) * voxel_size.volume
    chord = 4.0 * volume / _sum_area(entries, directions, voxel_size)
    fitting = [
        more for more in candidates[1:] if max(length for _, length, _ in more) * _STEPS_IN_CHORD <= chord
    ]
    if fitting:
        directions = fitting[-1]
        runs, gaps = _runs_and_gaps(mask, directions)
        entries = runs.sum(axis=1) + (runs[:, :2] + gaps[:, :2]) @ np.array(_MISSED)
    # What a body facing as this one does would be found to have, over what it has.
    bias = 4.0 * sum(
        w * s for (_, _, w), s in zip(directions, _seen_shares(mask, voxel_size, directions), strict=True)
    )
    return _sum_area(entries, directions, voxel_size) / float(bias)


def _sum_area(entries: Float[np.ndarray, " d"], directions: list[Direction], voxel_size: VoxelSize) -> float:
    """Return the area that so many entries of lines along each direction stand for."""
    total = sum(w * n / length for (_, length, w), n in zip(directions, entries, strict=True))
    return float(4.0 * total * voxel_size.volume)


def _runs_and_gaps(
    mask: Bool[np.ndarray, "Z Y X"], directions: list[Direction]
) -> tuple[Float[np.ndarray, "d 3"], Float[np.ndarray, "d 3"]]:
    """Count runs of voxels inside by length 1, 2, 3 and more, and gaps of length 1 and 2."""
    padded = np.pad(mask, _REACH)
    core = padded
    for axis in range(3):
        core = np.logical_and.reduce([np.roll(core, k, axis=axis) for k in range(-_REACH, _REACH + 1)])
    shifts = np.array([shift for shift, _, _ in directions], dtype=np.int64)
    return _count(padded, padded & ~core, shifts)


def _seen_shares(
    mask: Bool[np.ndarray, "Z Y X"], voxel_size: VoxelSize, directions: list[Direction]
) -> Float[np.ndarray, " d"]:
    """Return the projected area along each direction, counted once a sheet, over the surface area.

    The gradient of the smoothed mask, summed over all voxels, is the surface's area vector by
    where it looks (the co-area formula).
    """
    share, edges = block_shares(mask, voxel_size.zyx, _MOST_VOXELS)
    sigma = _SMOOTHING * max(edges) / np.array(edges)
    padded = np.pad(share, [(int(np.ceil(3 * s)) + 1,) * 2 for s in sigma])
    smooth = ndimage.gaussian_filter(padded, sigma, truncate=3.0)
    near = (smooth > 0.01) & (smooth < 0.99)
    slopes = [np.gradient(smooth, edge, axis=axis)[near] for axis, edge in enumerate(edges)]
    gradient = np.stack(slopes[::-1], axis=1)
    total = float(np.linalg.norm(gradient, axis=1).sum())
    units = np.array([np.array(shift[::-1]) * voxel_size.xyz / length for shift, length, _ in directions])
    seen = np.abs(gradient @ units.T.astype(np.float32)).sum(axis=0, dtype=np.float64)
    shares: np.ndarray = 0.5 * seen / total
    return shares


def block_shares(
    mask: Bool[np.ndarray, "Z Y X"], edges: tuple[float, float, float], most: int
) -> tuple[Float[np.ndarray, "z y x"], tuple[float, float, float]]:
    """Average a mask in cubic blocks until its longest side has at most `most`; return it and the new edges.

    The last blocks are filled up with emptiness. Shares keep the volume and the place of the surface.
    """
    block = -(-max(mask.shape) // most)
    if block == 1:
        return mask.astype(np.float32), edges
    padded = np.pad(mask, [(0, -size % block) for size in mask.shape])
    z, y, x = (size // block for size in padded.shape)
    blocks = padded.reshape(z, block, y, block, x, block)
    share = blocks.sum(axis=(1, 3, 5), dtype=np.float32) / np.float32(block**3)
    return share, (edges[0] * block, edges[1] * block, edges[2] * block)


@compiled()
def _count(mask: np.ndarray, rind: np.ndarray, shifts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Count runs and gaps; `rind` are the voxels inside that are close to the outside.

    The mask has an empty rim as wide as the longest shift.
    """
    nz, ny, nx = mask.shape
    runs = np.zeros((len(shifts), 3))
    gaps = np.zeros((len(shifts), 3))
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                if not rind[z, y, x]:
                    continue
                for k in range(len(shifts)):
                    dz, dy, dx = shifts[k]
                    if not mask[z - dz, y - dy, x - dx]:
                        length = 1
                        pz, py, px = z + dz, y + dy, x + dx
                        while length < 3 and mask[pz, py, px]:
                            length += 1
                            pz, py, px = pz + dz, py + dy, px + dx
                        runs[k, length - 1] += 1
                    pz, py, px = z + dz, y + dy, x + dx
                    length = 0
                    while length < 3 and not mask[pz, py, px]:
                        length += 1
                        pz, py, px = pz + dz, py + dy, px + dx
                        if not (0 <= pz < nz and 0 <= py < ny and 0 <= px < nx):
                            length = 3
                    if 0 < length < 3:
                        gaps[k, length - 1] += 1
    return runs, gaps


@lru_cache(maxsize=48)
def _directions(edges: tuple[float, float, float], squared: int = 3) -> list[Direction]:
    """Return shift, step length and weight of the directions of lattice vectors up to a squared length.

    By default the 13 to a voxel's neighbours. The weights sum to 1.
    """
    span = range(-_REACH, _REACH + 1)
    shifts = [
        shift
        for shift in product(span, repeat=3)
        if gcd(*shift) == 1 and sum(s * s for s in shift) <= squared
    ]
    steps = np.array(shifts, dtype=float) * edges
    lengths = np.linalg.norm(steps, axis=1)
    shares = SphericalVoronoi(steps / lengths[:, None], threshold=1e-9).calculate_areas() / (4 * np.pi)
    half = [index for index, shift in enumerate(shifts) if shift > (0, 0, 0)]
    return [(shifts[index], float(lengths[index]), 2.0 * float(shares[index])) for index in half]
