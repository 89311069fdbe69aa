"""Solids with known answers, as meshes and voxels."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipeinc, ellipkinc


def turned(mesh: trimesh.Trimesh, seed: int) -> trimesh.Trimesh:
    """Return the mesh rotated and shifted at random."""
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(rng=rng).as_matrix()
    pose[:3, 3] = rng.uniform(-5, 5, 3)
    moved = mesh.copy()
    moved.apply_transform(pose)
    return moved


def ellipsoid_area(a: float, b: float, c: float) -> float:
    """Area of an ellipsoid with semi-axes a > b > c (Legendre)."""
    phi = np.arccos(c / a)
    k2 = a**2 * (b**2 - c**2) / (b**2 * (a**2 - c**2))
    bracket = ellipeinc(phi, k2) * np.sin(phi) ** 2 + ellipkinc(phi, k2) * np.cos(phi) ** 2
    return float(2 * np.pi * (c**2 + a * b / np.sin(phi) * bracket))


def ellipse_perimeter(a: float, b: float) -> float:
    """Perimeter of an ellipse with semi-axes a > b."""
    return float(4 * a * ellipe(1 - (b / a) ** 2))


def ellipsoid_voxels(axes: np.ndarray, seed: int) -> np.ndarray:
    """Voxels [z, y, x] of an ellipsoid in random rotation and sub-voxel shift."""
    rng = np.random.default_rng(seed)
    rotation, shift = Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3)
    reach = int(np.ceil(max(axes))) + 2
    ticks = np.arange(-reach, reach + 1)
    z, y, x = np.meshgrid(ticks, ticks, ticks, indexing="ij")
    local = (np.stack([x, y, z], axis=-1) - shift) @ rotation
    return ((local / axes) ** 2).sum(axis=-1) <= 1
