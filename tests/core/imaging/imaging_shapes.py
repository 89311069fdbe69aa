"""Grains of known shape, straight from formulas."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbstudio.core.grains import Grain
from mbstudio.core.units import VoxelSize

Inside = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def grain_where(inside: Inside, half: float, voxel: VoxelSize, **details: object) -> Grain:
    """Return the grain of all voxels within `half` of the origin whose centres are inside."""
    counts = [int(np.floor(half / edge)) for edge in voxel.zyx]
    z, y, x = (np.arange(-c, c + 1) * edge for c, edge in zip(counts, voxel.zyx, strict=True))
    mask = inside(x[None, None, :], y[None, :, None], z[:, None, None])
    where = np.argwhere(mask)
    low, high = where.min(axis=0), where.max(axis=0) + 1
    box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    first = [(low[2] - counts[2]) * voxel.x, (low[1] - counts[1]) * voxel.y, (low[0] - counts[0]) * voxel.z]
    return Grain(np.ascontiguousarray(mask[box]), voxel, tuple(float(v) for v in first), **details)  # type: ignore[arg-type]


# Off the lattice: a body centred on a voxel counts too few of its voxels by up to 1 %.
CENTER = np.array([0.3, 0.21, -0.15])
EGG_AXES = (20.3, 15.2, 12.4)


def ellipsoid(a: float, b: float, c: float) -> Inside:
    """Return the inside test of an ellipsoid with these half axes about CENTER."""
    cx, cy, cz = CENTER
    return lambda x, y, z: ((x - cx) / a) ** 2 + ((y - cy) / b) ** 2 + ((z - cz) / c) ** 2 <= 1


def cut_box(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """A box with two corners cut off by planes."""
    box = np.maximum(np.maximum(np.abs(x) / 18, np.abs(y) / 14), np.abs(z) / 11) <= 1
    return box & (x + y + z <= 24) & (x - y - 0.5 * z <= 22)
