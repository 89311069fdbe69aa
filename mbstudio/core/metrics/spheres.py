"""The smallest sphere around a body and the largest one in it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from mbstudio.core.compiled import compiled
from mbstudio.core.errors import MeasureError

_STARTS = 6
_ROUNDS = 40
_EXACT = 1e-5
_CONSTRAINTS = 1500
_OUTSIDE = 1e-10
_MOST_ROUNDS = 1000


@dataclass(frozen=True, eq=False)
class Sphere:
    """A sphere.

    Attributes
    ----------
    centre : float array, shape (3,)
    radius : float
        Both in the unit of the body.
    """

    centre: Float[np.ndarray, " 3"]
    radius: float


def enclosing_sphere(points: Float[np.ndarray, "m 3"]) -> Sphere:
    """Return the smallest sphere that holds all points, exact but for rounding.

    Parameters
    ----------
    points : float array, shape (m, 3)
        For a body, the corners of its hull.

    Notes
    -----
    The sphere is held by two to four points. The farthest point outside joins those, the smallest sphere of
    these few is found among all their subsets, and so on: the radius grows with every round.

    References
    ----------
    Welzl (1991), Smallest enclosing disks (balls and ellipsoids), LNCS 555, 359-370; the exchange of
    holding points follows Gaertner (1999), Fast and robust smallest enclosing balls, LNCS 1643, 325-338.
    """
    points = np.asarray(points, dtype=float)
    first = int(np.linalg.norm(points - points[0], axis=1).argmax())
    holding = [first]
    sphere = Sphere(points[first], 0.0)
    for _ in range(_MOST_ROUNDS):
        distances = np.linalg.norm(points - sphere.centre, axis=1)
        farthest = int(distances.argmax())
        if distances[farthest] <= sphere.radius * (1 + _OUTSIDE) or farthest in holding:
            return Sphere(sphere.centre, float(max(sphere.radius, distances[farthest])))
        larger, holding = _smallest_of_few(points, [*holding, farthest])
        if larger.radius <= sphere.radius:  # what is still outside is so by rounding
            return Sphere(sphere.centre, float(distances[farthest]))
        sphere = larger
    raise MeasureError("No smallest sphere around the body was found: its corners are not finite numbers.")


def _smallest_of_few(points: Float[np.ndarray, "m 3"], members: list[int]) -> tuple[Sphere, list[int]]:
    """Return the smallest sphere around at most five points, and the points that hold it."""
    best: tuple[float, Sphere, list[int]] | None = None
    for count in (2, 3, 4):
        for chosen in combinations(members, count):
            sphere = _circumsphere(points[list(chosen)])
            if sphere is None or (best is not None and sphere.radius >= best[0]):
                continue
            reach = np.linalg.norm(points[members] - sphere.centre, axis=1).max()
            if reach <= sphere.radius * (1 + 1e-9):
                best = (sphere.radius, sphere, list(chosen))
    if best is None:  # all in one place
        return Sphere(points[members[0]], 0.0), members[:1]
    return best[1], best[2]


def _circumsphere(corners: Float[np.ndarray, "k 3"]) -> Sphere | None:
    """Return the smallest sphere through all of two to four points; None if they lie badly."""
    edges = corners[1:] - corners[0]
    gram = edges @ edges.T
    size = float(np.trace(gram))
    if size == 0 or np.linalg.det(gram / size) < 1e-14:
        return None
    offset = np.linalg.solve(2 * gram, np.diag(gram)) @ edges
    return Sphere(corners[0] + offset, float(np.linalg.norm(offset)))


def inscribed_sphere(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    inside: Bool[np.ndarray, "Z Y X"],
    edge: float,
    origin: Float[np.ndarray, " 3"],
) -> Sphere:
    """Return the largest sphere within a closed surface, its radius to about 1e-4.

    Parameters
    ----------
    vertices, faces
        The surface.
    inside : bool array, shape (Z, Y, X)
        Which points of a grid lie in the body; its distance field gives the starts.
    edge : float
        Spacing of the grid.
    origin : float array, shape (3,)
        Position (x, y, z) of inside[0, 0, 0].

    Notes
    -----
    From the deepest few peaks of the distance field: the distances to the nearest triangles are
    linear for small moves of the centre, so the best move within a trust region is a linear programme, whose
    solution stands as far as the distance to the triangles themselves grows.
    """
    triangles = np.ascontiguousarray(vertices[faces], dtype=np.float64)
    middles = triangles.mean(axis=1)
    sizes = np.linalg.norm(triangles - middles[:, None], axis=2).max(axis=1)
    best: Sphere | None = None
    for start in _deepest(inside) * edge + origin:
        sphere = Sphere(start, float(_closest(triangles, start)[0].min()))
        if best is not None and sphere.radius + 2.0 * edge < best.radius:
            continue
        for _ in range(_ROUNDS):
            # Triangles that a sphere could touch after a move of two cells; ridges may be followed further.
            near = np.linalg.norm(middles - sphere.centre, axis=1) - sizes <= sphere.radius + 4.0 * edge
            climbed = _climb(triangles[near], sphere.centre, 2.0 * edge)
            gain, sphere = climbed.radius - sphere.radius, climbed
            if gain <= _EXACT * sphere.radius:
                break
        if best is None or sphere.radius > best.radius:
            best = sphere
    assert best is not None
    return best


def _climb(triangles: Float[np.ndarray, "f 3 3"], centre: Float[np.ndarray, " 3"], limit: float) -> Sphere:
    """Move the centre, by at most about `limit` in all, to where the nearest triangle is farthest."""
    distances, closest = _closest(triangles, centre)
    radius, trust, start = float(distances.min()), 0.5 * limit, centre
    for _ in range(_ROUNDS):
        taking_part = distances <= radius + 2.0 * trust
        away = (centre - closest[taking_part]) / np.maximum(distances[taking_part], 1e-300)[:, None]
        moved = centre + _best_move(away, distances[taking_part], trust)
        trial_distances, trial_closest = _closest(triangles, moved)
        gain = float(trial_distances.min()) - radius
        if gain > 0 and np.linalg.norm(moved - start) <= limit:
            centre, distances, closest = moved, trial_distances, trial_closest
            radius += gain
        else:
            trust *= 0.3
        if trust < _EXACT * radius or (0 < gain < 0.01 * _EXACT * radius):
            break
    return Sphere(centre, radius)


def _best_move(
    away: Float[np.ndarray, "t 3"], distances: Float[np.ndarray, " t"], trust: float
) -> Float[np.ndarray, " 3"]:
    """Return the move within a cube that makes the least of the linearised distances greatest."""
    from scipy.optimize import linprog

    # The closest ones decide; the rest of a smooth body's triangles only take time.
    order = np.argsort(distances, kind="stable")[:_CONSTRAINTS]
    rows = np.column_stack([-away[order], np.ones(len(order))])
    # In lengths of the cube: the solver takes what is smaller than 1e-7 for nothing.
    found = linprog(
        [0, 0, 0, -1], A_ub=rows, b_ub=distances[order] / trust, bounds=[(-1, 1)] * 3 + [(None, None)]
    )
    return trust * found.x[:3] if found.status == 0 else np.zeros(3)


def _deepest(inside: Bool[np.ndarray, "Z Y X"]) -> Float[np.ndarray, "s 3"]:
    """Return the indices (x, y, z) of the few deepest points, apart from each other."""
    import edt

    depth = edt.edt(np.pad(inside, 1), parallel=1)[1:-1, 1:-1, 1:-1]
    peaks = np.argwhere((depth == ndimage.maximum_filter(depth, 3)) & (depth > 0.9 * depth.max()))
    peaks = peaks[np.argsort(-depth[tuple(peaks.T)], kind="stable")]
    kept: list[np.ndarray] = []
    for peak in peaks:
        if all(np.linalg.norm(peak - other) > 0.25 * depth.max() for other in kept):
            kept.append(peak)
        if len(kept) == _STARTS:
            break
    return np.array(kept, dtype=float)[:, ::-1]


@compiled()
def _closest(triangles: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance of a point to each triangle, and the closest points (Ericson 2004, 5.1.5)."""
    distances = np.empty(len(triangles))
    closest = np.empty((len(triangles), 3))
    px, py, pz = point
    for f in range(len(triangles)):
        ax, ay, az = triangles[f, 0]
        abx, aby, abz = triangles[f, 1, 0] - ax, triangles[f, 1, 1] - ay, triangles[f, 1, 2] - az
        acx, acy, acz = triangles[f, 2, 0] - ax, triangles[f, 2, 1] - ay, triangles[f, 2, 2] - az
        apx, apy, apz = px - ax, py - ay, pz - az
        d1 = abx * apx + aby * apy + abz * apz
        d2 = acx * apx + acy * apy + acz * apz
        bb = abx * abx + aby * aby + abz * abz
        bc = abx * acx + aby * acy + abz * acz
        cc = acx * acx + acy * acy + acz * acz
        d3, d4 = d1 - bb, d2 - bc
        d5, d6 = d1 - bc, d2 - cc
        vc, vb, va = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
        if d1 <= 0 and d2 <= 0:
            v, w = 0.0, 0.0
        elif d3 >= 0 and d4 <= d3:
            v, w = 1.0, 0.0
        elif vc <= 0 and d1 >= 0 and d3 <= 0:
            v, w = d1 / (d1 - d3), 0.0
        elif d6 >= 0 and d5 <= d6:
            v, w = 0.0, 1.0
        elif vb <= 0 and d2 >= 0 and d6 <= 0:
            v, w = 0.0, d2 / (d2 - d6)
        elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
            w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
            v = 1.0 - w
        else:
            total = va + vb + vc
            if total <= 0:
                v, w = 0.0, 0.0
            else:
                v, w = vb / total, vc / total
        x, y, z = apx - v * abx - w * acx, apy - v * aby - w * acy, apz - v * abz - w * acz
        distances[f] = np.sqrt(x * x + y * y + z * z)
        closest[f, 0], closest[f, 1], closest[f, 2] = px - x, py - y, pz - z
    return distances, closest
