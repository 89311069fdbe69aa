"""A grain's surface: lightly smoothed marching cubes that keep the volume of the voxels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int
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
            mesh = max(mesh.split(only_watertight=False), key=_volume_within)
            mesh.units = voxel_size.unit
        whole = mesh.is_watertight
        if whole and abs(mesh.volume / target - 1) < 0.02:
            break
    assert mesh is not None
    mesh.apply_translation(origin)
    return mesh


def _volume_within(body: trimesh.Trimesh) -> float:
    """Return the volume alone: trimesh finds the centre of mass too, which a speck of none does not have."""
    return float(np.linalg.det(np.asarray(body.triangles)).sum()) / 6


def _mesh_of_volume(
    mask: Bool[np.ndarray, "Z Y X"], sigma: list[float], voxel_size: VoxelSize
) -> trimesh.Trimesh:
    """Return the surface of the smoothed mask at the level that keeps the volume."""
    import trimesh

    margin = 4
    field = np.pad(mask, margin).astype(np.float32)
    if max(sigma) > 0:
        field = ndimage.gaussian_filter(field, sigma, mode="constant", truncate=4.0)
        points, faces = _contour_of_volume(field, int(np.count_nonzero(mask)), voxel_size)
    else:
        points, faces, _ = _contour(field, 0.5, voxel_size)
    mesh = trimesh.Trimesh(points - margin * np.array(voxel_size.xyz), faces, process=False, validate=False)
    mesh.units = voxel_size.unit
    return mesh


def _contour_of_volume(
    field: Float[np.ndarray, "z y x"], count: int, voxel_size: VoxelSize
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Return the contour of the field that holds the volume of `count` voxels."""
    target = count * voxel_size.volume
    # Start where as many voxels lie above the level as the grain has, then correct by secants.
    top = float(field.max())
    level = float(np.partition(field.ravel(), field.size - count)[field.size - count])
    levels = [float(np.clip(level, 0.05 * top, 0.95 * top))]
    points, faces, volume = _contour(field, levels[0], voxel_size)
    errors = [volume / target - 1]
    level = levels[0] * 1.05 if errors[0] > 0 else levels[0] * 0.95
    for _ in range(6):
        if abs(errors[-1]) < _VOLUME_TOLERANCE:
            break
        points, faces, volume = _contour(field, level, voxel_size)
        levels.append(level)
        errors.append(volume / target - 1)
        slope = (errors[-1] - errors[-2]) / (levels[-1] - levels[-2])
        if slope == 0:
            break
        level = float(np.clip(levels[-1] - errors[-1] / slope, 0.02 * top, 0.98 * top))
        if level in levels:
            break
    return points, faces


def _contour(
    field: Float[np.ndarray, "z y x"], level: float, voxel_size: VoxelSize
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"], float]:
    """Return the outward surface of the field at a level, voxel [0, 0, 0] at the origin, and its volume."""
    from skimage.measure import marching_cubes

    corners, faces, _, _ = marching_cubes(field, level, allow_degenerate=False)
    points = corners[:, ::-1].astype(np.float64) * voxel_size.xyz
    # About a point in the middle, so that a large box costs no precision.
    a, b, c = (points - points.mean(axis=0))[faces.T]
    volume = float(np.einsum("fi,fi->", a, _cross(b, c))) / 6.0
    return (points, faces, volume) if volume >= 0 else (points, faces[:, ::-1], -volume)


def _cross(a: Float[np.ndarray, "f 3"], b: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Return the cross products of rows; a third of the time of numpy's."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
