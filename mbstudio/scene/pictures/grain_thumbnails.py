"""Small pictures of scanned grains from their voxels: no VTK, no mesh, so that any thread can make them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, UInt8

from mbstudio.core.grains import Grain
from mbstudio.scene.pictures.thumbnails import MARGIN, lit, view_frame
from mbstudio.scene.theme import rgb

_VOXELS = 80  # across the grain at most: more than the picture shows


def grain_thumbnail(grain: Grain, colour: str, size: int = 72) -> UInt8[np.ndarray, "size size 4"]:
    """Return a picture of a grain seen from the isometric view, on nothing; the grain fills it.

    Parameters
    ----------
    grain : Grain
    colour : str
        As ``#rrggbb``.
    size : int
        Pixels of a side.

    Returns
    -------
    uint8 array, shape (size, size, 4)
        Red, green, blue and opacity; row 0 is the upper one.
    """
    turned = _turned(grain, size)
    densest = turned.max(axis=2)
    # Half full is the surface; the smoothed voxels beside it soften the outline.
    cover = np.clip(2 * densest - 0.5, 0, 1)
    inside = turned >= 0.5
    depth = np.where(inside.any(axis=2), inside.argmax(axis=2), turned.argmax(axis=2))
    rows, columns = np.nonzero(cover)
    normals = _normals(turned, rows, columns, depth[rows, columns])
    picture = np.zeros((size, size, 4), dtype=np.uint8)
    colours = lit(normals)[:, None] * np.array(rgb(colour))
    picture[rows, columns, :3] = np.clip(colours, 0, 255).astype(np.uint8)
    picture[..., 3] = np.round(255 * cover).astype(np.uint8)
    return picture


def _turned(grain: Grain, size: int) -> Float32[np.ndarray, "size size depth"]:
    """Return the smoothed grain on a grid along the picture: rows down, columns right, depth away."""
    from scipy.ndimage import affine_transform, gaussian_filter

    stride = -(-max(grain.mask.shape) // _VOXELS)
    spacing = stride * np.array(grain.voxel_size.zyx, dtype=float)
    solid = np.pad(grain.mask[::stride, ::stride, ::stride], 3)
    frame = np.stack([vector[::-1] for vector in view_frame()])  # right, up, away, each (z, y, x)
    middle = (np.array(solid.shape) - 1) / 2
    seen = ((np.argwhere(_ends(solid)) - middle) * spacing) @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    reach = MARGIN * max(0.5 * float((high - low)[:2].max()), float(spacing.max()))
    step = 2 * reach / size
    layers = int(np.ceil((high[2] - low[2]) / step)) + 6
    # Index on the turned grid -> place in the picture -> place in the grain -> its voxel.
    axes = np.stack([-frame[1], frame[0], -frame[2]], axis=1) / spacing[:, None] * step
    centre = frame.T @ (0.5 * (low + high)) / spacing + middle
    offset = centre - axes @ ((np.array([size, size, layers]) - 1) / 2)
    soft = gaussian_filter(solid.astype(np.float32), 0.9)
    soft /= soft.max()  # of a few voxels none is full after smoothing
    return affine_transform(soft, axes, offset, (size, size, layers), order=1)


def _ends(solid: np.ndarray) -> np.ndarray:
    """Return the first and last voxel of every row along x: the extent of a body in any direction."""
    ends = solid.copy()
    ends[:, :, 1:-1] &= ~(solid[:, :, :-2] & solid[:, :, 2:])
    return ends


def _normals(
    turned: np.ndarray, rows: np.ndarray, columns: np.ndarray, depth: np.ndarray
) -> Float[np.ndarray, "m 3"]:
    """Return the unit normals (x, y, z) out of the grain at places of the turned grid."""
    last = np.array(turned.shape) - 1

    def at(row: int, column: int, layer: int) -> np.ndarray:
        return turned[
            np.clip(rows + row, 0, last[0]),
            np.clip(columns + column, 0, last[1]),
            np.clip(depth + layer, 0, last[2]),
        ]

    down = at(1, 0, 0) - at(-1, 0, 0)
    right = at(0, 1, 0) - at(0, -1, 0)
    away = at(0, 0, 1) - at(0, 0, -1)
    # The grain is where the values are high; away from the eye is against the third axis of the frame.
    slopes = np.stack([-right, down, away], axis=1) @ np.stack(view_frame())
    return slopes / np.maximum(np.linalg.norm(slopes, axis=1, keepdims=True), 1e-6)
