"""Axis directions of medical image formats, brought to mbstudio's frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.scan import VoxelArray


def lengths_of(steps: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Return the lengths of vectors; infinity where they are too large to square."""
    with np.errstate(over="ignore"):
        return np.asarray(np.linalg.norm(steps, axis=1))


def impossible(steps: Float[np.ndarray, "3 3"]) -> str | None:
    """Return why steps from voxel to voxel cannot be meant, None if they can; a sentence's end."""
    spacing = lengths_of(steps)
    if np.isfinite(spacing).all() and spacing.min() > 0:
        return None
    edges = " x ".join(f"{edge:g}" for edge in spacing)
    return f"gives an impossible voxel spacing of {edges} (x, y, z)"


def along_axes(
    voxels: VoxelArray, steps: Float[np.ndarray, "3 3"], origin: Float[np.ndarray, "3"], path: Path
) -> tuple[VoxelArray, tuple[float, float, float], tuple[float, float, float], tuple[bool, bool, bool]]:
    """Return voxels, spacing (z, y, x), origin (x, y, z) and what was flipped (z, y, x).

    Afterwards the axes run in positive directions.

    Parameters
    ----------
    voxels : VoxelArray, shape (Z, Y, X)
    steps : array, shape (3, 3)
        Row i is the step in space from voxel to voxel along x, y, z (i = 0, 1, 2).
    origin : array, shape (3,)
        Position of the first voxel.

    Axes that run backwards are flipped. A volume turned against the axes keeps its own frame,
    with its first voxel at the origin: a grain has the same shape in every frame, as long as it
    is not mirrored.

    Raises
    ------
    ScanError
        If a spacing is zero or not finite, or the axes are not at right angles.
    """
    spacing = lengths_of(steps)
    if not np.isfinite(steps).all() or spacing.min() <= 0:
        raise ScanError(f"{path} gives an impossible voxel spacing {spacing.tolist()}: give voxel_size.")
    units = steps / spacing[:, None]
    if not np.allclose(units @ units.T, np.eye(3), atol=1e-3):
        raise ScanError(
            f"{path} has axes that are not at right angles: resample it to a rectangular grid first."
        )
    backwards = np.diag(units) < 0
    if not np.allclose(np.abs(units), np.eye(3), atol=1e-3):
        backwards = np.array([False, False, np.linalg.det(units) < 0])
        origin = np.zeros(3)
    else:
        counts = np.array(voxels.shape[::-1])
        origin = np.where(backwards, origin - spacing * (counts - 1), origin)
    if backwards.any():
        voxels = voxels[tuple(slice(None, None, -1 if back else 1) for back in backwards[::-1])]
    x, y, z = (float(edge) for edge in spacing)
    back_x, back_y, back_z = (bool(back) for back in backwards)
    corner = (float(origin[0]), float(origin[1]), float(origin[2]))
    return voxels, (z, y, x), corner, (back_z, back_y, back_x)
