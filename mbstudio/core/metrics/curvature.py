"""A body smoothed at a scale stated in its own size, and how rough its surface is against that.

Every body is brought onto the same grid, 40 cells to D_n, and smoothed by a Gaussian of D_n / 16. Details
finer than that count as roughness, the sharpness of edges among them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains.voxelisation import voxelise
from mbstudio.core.metrics.surfaces import split_to_edges

CELLS = 40
"""Cells of the grid to D_n."""
SIGMA = 2.5
"""Standard deviation of the smoothing in cells: D_n / 16."""
_FINER = 3
_MARGIN = 11
_MOST_SAMPLES = 60_000_000


@dataclass(frozen=True, eq=False)
class SmoothedBody:
    """A body on a grid, smoothed.

    Attributes
    ----------
    share : float array, shape (Z, Y, X)
        Share of each cell that lies in the body.
    edge : float
        Edge of a cell in the body's unit.
    origin : float array, shape (3,)
        Centre (x, y, z) of cell [0, 0, 0].
    """

    share: Float[np.ndarray, "Z Y X"]
    edge: float
    origin: Float[np.ndarray, " 3"]

    @property
    def inside(self) -> Bool[np.ndarray, "Z Y X"]:
        """Cells of which at least half lies in the body."""
        return self.share >= 0.5

    @cached_property
    def field(self) -> Float[np.ndarray, "Z Y X"]:
        """The smoothed share."""
        return self._filtered((0, 0, 0))

    @cached_property
    def level(self) -> float:
        """Value of the field on the surface that holds the body's volume."""
        count = float(self.share.sum(dtype=np.float64))
        values = np.sort(self.field, axis=None)[::-1]
        whole = int(count)
        return float(values[whole - 1] + (count - whole) * (values[whole] - values[whole - 1]))

    def _filtered(self, order: tuple[int, int, int]) -> Float[np.ndarray, "Z Y X"]:
        """Return a derivative (orders along z, y, x) of the smoothed share, per cell."""
        derivative: np.ndarray = ndimage.gaussian_filter(self.share, SIGMA, order=order, truncate=4.0)
        return derivative

    def cells_of(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "3 m"]:
        """Return the (fractional) indices z, y, x of points."""
        cells: np.ndarray = ((points - self.origin) / self.edge)[:, ::-1].T
        return cells

    def distance_at(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
        """Return how far points near it lie outside the smoothed surface, to first order."""
        places = self.cells_of(points)
        value = ndimage.map_coordinates(self.field, places, order=1)
        slope = [
            ndimage.map_coordinates(self._filtered(order), places, order=1)
            for order in ((1, 0, 0), (0, 1, 0), (0, 0, 1))
        ]
        distances: np.ndarray = (
            (self.level - value) / np.maximum(np.linalg.norm(slope, axis=0), 1e-6) * self.edge
        )
        return distances


def smooth_body(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], nominal_diameter: float
) -> SmoothedBody:
    """Bring a closed surface onto the grid.

    Raises
    ------
    MeasureError
        If the body is so long and thin that the grid would not fit into memory.
    """
    edge = nominal_diameter / CELLS
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    cells = np.ceil((high - low) / edge).astype(int) + 1 + 2 * _MARGIN
    if cells.prod() * _FINER**3 > _MOST_SAMPLES:
        raise MeasureError(
            f"The body is {float((high - low).max() / nominal_diameter):.0f} times as long as its nominal "
            "diameter: roughness is not defined for such a thread."
        )
    origin = (low + high) / 2 - edge * (cells - 1) / 2
    fine = edge / _FINER
    nz, ny, nx = (int(n) for n in cells[::-1])
    inside = voxelise(
        vertices, faces, origin - fine * (_FINER - 1) / 2, fine, (nz * _FINER, ny * _FINER, nx * _FINER)
    )
    blocks = inside.reshape(nz, _FINER, ny, _FINER, nx, _FINER)
    share = blocks.sum(axis=(1, 3, 5), dtype=np.float32) / np.float32(_FINER**3)
    return SmoothedBody(share, edge, origin)


def roughness(
    body: SmoothedBody,
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    nominal_diameter: float,
) -> float:
    """Return the root mean square distance from a surface to the smoothed body, over D_n."""
    corners = split_to_edges(vertices[faces], 2.0 * body.edge)
    sizes = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    squared = body.distance_at(corners.mean(axis=1)) ** 2
    return float(np.sqrt(sizes @ squared / sizes.sum()) / nominal_diameter)
