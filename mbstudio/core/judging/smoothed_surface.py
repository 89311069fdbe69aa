"""A closed surface seen at a stated scale: places on it, their normals and curvatures.

The body is brought onto a grid of 75 cells to D_n as the share of each cell that it fills, and smoothed by a
Gaussian. What is finer than the Gaussian is gone, the facets of a triangulation among it. The surface is
where half of the smoothed body is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int
from scipy import ndimage
from scipy.special import ndtri

from mbstudio.core.compiled import compiled
from mbstudio.core.errors import MeasureError

CELLS = 75
"""Cells of the grid to D_n."""
FINE = 0.02
"""Standard deviation of the Gaussian, in D_n, at which normals and curvatures are found."""
COARSE = 0.06
"""Standard deviation of the Gaussian, in D_n, against which a surface is rough."""
_COLUMNS = 4
"""Lines along z through each cell, squared."""
_MARGIN = 0.2
_MOST_CELLS = 12_000_000
# Irrational shares of a line's distance, so that no line meets an edge of round coordinates.
_JITTER = (3.1415926e-4, 2.7182818e-4)


@dataclass(frozen=True, eq=False)
class SmoothedSurface:
    """Places spread evenly over a surface smoothed by :data:`FINE`, lengths in D_n.

    Attributes
    ----------
    points, normals : float array, shape (m, 3)
        Each stands for the same area; normals point outwards.
    low_curvature, high_curvature : float array, shape (m,)
        Principal curvatures, positive where the body is convex: 2 on a ball, whose D_n is 1.
    height : float array, shape (m,)
        How far the surface lies above the body smoothed by :data:`COARSE`.
    """

    points: Float64[np.ndarray, "m 3"]
    normals: Float64[np.ndarray, "m 3"]
    low_curvature: Float64[np.ndarray, " m"]
    high_curvature: Float64[np.ndarray, " m"]
    height: Float64[np.ndarray, " m"]

    @property
    def mean_curvature(self) -> Float64[np.ndarray, " m"]:
        """Mean of the two principal curvatures."""
        mean: np.ndarray = 0.5 * (self.low_curvature + self.high_curvature)
        return mean


def smoothed_surface(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> SmoothedSurface:
    """Return a surface at the stated scale.

    Parameters
    ----------
    vertices : float array, shape (v, 3)
        In D_n.
    faces : int array, shape (f, 3)
        Closed, outward.

    Raises
    ------
    MeasureError
        If the body is so long and thin that the grid would not fit into memory, or so thin that nothing of it
        is left at the stated scale.

    Notes
    -----
    Curvatures are those of the level set (Goldman 2005, Curvature formulas for implicit curves and surfaces,
    Computer Aided Geometric Design 22, 632-658), from central differences. The height inverts what a plane
    would give, so that it is exact for a plane and bounded at spikes.
    """
    share, origin = filled_share(vertices, faces)
    fine = ndimage.gaussian_filter(share, FINE * CELLS, truncate=4.0)
    found = _near_surface(fine)
    if not len(found):
        raise MeasureError(
            f"The body is thinner than {2 * FINE:g} of its nominal diameter everywhere: nothing of it is "
            "left at the scale at which surfaces are judged."
        )
    coarse = ndimage.gaussian_filter(share, COARSE * CELLS, truncate=3.0)
    places = np.ascontiguousarray(found[:, :3].T)  # y, x, z
    depth = ndimage.map_coordinates(coarse, places, order=1)
    points = found[:, [1, 0, 2]] / CELLS + origin
    return SmoothedSurface(
        points=points,
        normals=found[:, [4, 3, 5]],
        low_curvature=found[:, 6] * CELLS,
        high_curvature=found[:, 7] * CELLS,
        height=-COARSE * ndtri(np.clip(depth, 1e-6, 1 - 1e-6)),
    )


def filled_share(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "Y X Z"], Float64[np.ndarray, " 3"]]:
    """Return the share of each cell that a body fills, axes y, x, z, and the centre (x, y, z) of the first.

    Exact along z, of 16 lines a cell. Where surfaces overlap their union is taken.
    """
    edge = 1.0 / CELLS
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    nx, ny, nz = (int(n) for n in np.ceil((high - low + 2 * _MARGIN) / edge))
    if nx * ny * nz > _MOST_CELLS:
        raise MeasureError(
            f"The body is {float((high - low).max()):.0f} times as long as its nominal diameter: "
            "the surface of such a thread is not judged."
        )
    origin = (low + high) / 2 - edge * (np.array([nx, ny, nz]) - 1) / 2
    points = np.ascontiguousarray((vertices - origin) / edge)
    changes = np.zeros((ny, nx, nz + 1), dtype=np.float32)
    _gather(points, np.ascontiguousarray(faces, dtype=np.int64), changes, _COLUMNS, *_JITTER)
    share = np.cumsum(changes[:, :, :nz], axis=2, dtype=np.float32)
    filled: np.ndarray = np.clip(share, 0.0, 1.0)
    return filled, origin


@compiled()
def _side(ax: float, ay: float, bx: float, by: float, px: float, py: float) -> float:
    """On which side of the edge a-b the point p lies; exactly opposite for b-a."""
    if ax < bx or (ax == bx and ay < by):
        return (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    return -((ax - bx) * (py - by) - (ay - by) * (px - bx))


@compiled()
def _gather(
    points: np.ndarray, faces: np.ndarray, changes: np.ndarray, columns: int, shift_x: float, shift_y: float
) -> None:
    """Add to each cell by how much its filled share differs from that of the cell below."""
    step = 1.0 / columns
    weight = step * step
    top = changes.shape[2] - 1
    for face in range(faces.shape[0]):
        i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
        bx, by, bz = points[j, 0], points[j, 1], points[j, 2]
        cx, cy, cz = points[k, 0], points[k, 1], points[k, 2]
        # Line l of an axis runs at (l + 0.5) step - 0.5 + shift.
        first_x = int(np.ceil((min(ax, bx, cx) + 0.5 - shift_x) * columns - 0.5))
        last_x = int(np.floor((max(ax, bx, cx) + 0.5 - shift_x) * columns - 0.5))
        first_y = int(np.ceil((min(ay, by, cy) + 0.5 - shift_y) * columns - 0.5))
        last_y = int(np.floor((max(ay, by, cy) + 0.5 - shift_y) * columns - 0.5))
        for line_y in range(first_y, last_y + 1):
            py = (line_y + 0.5) * step - 0.5 + shift_y
            for line_x in range(first_x, last_x + 1):
                px = (line_x + 0.5) * step - 0.5 + shift_x
                over_a = _side(bx, by, cx, cy, px, py)
                over_b = _side(cx, cy, ax, ay, px, py)
                over_c = _side(ax, ay, bx, by, px, py)
                if over_a > 0 and over_b > 0 and over_c > 0:
                    sign = -weight  # seen from above: the line leaves the body
                elif over_a < 0 and over_b < 0 and over_c < 0:
                    sign = weight
                else:
                    continue
                height = (over_a * az + over_b * bz + over_c * cz) / (over_a + over_b + over_c)
                cell = min(int(np.floor(height + 0.5)), top - 1)
                above = cell + 0.5 - height
                changes[line_y // columns, line_x // columns, cell] += sign * above
                changes[line_y // columns, line_x // columns, cell + 1] += sign * (1.0 - above)


def _near_surface(field: Float[np.ndarray, "Y X Z"]) -> Float64[np.ndarray, "m 8"]:
    """Return, of nodes within half a cell of the surface, place on it, normal and principal curvatures."""
    rows = np.flatnonzero(np.abs(field - 0.5).ravel() < 0.35)
    kept = np.empty((len(rows), 8))
    count = _curvatures(field, rows, kept)
    return kept[:count]


@compiled()
def _curvatures(field: np.ndarray, rows: np.ndarray, kept: np.ndarray) -> int:
    ny, nx, nz = field.shape
    count = 0
    for row in rows:
        y, rest = row // (nx * nz), row % (nx * nz)
        x, z = rest // nz, rest % nz
        if y < 2 or x < 2 or z < 2 or y > ny - 3 or x > nx - 3 or z > nz - 3:
            continue
        near, far = _differences(field, y, x, z, 1), _differences(field, y, x, z, 2)
        # The error of order h**2 cancels, which would depend on the direction of the surface.
        a, b, c = _limit(near[0], far[0]), _limit(near[1], far[1]), _limit(near[2], far[2])
        aa, bb, cc = _limit(near[3], far[3]), _limit(near[4], far[4]), _limit(near[5], far[5])
        ab, ac, bc = _limit(near[6], far[6]), _limit(near[7], far[7]), _limit(near[8], far[8])
        square = a * a + b * b + c * c
        if square < 1e-8:
            continue
        slope = np.sqrt(square)
        off = (field[y, x, z] - 0.5) / slope
        if off >= 0.5 or off < -0.5:
            continue
        bent = (
            a * a * (bb + cc) + b * b * (aa + cc) + c * c * (aa + bb)
            - 2.0 * (a * b * ab + a * c * ac + b * c * bc)
        )  # fmt: skip
        mean = -0.5 * bent / (square * slope)
        gauss = (
            a * a * (bb * cc - bc * bc) + b * b * (aa * cc - ac * ac) + c * c * (aa * bb - ab * ab)
            + 2.0 * (a * b * (ac * bc - ab * cc) + b * c * (ab * ac - bc * aa) + a * c * (ab * bc - ac * bb))
        ) / (square * square)  # fmt: skip
        spread = np.sqrt(max(mean * mean - gauss, 0.0))
        kept[count, 0] = y - off * a / slope
        kept[count, 1] = x - off * b / slope
        kept[count, 2] = z - off * c / slope
        kept[count, 3] = -a / slope
        kept[count, 4] = -b / slope
        kept[count, 5] = -c / slope
        kept[count, 6] = mean - spread
        kept[count, 7] = mean + spread
        count += 1
    return count


@compiled()
def _limit(near: float, far: float) -> float:
    return (4.0 * near - far) / 3.0


@compiled()
def _differences(
    field: np.ndarray, y: int, x: int, z: int, h: int
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return the central differences at a node over h cells: along y, x, z; yy, xx, zz; yx, yz, xz."""
    twice, square, cross = 2.0 * field[y, x, z], 1.0 * h * h, 4.0 * h * h
    return (
        (field[y + h, x, z] - field[y - h, x, z]) / (2.0 * h),
        (field[y, x + h, z] - field[y, x - h, z]) / (2.0 * h),
        (field[y, x, z + h] - field[y, x, z - h]) / (2.0 * h),
        (field[y + h, x, z] + field[y - h, x, z] - twice) / square,
        (field[y, x + h, z] + field[y, x - h, z] - twice) / square,
        (field[y, x, z + h] + field[y, x, z - h] - twice) / square,
        (field[y + h, x + h, z] - field[y + h, x - h, z] - field[y - h, x + h, z] + field[y - h, x - h, z])
        / cross,
        (field[y + h, x, z + h] - field[y + h, x, z - h] - field[y - h, x, z + h] + field[y - h, x, z - h])
        / cross,
        (field[y, x + h, z + h] - field[y, x + h, z - h] - field[y, x - h, z + h] + field[y, x - h, z - h])
        / cross,
    )
