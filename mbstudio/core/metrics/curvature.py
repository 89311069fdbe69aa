"""A body smoothed at a scale stated in its own size, and the curvature of its surface there.

Curvature exists only at a scale: voxels, triangles and metaballs have different ones of their own.
Every body is therefore brought onto the same grid, 40 cells to D_n, and smoothed by a Gaussian of
D_n / 16. A sharp edge then counts as rounded by about that much, and details finer than it count as
roughness.
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

    def surface(self) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
        """Return the smoothed surface as vertices, in cells (z, y, x), and faces."""
        from skimage.measure import marching_cubes

        vertices, faces, _, _ = marching_cubes(self.field, self.level)
        return vertices.astype(np.float64), faces

    def largest_curvature(self, places: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, " v"]:
        """Return the larger principal curvature at points of the surface, positive where convex.

        Parameters
        ----------
        places : float array, shape (v, 3)
            In cells (z, y, x).

        Returns
        -------
        float array, shape (v,)
            In 1 / unit.

        Notes
        -----
        Of a level set of f, high inside, the shape operator is -P H P / |grad f| with H the Hessian
        and P the projection onto the tangent plane (Goldman 2005, Curvature formulas for implicit curves and
        surfaces, Computer Aided Geometric Design 22, 632-658).
        """
        first = {0: (1, 0, 0), 1: (0, 1, 0), 2: (0, 0, 1)}
        slope = np.stack([self._at(first[i], places) for i in range(3)], axis=1)
        size = np.maximum(np.linalg.norm(slope, axis=1), 1e-9)
        normal = slope / size[:, None]
        hessian = np.empty((len(places), 3, 3))
        for i in range(3):
            for j in range(i, 3):
                order = np.add(first[i], first[j])
                hessian[:, i, j] = hessian[:, j, i] = self._at((order[0], order[1], order[2]), places)
        tangent = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        operator = -tangent @ hessian @ tangent / size[:, None, None]
        mean = np.trace(operator, axis1=1, axis2=2) / 2
        squares = np.einsum("vij,vij->v", operator, operator)
        largest: np.ndarray = (mean + np.sqrt(np.maximum(squares / 2 - mean**2, 0.0))) / self.edge
        return largest

    def _at(self, order: tuple[int, int, int], places: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, " v"]:
        values: np.ndarray = ndimage.map_coordinates(self._filtered(order), places.T, order=1)
        return values


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
            "diameter: roundness and roughness are not defined for such a thread."
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


def roundness(body: SmoothedBody, inscribed_radius: float) -> float:
    """Return Wadell's roundness in three dimensions.

    Corners are where the larger principal curvature exceeds that of the inscribed sphere. The mean over
    their area of the radius of curvature, over the radius of the inscribed sphere; 1 where there are none.

    Parameters
    ----------
    inscribed_radius : float
        In unit.
    """
    vertices, faces = body.surface()
    curvature = body.largest_curvature(vertices)
    corners = vertices[faces]
    sizes = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    at_face = curvature[faces].mean(axis=1)
    corner = at_face > 1.0 / inscribed_radius
    if not corner.any():
        return 1.0
    return float(sizes[corner] @ (1.0 / at_face[corner]) / sizes[corner].sum() / inscribed_radius)


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
