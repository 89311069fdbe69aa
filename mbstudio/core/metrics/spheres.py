"""The smallest sphere around a body and the largest one in it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from mbstudio.core.compiled import compiled
from mbstudio.core.errors import MeasureError

_STARTS = 24
_ROUNDS = 100
_PIVOTS = 200
_EXACT = 1e-6
_HELD = 1e-10
"""Share of its radius by which a sphere through few points may miss another of them."""
_OUTSIDE = 1e-9
"""Share of its radius that counts as outside; more than `_HELD`, or points would go in and out for ever."""
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
            if reach <= sphere.radius * (1 + _HELD):
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
    """Return the largest sphere within a closed surface, its radius to about 1e-5.

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
    From the deepest peaks of the distance field. The distance to a triangle is a convex function of the
    centre, so its linearisation never exceeds it: where the least of the linearised distances to *all*
    triangles is greatest, the sphere is at least as large as the linear programme says, and the way there
    stays within the body. Such moves are repeated until nothing is gained.
    """
    triangles = np.ascontiguousarray(vertices[faces], dtype=np.float64)
    starts = _deepest(inside) * edge + origin
    radii = np.array([_closest(triangles, start)[0].min() for start in starts])
    best: Sphere | None = None
    for place in np.argsort(-radii, kind="stable"):
        # A point is at most about a cell from the peak that it stands for.
        if best is not None and radii[place] + 2.0 * edge < best.radius:
            continue
        climbed = _climb(triangles, starts[place])
        if best is None or climbed.radius > best.radius:
            best = climbed
    assert best is not None
    return best


def _climb(triangles: Float[np.ndarray, "f 3 3"], centre: Float[np.ndarray, " 3"]) -> Sphere:
    """Move the centre to where the nearest triangle is farthest, uphill only."""
    distances, closest = _closest(triangles, centre)
    radius = float(distances.min())
    reach = 0.5 * radius
    for _ in range(_ROUNDS):
        away = (centre - closest) / np.maximum(distances, 1e-300)[:, None]
        move = _best_move(away, distances, reach)
        moved = centre + move
        trial_distances, trial_closest = _closest(triangles, moved)
        gain = float(trial_distances.min()) - radius
        if gain <= 0:
            break
        centre, distances, closest, radius = moved, trial_distances, trial_closest, radius + gain
        if gain <= _EXACT * radius and float(np.abs(move).max()) < reach:
            break
    return Sphere(centre, radius)


@compiled()
def _best_move(away: np.ndarray, distances: np.ndarray, reach: float) -> np.ndarray:
    """Return the move within a cube that makes the least of the linearised distances greatest.

    The dual simplex method: of the linear programme max r, r - away[i] . m <= distances[i], |m[j]| <= reach,
    four constraints hold a solution; the one most exceeded takes the place of one of them, until none is.
    """
    rows = np.empty((4, 4))  # what holds the solution, as row . (m, r) <= bound
    bounds = np.empty(4)
    first = int(np.argmin(distances))
    rows[0, :3], rows[0, 3], bounds[0] = -away[first], 1.0, distances[first]
    for j in range(3):
        rows[j + 1] = 0.0
        rows[j + 1, j] = 1.0 if away[first, j] >= 0.0 else -1.0
        bounds[j + 1] = reach
    goal = np.array([0.0, 0.0, 0.0, 1.0])
    best: np.ndarray = np.zeros(3)
    for _ in range(_PIVOTS):
        solution = np.linalg.solve(rows, bounds)
        move, radius = solution[:3], solution[3]
        worst, entering = 1e-12 * radius, -1
        for i in range(len(distances)):
            excess = (
                radius - away[i, 0] * move[0] - away[i, 1] * move[1] - away[i, 2] * move[2] - distances[i]
            )
            if excess > worst:
                worst, entering = excess, i
        side = 0
        for j in range(3):
            if abs(move[j]) - reach > worst:
                worst, entering, side = abs(move[j]) - reach, j, 1 if move[j] > 0 else -1
        best = move
        if entering < 0:
            break
        row = np.zeros(4)
        if side == 0:
            row[:3], row[3], bound = -away[entering], 1.0, distances[entering]
        else:
            row[entering], bound = float(side), reach
        weights = np.linalg.solve(rows.T, goal)  # of the constraints in the goal, none negative
        shares = np.linalg.solve(rows.T, row)
        leaving, least = -1, np.inf
        for j in range(4):
            if shares[j] > 1e-12 and max(weights[j], 0.0) / shares[j] < least:
                leaving, least = j, max(weights[j], 0.0) / shares[j]
        if leaving < 0:
            break
        rows[leaving], bounds[leaving] = row, bound
    within: np.ndarray = np.clip(best, -reach, reach)
    return within


def _deepest(inside: Bool[np.ndarray, "Z Y X"]) -> Float[np.ndarray, "s 3"]:
    """Return the indices (x, y, z) of deep points, apart from each other.

    Depth on a grid is off by up to about a cell, in a plate a good part of the depth itself: what is deep
    but for two cells is tried.
    """
    import edt

    depth = edt.edt(np.pad(inside, 1), parallel=1)[1:-1, 1:-1, 1:-1]
    deepest = depth.max()
    least = max(min(0.9 * deepest, deepest - 2.0), 0.5 * deepest)
    peaks = np.argwhere((depth == ndimage.maximum_filter(depth, 3)) & (depth >= least))
    peaks = peaks[np.argsort(-depth[tuple(peaks.T)], kind="stable")]
    kept: list[np.ndarray] = []
    for peak in peaks:
        if all(np.linalg.norm(peak - other) > 0.25 * deepest for other in kept):
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
