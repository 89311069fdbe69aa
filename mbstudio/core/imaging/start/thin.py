"""Control points for thin bodies: spread evenly over the middle of the body, and how many it needs.

Sphere clustering takes the largest sphere first. In a sheet, a shell or a rod all spheres are of
one size, so that it packs them side by side and fills what is left with slivers: control points
of very different weights at uneven distances, between which the surface tears. Here control
points are spread by *farthest-point sampling* over the middle of the body, distances counted in
local radii: one control point for so many of the body's own thicknesses.

References
----------
Gonzalez (1985), Clustering to minimize the maximum intercluster distance, Theor. Comput. Sci. 38, 293-306.
Hildebrand & Ruegsegger (1997), A new method for the model-independent assessment of thickness in
three-dimensional images, J. Microsc. 185, 67-75.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from mbstudio.core.compiled import compiled
from mbstudio.core.imaging.preprocess import PreparedGrain
from mbstudio.core.imaging.start.control_points import rescale

_COVER = 2.0  # reach of a sphere in its own radii, where the local radius is looked for
_MIDDLE = 0.7  # of the local radius: the least depth of the middle
_MOST_PLACES = 20_000
_MOST_NEEDED = 5_000
_LLOYD_ITERATIONS = 15
GAP = 1.7
"""Local radii between the control points of a body that has enough of them."""


@compiled(error_model="numpy")
def _local_radii(
    depth: np.ndarray, order: np.ndarray, spacing: np.ndarray, cover: float, radius: np.ndarray
) -> None:
    """Write the radius of the largest sphere within `cover` of whose radii a voxel lies; deepest first."""
    nz, ny, nx = depth.shape
    # Spheres are taken one radius apart: near enough to leave no voxel of a sheet's faces uncovered.
    taken = np.zeros(depth.shape, dtype=np.bool_)
    for flat in order:
        iz, rest = divmod(flat, ny * nx)
        iy, ix = divmod(rest, nx)
        if taken[iz, iy, ix]:
            continue
        own = depth[iz, iy, ix]
        reach = cover * own
        rz, ry, rx = int(reach / spacing[2]), int(reach / spacing[1]), int(reach / spacing[0])
        for jz in range(max(0, iz - rz), min(nz, iz + rz + 1)):
            for jy in range(max(0, iy - ry), min(ny, iy + ry + 1)):
                for jx in range(max(0, ix - rx), min(nx, ix + rx + 1)):
                    dz, dy, dx = (jz - iz) * spacing[2], (jy - iy) * spacing[1], (jx - ix) * spacing[0]
                    square = dz * dz + dy * dy + dx * dx
                    if square <= reach * reach:
                        radius[jz, jy, jx] = max(radius[jz, jy, jx], own)
                    if square <= own * own:
                        taken[jz, jy, jx] = True


@compiled(error_model="numpy")
def _farthest(
    places: np.ndarray, radii: np.ndarray, first: int, chosen: np.ndarray, reach: np.ndarray, gap: float
) -> int:
    """Choose places, each the farthest (in radii) from those before; return how many until `gap`."""
    total = places.shape[0]
    nearest = np.full(total, np.inf)
    best = first
    for made in range(len(chosen)):
        chosen[made] = best
        x, y, z = places[best, 0], places[best, 1], places[best, 2]
        best, top = 0, -1.0
        for p in range(total):
            dx, dy, dz = places[p, 0] - x, places[p, 1] - y, places[p, 2] - z
            square = (dx * dx + dy * dy + dz * dz) / (radii[p] * radii[p])
            if square < nearest[p]:
                nearest[p] = square
            if nearest[p] > top:
                best, top = p, nearest[p]
        reach[made] = np.sqrt(top)
        if reach[made] < gap:
            return made + 1
    return len(chosen)


def middle(prepared: PreparedGrain) -> tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "p"]]:
    """Return places (x, y, z) in the middle of the grain and the local radius at each, in working lengths.

    The local radius is that of the largest inscribed sphere about a voxel; the middle are the
    voxels nearly as deep as that. At most 20,000 of them, evenly taken.
    """
    depth = prepared.distance + np.float32(0.25 * prepared.voxel)
    inside = np.flatnonzero(prepared.distance.ravel() > 0)
    order = inside[np.argsort(-depth.ravel()[inside], kind="stable")]
    radius = np.zeros(depth.shape, dtype=np.float32)
    _local_radii(depth, order, prepared.spacing, _COVER, radius)
    chosen = np.flatnonzero((prepared.distance > 0).ravel() & (depth >= _MIDDLE * radius).ravel())
    chosen = chosen[:: -(-len(chosen) // _MOST_PLACES)]
    voxels = np.stack(np.unravel_index(chosen, depth.shape), axis=1)
    return voxels[:, ::-1] * prepared.spacing + prepared.origin, radius.ravel()[chosen].astype(np.float64)


def number_needed(prepared: PreparedGrain) -> int:
    """Return about how many control points a body of this shape needs for a valid avatar.

    So many that no place in the middle is farther from the nearest than :data:`GAP` local radii:
    the number goes with the surface integral of dA / thickness**2 for a sheet, and with the length
    over the thickness for a rod.
    """
    places, radii = middle(prepared)
    chosen = np.empty(min(len(places), _MOST_NEEDED), dtype=np.int64)
    return _farthest(places, radii, int(radii.argmax()), chosen, np.empty(len(chosen)), GAP)


def spread(prepared: PreparedGrain, n: int) -> Float64[np.ndarray, "4 n"] | None:
    """Return `n` control points spread evenly over the middle of a body, None if it holds fewer places.

    Rows x, y, z, k in the working frame. Farthest-point sampling, then Lloyd's iterations in which
    thin places count the more, so that the points lie nearer together there.
    """
    from scipy.spatial import cKDTree

    places, radii = middle(prepared)
    if len(places) < n:
        return None
    chosen = np.empty(n, dtype=np.int64)
    _farthest(places, radii, int(radii.argmax()), chosen, np.empty(n), 0.0)
    centers, burden = places[chosen], radii**-4.0
    for _ in range(_LLOYD_ITERATIONS):
        nearest = cKDTree(centers).query(places)[1]
        total = np.maximum(np.bincount(nearest, weights=burden, minlength=n), 1e-300)
        for axis in range(3):
            centers[:, axis] = np.bincount(nearest, burden * places[:, axis], n) / total
    # Back to the middle: the mean of places about a bend lies off it.
    at = cKDTree(places).query(centers)[1]
    control = np.vstack([places[at].T, radii[at] ** 2])
    rescale(control, prepared)
    return control
