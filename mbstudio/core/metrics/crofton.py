"""Surface area of a voxel grain by Crofton's formula, without meshing it.

A quarter of the area of a convex body is its mean projected area, and for any body the mean
number of times that lines enter it. The lines run through neighbouring voxels in 13 directions,
each weighted by the share of the sphere that is closer to it than to the others.

References
----------
Legland, Kieu & Devaux (2007), Computation of Minkowski measures on 2D and 3D binary images,
Image Analysis & Stereology 26, 83-92.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np
from jaxtyping import Bool
from scipy.spatial import SphericalVoronoi

from mbstudio.core.units import VoxelSize


def crofton_area(mask: Bool[np.ndarray, "Z Y X"], voxel_size: VoxelSize) -> float:
    """Return the surface area of a mask in unit**2.

    Parameters
    ----------
    mask : bool array, shape (Z, Y, X)
        Everything outside the array counts as empty.
    voxel_size : VoxelSize
        May be anisotropic: the weights of the directions follow.
    """
    padded = np.pad(mask, 1)
    area = 0.0
    for shift, length, weight in _directions(voxel_size.zyx):
        here = tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(shift, padded.shape, strict=True))
        there = tuple(slice(max(0, s), n - max(0, -s)) for s, n in zip(shift, padded.shape, strict=True))
        entries = np.count_nonzero(padded[here] ^ padded[there]) / 2
        area += 4.0 * weight * entries * voxel_size.volume / length
    return float(area)


@lru_cache(maxsize=16)
def _directions(edges: tuple[float, float, float]) -> list[tuple[tuple[int, ...], float, float]]:
    """Return shift, step length and weight of the 13 directions; the weights sum to 1."""
    shifts = [shift for shift in product((-1, 0, 1), repeat=3) if any(shift)]
    steps = np.array(shifts, dtype=float) * edges
    lengths = np.linalg.norm(steps, axis=1)
    shares = SphericalVoronoi(steps / lengths[:, None], threshold=1e-9).calculate_areas() / (4 * np.pi)
    half = [index for index, shift in enumerate(shifts) if shift > (0, 0, 0)]
    return [(shifts[index], float(lengths[index]), 2.0 * float(shares[index])) for index in half]
