"""Where an avatar's handles differ from its grain's, by homotopic warping.

The grain's voxels are changed one at a time towards the avatar's, each only if that leaves pieces,
cavities and handles as they are (a *simple* voxel). What cannot be changed in the end is where the
two differ in topology, and nothing else: the membrane across a groove that the avatar bridges, the
plug of a hole that it has in a wall.

References
----------
Bertrand & Malandain (1994), A new characterization of three-dimensional simple points, Pattern
Recognition Letters 15, 169-175.
Jain et al. (2010), Boundary learning by optimization with topological constraints, CVPR.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int

from mbstudio.core.compiled import compiled
from mbstudio.core.imaging.preprocess import PreparedGrain
from mbstudio.core.metaball.field import field_on_grid

_CENTRE = 13  # of the 27 voxels of a neighbourhood, in raster order


def _neighbourhood_tables() -> tuple[np.ndarray, np.ndarray, int, int]:
    """Return bit sets of a voxel's 26 neighbours.

    Those that touch each one at all, those that share a face with it within the 18 nearest, these 18, and the
    6 that share a face with the voxel.
    """
    offsets = np.array([(z, y, x) for z in (-1, 0, 1) for y in (-1, 0, 1) for x in (-1, 0, 1)])
    far = np.abs(offsets).sum(axis=1)
    touching, sharing = np.zeros(27, np.int64), np.zeros(27, np.int64)
    for a in range(27):
        for b in range(27):
            if _CENTRE in (a, b) or a == b:
                continue
            apart = np.abs(offsets[a] - offsets[b])
            if apart.max() == 1:
                touching[a] |= 1 << b
            if apart.sum() == 1 and max(far[a], far[b]) <= 2:
                sharing[a] |= 1 << b
    eighteen = sum(1 << a for a in range(27) if 0 < far[a] <= 2)
    return touching, sharing, eighteen, sum(1 << a for a in range(27) if far[a] == 1)


_TOUCHING, _SHARING, _EIGHTEEN, _FACES = _neighbourhood_tables()


@compiled()
def _grown(seed: int, allowed: int, adjacent: np.ndarray) -> int:
    """Return the bits of `allowed` that are joined to `seed`."""
    reached = front = seed
    while front:
        new = 0
        for b in range(27):
            if front >> b & 1:
                new |= adjacent[b]
        front = new & allowed & ~reached
        reached |= front
    return reached


@compiled()
def is_simple(solid: np.ndarray, z: int, y: int, x: int) -> bool:
    """Tell whether changing a voxel keeps the topology of a solid joined through corners (26, 6).

    So it is if its solid neighbours are one group, and the empty ones that share a face with it are
    joined through faces within its 18 neighbours.
    """
    full, b = 0, 0
    for dz in range(-1, 2):
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                if b != _CENTRE and solid[z + dz, y + dy, x + dx]:
                    full |= 1 << b
                b += 1
    if full == 0 or _grown(full & -full, full, _TOUCHING) != full:
        return False
    empty = _EIGHTEEN & ~full
    sides = empty & _FACES
    return sides != 0 and (sides & ~_grown(sides & -sides, empty, _SHARING)) == 0


@compiled()
def _warp(solid: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Flip `cells` of `solid` in their order, again and again, where simple; return which are left."""
    left = np.ones(len(cells), np.bool_)
    changed = True
    while changed:
        changed = False
        for c in range(len(cells)):
            if left[c]:
                z, y, x = cells[c, 0], cells[c, 1], cells[c, 2]
                if is_simple(solid, z, y, x):
                    solid[z, y, x] = not solid[z, y, x]
                    left[c] = False
                    changed = True
    return left


def differing_cells(
    body: Bool[np.ndarray, "Z Y X"], other: Bool[np.ndarray, "Z Y X"], distance: Float32[np.ndarray, "Z Y X"]
) -> Int[np.ndarray, "c 3"]:
    """Return the voxels (z, y, x) that keep `body` from being changed into `other` homotopically.

    Parameters
    ----------
    body, other : bool array, shape (Z, Y, X)
        Their outermost layer is left alone.
    distance : float array, shape (Z, Y, X)
        To the surface of `body`: voxels near it are tried first, so that what is left across a
        groove lies in its middle.
    """
    where = np.argwhere(body != other)
    where = where[((where > 0) & (where < np.array(body.shape) - 1)).all(axis=1)]
    where = where[np.argsort(np.abs(distance[tuple(where.T)]), kind="stable")]
    left: np.ndarray = where[_warp(body.copy(), where)]
    return left


@dataclass(frozen=True, eq=False)
class TopologyErrors:
    """Places, in the working frame, where an avatar's topology differs from its grain's.

    Attributes
    ----------
    holes : float array, shape (p, 3)
        Voxel centres inside the grain that the avatar should fill.
    bridges : float array, shape (q, 3)
        Voxel centres outside the grain that the avatar should leave empty.
    plugs : float array, shape (h, 3)
        One place inside the grain for each hole, as deep as there is one near it.
    """

    holes: Float64[np.ndarray, "p 3"]
    bridges: Float64[np.ndarray, "q 3"]
    plugs: Float64[np.ndarray, "h 3"]


def _differing_from(
    control: Float64[np.ndarray, "4 n"], prepared: PreparedGrain, fineness: int
) -> Int[np.ndarray, "c 3"]:
    """Return the critical cells (z, y, x) on voxels divided into `fineness`**3."""
    body, distance = prepared.shape, prepared.distance
    for axis in range(3 if fineness > 1 else 0):
        body, distance = np.repeat(body, fineness, axis), np.repeat(distance, fineness, axis)
    spacing = prepared.spacing / fineness
    origin = prepared.origin - 0.5 * prepared.spacing + 0.5 * spacing
    return differing_cells(body, field_on_grid(origin, spacing, body.shape, control) >= 1.0, distance)


_REACH = 2  # voxels about a critical voxel that are held too


def topology_errors(control: Float64[np.ndarray, "4 n"], prepared: PreparedGrain) -> TopologyErrors:
    """Return where the handles of an avatar differ from those of the prepared grain.

    Holes that the grain's voxels cannot show are sought on voxels of half their edge.
    """
    import cc3d
    from scipy.ndimage import binary_dilation

    body = prepared.shape
    critical = np.zeros(body.shape, dtype=bool)
    for fineness in (1, 2):
        cells = _differing_from(control, prepared, fineness)
        if len(cells):
            critical[tuple(cells.T // fineness)] = True
            break
    near = binary_dilation(critical, np.ones((3, 3, 3), dtype=bool), iterations=_REACH)
    plugs = []
    groups = cc3d.connected_components(
        binary_dilation(critical & body, np.ones((3, 3, 3), dtype=bool), iterations=_REACH) & body,
        connectivity=26,
    )
    depth = prepared.distance
    for group in range(1, int(groups.max()) + 1):
        cells = np.argwhere(groups == group)
        plugs.append(cells[depth[tuple(cells.T)].argmax()])

    def places(cells: np.ndarray) -> np.ndarray:
        points: np.ndarray = cells.reshape(-1, 3)[:, ::-1] * prepared.spacing + prepared.origin
        return points

    return TopologyErrors(
        holes=places(np.argwhere(near & body & ((depth > 0.25 * prepared.voxel) | critical))),
        bridges=places(np.argwhere(near & ~body & (critical | (depth < -0.75 * prepared.voxel)))),
        plugs=places(np.array(plugs, dtype=int)),
    )
