"""Wadell's roundness in three dimensions, at scales stated in the inscribed sphere, carried to the scale 0.

Curvature exists only at a scale: voxels and triangles have a curvature of their own. The body is smoothed by
two Gaussians, narrow against the inscribed sphere. An edge of radius r then shows the radius
sqrt(r**2 + c**2 sigma**2), with a c that its angle decides; of the two readings that at sigma = 0 follows, 0
for a sharp edge whatever its angle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy import ndimage, sparse
from scipy.spatial.transform import Rotation

from mbstudio.core.grains.voxelisation import shares_inside

_SIGMA = 2.0
"""Standard deviation of the narrower smoothing, in cells."""
_WIDER = float(np.sqrt(2.0))
"""Times as wide is the other smoothing: its square is twice as large."""
_OF_INSCRIBED = 10.0
_OF_INSCRIBED_VOXELS = 8.0
"""The narrower smoothing is the inscribed radius over this; voxels need a little more, for their noise."""
_VOXELS = 1.5
"""It is never less than so many edges of a voxel."""
_OUTLINE = 0.6
"""Smoothing that a voxel outline carries already, in edges of a voxel: found on boxes with edges of radius 0
and 0.3 of the inscribed one, 20 voxels thick."""
_OF_GRID = 1 / 12
"""Variance in cells**2 that the grid adds: shares of cells are means over them."""
_MORE = 0.012
_MORE_VOXELS = 0.05
"""Share by which a corner's curvature exceeds that of the inscribed sphere: the side of a cylinder, whose
curvature is just that, is no corner, whatever its noise."""
_ABOUT, _FAR_AROUND = 0.2, 0.6
_ASLANT = (0.08, 0.09, 0.07)
_WIDEST = 0.2
"""Most that it may be in inscribed radii: wider ones tell nothing of an edge."""
_MOST_CELLS = 10_000_000
_RAYS = 4


@dataclass(frozen=True, eq=False)
class _Contour:
    """The surface of the smoothed body.

    Attributes
    ----------
    faces : int array, shape (f, 3)
    areas, curvatures : float array, shape (v,)
        Of each vertex: its share of the area in cells**2; its larger principal curvature in 1 / cell,
        positive where convex.
    sigma : float
        Standard deviation of the smoothing, in cells.
    """

    faces: Int[np.ndarray, "f 3"]
    areas: Float[np.ndarray, " v"]
    curvatures: Float[np.ndarray, " v"]
    sigma: float

    @cached_property
    def _mean_of_neighbours(self) -> sparse.csr_matrix:
        count = len(self.areas)
        first, second = self.faces.ravel(), self.faces[:, [1, 2, 0]].ravel()
        both = (np.concatenate([first, second]), np.concatenate([second, first]))
        joined = sparse.coo_matrix((np.ones(len(both[0])), both), shape=(count, count)).tocsr()
        joined.data[:] = 1.0
        joined = joined + 6.0 * sparse.eye(count)
        return (sparse.diags(1.0 / np.asarray(joined.sum(axis=1)).ravel()) @ joined).tocsr()

    def spread(self, values: Float[np.ndarray, "v ..."], width: float) -> Float[np.ndarray, "v ..."]:
        """Return values averaged over the surface with about this standard deviation, in cells."""
        for _ in range(max(1, round(2.0 * width**2))):
            values = self._mean_of_neighbours @ values
        return values

    def corner_radius(self, inscribed_radius: float, excess: float) -> float | None:
        """Return the mean radius of curvature over the corners, over the inscribed radius; None: no corners.

        Smoothing moves a corner's turning apart but neither adds nor takes any. The radius of a corner is
        therefore read where its turning lies in the mean, and its area is radius times turning.
        """
        convex = np.maximum(self.curvatures, 0.0)
        turning = convex * self.areas
        squares, sums = self.spread(np.stack([convex * turning, turning], axis=1), 2.6 * self.sigma).T
        mean = squares / np.maximum(sums, 1e-12)
        # A side as curved as the inscribed sphere is no corner, noise or not: where the surface is about as
        # curved far around, it must be more so in the mean.
        relative = convex * inscribed_radius
        about = np.abs(relative - 1.0) < _ABOUT
        sums, shares = self.spread(
            np.stack([np.where(about, relative, 0.0), about], axis=1), 3.0 * self.sigma
        ).T
        told = np.where(about & (shares > _FAR_AROUND), sums / np.maximum(shares, 1e-12), relative)
        corner = np.minimum(told, mean * inscribed_radius) > 1.0 + excess
        if not corner.any():
            return None
        areas = turning[corner] / mean[corner]
        return float(areas @ (1.0 / mean[corner]) / areas.sum() / inscribed_radius)


def roundness(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    inscribed_radius: float,
    voxel_edge: float = 0.0,
) -> float:
    """Return Wadell's roundness in three dimensions.

    Corners are where the larger principal curvature exceeds that of the inscribed sphere. The mean over
    their area of the radius of curvature, over the radius of the inscribed sphere; 1 where there are none.
    NaN where the edges cannot be told: fewer than 15 voxels across the inscribed sphere, or a body that is
    wider than about 20 times its thickness.

    Parameters
    ----------
    vertices, faces
        A closed surface.
    inscribed_radius : float
        Of the largest sphere in it.
    voxel_edge : float
        Smallest edge of the voxels that the surface follows; 0 for an exact one.

    References
    ----------
    Wadell (1932), Volume, shape, and roundness of rock particles, Journal of Geology 40, 443-451. The
    readings at two scales are extrapolated as Richardson (1911) did.
    """
    of_inscribed, excess = (_OF_INSCRIBED_VOXELS, _MORE_VOXELS) if voxel_edge else (_OF_INSCRIBED, _MORE)
    sigma = max(inscribed_radius / of_inscribed, _VOXELS * voxel_edge)
    if sigma > _WIDEST * inscribed_radius:
        return float("nan")
    share, edge = _share_of_cells(vertices, faces, sigma / _SIGMA)
    radius = inscribed_radius / edge
    if _WIDEST * radius < _SIGMA:
        return float("nan")
    whole = int(share.sum(dtype=np.float64))
    field = ndimage.gaussian_filter(share, _SIGMA)
    narrow = _contour(field, whole, _SIGMA).corner_radius(radius, excess)
    if narrow is None:
        return 1.0
    field = ndimage.gaussian_filter(field, _SIGMA)  # twice as much in all, as _WIDER says
    wide = _contour(field, whole, _WIDER * _SIGMA).corner_radius(radius, excess)
    if wide is None:
        return min(narrow, 1.0)
    before = _SIGMA**2 + _OF_GRID + (_OUTLINE * voxel_edge / edge) ** 2
    beyond = before / ((_WIDER**2 - 1.0) * _SIGMA**2)
    return float(np.sqrt(np.clip(narrow**2 - beyond * (wide**2 - narrow**2), 0.0, 1.0)))


def _share_of_cells(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], edge: float
) -> tuple[Float[np.ndarray, "Z Y X"], float]:
    """Return the share of each cell that lies in the body, and the edge of a cell, longer for a wide body."""
    vertices = _along_its_axes(vertices, faces)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    margin = int(np.ceil(4.0 * _WIDER * _SIGMA)) + 1

    def cells(edge: float) -> Int[np.ndarray, " 3"]:
        counts: np.ndarray = np.ceil((high - low) / edge).astype(int) + 1 + 2 * margin
        return counts

    while np.prod(cells(edge), dtype=float) > _MOST_CELLS:
        edge *= 1.02
    counts = cells(edge)
    origin = (low + high) / 2 - edge * (counts - 1) / 2
    nz, ny, nx = (int(n) for n in counts[::-1])
    return shares_inside(vertices, faces, origin, edge, (nz, ny, nx), _RAYS), edge


def _along_its_axes(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "v 3"]:
    """Return the body turned so that its grid is small, whatever its pose.

    A little aslant: samples along a straight side would err all together.
    """
    corners = vertices[faces]
    sizes = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    middles = corners.mean(axis=1)
    offsets = middles - np.average(middles, axis=0, weights=sizes)
    _, axes = np.linalg.eigh((offsets * sizes[:, None]).T @ offsets)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    turned: np.ndarray = vertices @ axes @ Rotation.from_rotvec(_ASLANT).as_matrix()
    return turned


def _contour(field: Float[np.ndarray, "Z Y X"], whole: int, sigma: float) -> _Contour:
    """Return the surface of a smoothed body that holds as many cells as the body, and its curvatures."""
    from skimage.measure import marching_cubes

    level = float(np.partition(field, field.size - whole, axis=None)[field.size - whole])
    vertices, faces, _, _ = marching_cubes(field, level)
    # Each lies between two nodes of the grid. Of gradient and Hessian, interpolated, the curvature would be
    # off by some per cent: they change much faster from one level set to the next than it does.
    first = np.floor(vertices).astype(np.int64)
    along = vertices - first
    second = first + np.eye(3, dtype=np.int64)[along.argmax(axis=1)]
    share = along.max(axis=1).astype(np.float64)
    curvatures = (1.0 - share) * _largest_curvature(field, first) + share * _largest_curvature(field, second)
    corners = vertices[faces].astype(np.float64)
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    areas = np.bincount(faces.ravel(), np.repeat(doubled / 6, 3), len(vertices))
    return _Contour(faces, areas, curvatures, sigma)


def _largest_curvature(
    field: Float[np.ndarray, "Z Y X"], nodes: Int[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """Return the larger principal curvature of the level sets through nodes of the grid, in 1 / cell.

    Of a level set of f, high inside, the shape operator is -P H P / |grad f| with H the Hessian and P the
    projection onto the tangent plane (Goldman 2005, Curvature formulas for implicit curves and surfaces,
    Computer Aided Geometric Design 22, 632-658). By central differences of the fourth order.
    """
    flat, strides = field.ravel(), (field.shape[1] * field.shape[2], field.shape[2], 1)
    places = nodes @ np.array(strides)

    def at(offset: int) -> Float[np.ndarray, " n"]:
        values: np.ndarray = flat[places + offset].astype(np.float64)
        return values

    slope, hessian = np.empty((len(nodes), 3)), np.empty((len(nodes), 3, 3))
    centre = at(0)
    for i, a in enumerate(strides):
        near, far = (at(a), at(-a)), (at(2 * a), at(-2 * a))
        slope[:, i] = (8.0 * (near[0] - near[1]) - (far[0] - far[1])) / 12
        hessian[:, i, i] = (16.0 * (near[0] + near[1]) - (far[0] + far[1]) - 30.0 * centre) / 12
        for j, b in enumerate(strides[:i]):
            hessian[:, i, j] = hessian[:, j, i] = (at(a + b) - at(a - b) - at(b - a) + at(-a - b)) / 4
    size = np.maximum(np.linalg.norm(slope, axis=1), 1e-9)
    normal = slope / size[:, None]
    tangent = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    operator = -tangent @ hessian @ tangent / size[:, None, None]
    mean = np.trace(operator, axis1=1, axis2=2) / 2
    squares = np.einsum("vij,vij->v", operator, operator)
    largest: np.ndarray = mean + np.sqrt(np.maximum(squares / 2 - mean**2, 0.0))
    return largest
