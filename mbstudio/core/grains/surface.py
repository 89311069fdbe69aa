"""A grain's surface: lightly smoothed marching cubes that keep the volume of the voxels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from mbstudio.core.units import VoxelSize

if TYPE_CHECKING:
    import trimesh

# Standard deviations of the smoothing, in the smallest edge of a voxel; the next is tried where
# the one before tears a thin grain apart.
_SMOOTHINGS = (0.9, 0.6, 0.35, 0.0)
_VOLUME_TOLERANCE = 1e-4


def surface_mesh(
    mask: Bool[np.ndarray, "Z Y X"], voxel_size: VoxelSize, origin: tuple[float, float, float]
) -> trimesh.Trimesh:
    """Return a closed mesh with outward normals, in the frame and unit of the grain.

    The mask is smoothed by a Gaussian of about one voxel, which takes away the staircase, and
    the level of the surface is chosen so that the mesh has the volume of the voxels: smoothing
    alone would shrink small and thin grains.
    """
    shortest = min(voxel_size.zyx)
    mesh = None
    target = np.count_nonzero(mask) * voxel_size.volume
    for smoothing in _SMOOTHINGS:
        sigma = [smoothing * shortest / edge for edge in voxel_size.zyx]
        mesh = _mesh_of_volume(mask, sigma, voxel_size)
        if mesh.body_count > 1:  # voxels that hang on by a corner come off as specks
            mesh = max(mesh.split(only_watertight=False), key=lambda body: body.volume)
            mesh.units = voxel_size.unit
        whole = mesh.is_watertight
        if whole and abs(mesh.volume / target - 1) < 0.02:
            break
    assert mesh is not None
    mesh.apply_translation(origin)
    return mesh


def _mesh_of_volume(
    mask: Bool[np.ndarray, "Z Y X"], sigma: list[float], voxel_size: VoxelSize
) -> trimesh.Trimesh:
    """Return the surface of the smoothed mask at the level that keeps the volume."""
    margin = 4
    field = np.pad(mask, margin).astype(np.float32)
    if max(sigma) > 0:
        field = ndimage.gaussian_filter(field, sigma, mode="constant", truncate=4.0)
    count = int(np.count_nonzero(mask))
    target = count * voxel_size.volume
    if max(sigma) == 0:
        return _contour(field, 0.5, voxel_size, margin)
    # Start where as many voxels lie above the level as the grain has, then correct by secants.
    levels = [float(np.partition(field.ravel(), field.size - count)[field.size - count])]
    top = float(field.max())
    levels = [float(np.clip(levels[0], 0.05 * top, 0.95 * top))]
    mesh = _contour(field, levels[0], voxel_size, margin)
    errors = [mesh.volume / target - 1]
    level = levels[0] * 1.05 if errors[0] > 0 else levels[0] * 0.95
    for _ in range(6):
        if abs(errors[-1]) < _VOLUME_TOLERANCE:
            break
        mesh = _contour(field, level, voxel_size, margin)
        levels.append(level)
        errors.append(mesh.volume / target - 1)
        slope = (errors[-1] - errors[-2]) / (levels[-1] - levels[-2])
        if slope == 0:
            break
        level = float(np.clip(levels[-1] - errors[-1] / slope, 0.02 * top, 0.98 * top))
        if level in levels:
            break
    return mesh


def _contour(
    field: Float[np.ndarray, "z y x"], level: float, voxel_size: VoxelSize, margin: int
) -> trimesh.Trimesh:
    """Return the surface of the field at a level, outward, with voxel [margin, ...] at the origin."""
    import trimesh
    from skimage.measure import marching_cubes

    corners, faces, _, _ = marching_cubes(field, level, allow_degenerate=False)
    points = (corners[:, ::-1].astype(np.float64) - margin) * voxel_size.xyz
    mesh = trimesh.Trimesh(points, faces, process=False, validate=False)
    if mesh.volume < 0:
        mesh.invert()
    mesh.units = voxel_size.unit
    return mesh
