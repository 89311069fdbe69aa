"""Voxels of a closed surface mesh by exact winding numbers along z."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from mbstudio.core.compiled import compiled

# Rays are shifted by this share of a voxel, so that none meets an edge or corner of a mesh whose
# coordinates are round numbers. Irrational ratios, the same in every run.
_JITTER = (3.1415926e-5, 2.7182818e-5)


def voxelise(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    origin: Float[np.ndarray, "3"],
    edge: float,
    shape: tuple[int, int, int],
) -> Bool[np.ndarray, "Z Y X"]:
    """Return which voxel centres lie inside a closed mesh with outward normals.

    Parameters
    ----------
    vertices : array, shape (v, 3)
        Points (x, y, z).
    faces : array, shape (f, 3)
    origin : array, shape (3,)
        Centre (x, y, z) of voxel [0, 0, 0].
    edge : float
        Edge length of the cubic voxels.
    shape : tuple of int
        (Z, Y, X).

    Notes
    -----
    A ray along z through each column of voxel centres gathers +1 where it enters and -1 where
    it leaves; the sum below a voxel is its winding number, inside where that is positive. Where
    surfaces overlap the union is taken.
    """
    nz, ny, nx = shape
    points = (np.asarray(vertices, dtype=np.float64) - origin) / edge
    changes = np.zeros((ny, nx, nz + 1), dtype=np.int16)
    _gather_crossings(points, np.ascontiguousarray(faces, dtype=np.int64), changes, *_JITTER)
    winding = np.cumsum(changes[:, :, :nz], axis=2, dtype=np.int16)
    return np.ascontiguousarray((winding > 0).transpose(2, 0, 1))


@compiled()
def _side(ax: float, ay: float, bx: float, by: float, px: float, py: float) -> float:
    """On which side of the edge a-b the point p lies; exactly opposite for b-a.

    The ends are put in a fixed order, so that two triangles that share the edge compute the
    same number and no ray slips between them.
    """
    if ax < bx or (ax == bx and ay < by):
        return (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    return -((ax - bx) * (py - by) - (ay - by) * (px - bx))


@compiled()
def _cross(
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    cx: float,
    cy: float,
    cz: float,
    px: float,
    py: float,
) -> tuple[int, float]:
    """Return how the winding number changes where a ray along z meets a triangle, and at what height.

    Normals point outwards: a face that looks up is where the ray leaves. 0 where it does not meet it.
    """
    over_a = _side(bx, by, cx, cy, px, py)
    over_b = _side(cx, cy, ax, ay, px, py)
    over_c = _side(ax, ay, bx, by, px, py)
    up = over_a > 0 and over_b > 0 and over_c > 0
    down = over_a < 0 and over_b < 0 and over_c < 0
    if not (up or down):
        return 0, 0.0
    return -1 if up else 1, (over_a * az + over_b * bz + over_c * cz) / (over_a + over_b + over_c)


@compiled()
def _gather_crossings(
    points: np.ndarray, faces: np.ndarray, changes: np.ndarray, jitter_x: float, jitter_y: float
) -> None:
    """Add each triangle's crossings with the columns of voxel centres to `changes`."""
    ny, nx, last = changes.shape[0], changes.shape[1], changes.shape[2] - 1
    for face in range(faces.shape[0]):
        ax, ay, az = points[faces[face, 0]]
        bx, by, bz = points[faces[face, 1]]
        cx, cy, cz = points[faces[face, 2]]
        first_x = max(0, int(np.ceil(min(ax, bx, cx) - 1)))
        last_x = min(nx - 1, int(np.floor(max(ax, bx, cx) + 1)))
        first_y = max(0, int(np.ceil(min(ay, by, cy) - 1)))
        last_y = min(ny - 1, int(np.floor(max(ay, by, cy) + 1)))
        for iy in range(first_y, last_y + 1):
            for ix in range(first_x, last_x + 1):
                change, height = _cross(ax, ay, az, bx, by, bz, cx, cy, cz, ix + jitter_x, iy + jitter_y)
                if change:
                    changes[iy, ix, min(max(int(np.ceil(height)), 0), last)] += change


def shares_inside(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    origin: Float[np.ndarray, "3"],
    edge: float,
    shape: tuple[int, int, int],
    rays: int,
) -> Float[np.ndarray, "Z Y X"]:
    """Return what share of each cell lies inside a closed mesh with outward normals.

    Parameters
    ----------
    vertices, faces, origin, edge, shape
        As in :func:`voxelise`.
    rays : int
        A cell is sampled by so many times so many rays along z, along which its share is exact.
    """
    nz, ny, nx = shape
    points = (np.asarray(vertices, dtype=np.float64) - origin) / edge
    # Rays stand at whole numbers; cell i holds those from i * rays to (i + 1) * rays - 1.
    points[:, :2] = (points[:, :2] + 0.5) * rays - 0.5
    changes = np.zeros((ny, nx, nz + 1))
    _gather_shares(points, np.ascontiguousarray(faces, dtype=np.int64), changes, rays, *_JITTER)
    shares = np.cumsum(changes[:, :, :nz], axis=2) / rays**2
    return np.ascontiguousarray(np.clip(shares, 0.0, 1.0).transpose(2, 0, 1), dtype=np.float32)


@compiled()
def _gather_shares(
    points: np.ndarray, faces: np.ndarray, changes: np.ndarray, rays: int, jitter_x: float, jitter_y: float
) -> None:
    """Add, at each triangle's crossings with the rays, the change of the share from one cell to the next."""
    ny, nx, last = rays * changes.shape[0], rays * changes.shape[1], changes.shape[2] - 1
    for face in range(faces.shape[0]):
        ax, ay, az = points[faces[face, 0]]
        bx, by, bz = points[faces[face, 1]]
        cx, cy, cz = points[faces[face, 2]]
        first_x = max(0, int(np.ceil(min(ax, bx, cx) - 1)))
        last_x = min(nx - 1, int(np.floor(max(ax, bx, cx) + 1)))
        first_y = max(0, int(np.ceil(min(ay, by, cy) - 1)))
        last_y = min(ny - 1, int(np.floor(max(ay, by, cy) + 1)))
        for iy in range(first_y, last_y + 1):
            for ix in range(first_x, last_x + 1):
                change, height = _cross(ax, ay, az, bx, by, bz, cx, cy, cz, ix + jitter_x, iy + jitter_y)
                if change:
                    cell = min(max(int(np.floor(height + 0.5)), 0), last - 1)
                    above = min(max(cell + 0.5 - height, 0.0), 1.0)
                    changes[iy // rays, ix // rays, cell] += change * above
                    changes[iy // rays, ix // rays, cell + 1] += change * (1.0 - above)
