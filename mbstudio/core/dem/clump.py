"""A sphere clump fitted to an avatar: overlapping spheres, as many as asked for.

The start is greedy: from spheres inscribed in the avatar, each next one covers the most that is
still uncovered. Then all centres and radii move together so that the surfaces meet: points of the
avatar's surface pull the sphere nearest to them, points of the clump's bare surface are pulled to
the avatar (iteratively reweighted Gauss-Newton, which minimises the mean distance, hence nearly
the volume that only one of both holds). As every residual belongs to one sphere, the normal
equations fall into 4 x 4 blocks. At last a common offset of the radii makes the volume right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from mbstudio.core.errors import ExportError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.surfaces import avatar_surface
from mbstudio.core.units import conversion_factor, parse_unit

_CANDIDATES = 1200
_COVERED_POINTS = 6000
_SURFACE_POINTS = 3000
_SPHERE_POINTS = 96
_ROUNDS = 60
_GRID = 72
_SMALLEST = 0.1
"""Smallest radius over the largest inscribed one: engines choose their time step by the smallest sphere."""


@dataclass(frozen=True, eq=False)
class Clump:
    """Overlapping spheres that stand for an avatar.

    Attributes
    ----------
    centers : float array, shape (n, 3)
        In unit, in the frame of the avatar.
    radii : float array, shape (n,)
        In unit, positive.
    unit : str
    iou : float
        Volume of the intersection of clump and avatar over that of their union.
    volume_ratio : float
        Volume of the union of spheres over that of the avatar.
    mean_distance, hausdorff : float
        Mean and largest distance between both surfaces (both ways), in unit.
    """

    centers: Float[np.ndarray, "n 3"]
    radii: Float[np.ndarray, " n"]
    unit: str
    iou: float = float("nan")
    volume_ratio: float = float("nan")
    mean_distance: float = float("nan")
    hausdorff: float = float("nan")

    def to(self, unit: str) -> Clump:
        """Return the same clump with lengths in another unit."""
        f = conversion_factor(self.unit, unit)
        return replace(
            self,
            centers=self.centers * f,
            radii=self.radii * f,
            unit=parse_unit(unit),
            mean_distance=self.mean_distance * f,
            hausdorff=self.hausdorff * f,
        )

    def distance(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
        """Return the distance of points to the nearest sphere's surface, negative inside."""
        return nearest_sphere(points, self.centers, self.radii)[1]


def sphere_clump(avatar: Avatar, spheres: int = 40, *, seed: int = 0) -> Clump:
    """Fit a clump of overlapping spheres to an avatar.

    Parameters
    ----------
    avatar : Avatar
    spheres : int
        At least 2.
    seed : int
        Of the random choice among candidates.

    Raises
    ------
    ExportError
        If fewer than two spheres are asked for.
    MeasureError
        If the avatar is in several pieces.
    """
    if spheres < 2:
        raise ExportError(f"A clump of {spheres} spheres is none: ask for at least 2.")
    task = _Task.of(avatar, np.random.default_rng(seed))
    centers, radii = _greedy_start(task, spheres)
    centers, radii = _meet_surfaces(task, centers, radii)
    return _finish(task, centers, radii)


@dataclass(frozen=True, eq=False)
class _Task:
    """The avatar as the fit sees it, centred and scaled to a nominal radius of order one."""

    avatar: Avatar
    origin: Float[np.ndarray, " 3"]
    scale: float
    surface: Float[np.ndarray, "s 3"]
    surface_all: Float[np.ndarray, "v 3"]
    grid: Float[np.ndarray, "g 3"]
    inside: Bool[np.ndarray, " g"]
    rng: np.random.Generator

    @classmethod
    def of(cls, avatar: Avatar, rng: np.random.Generator) -> _Task:
        vertices, faces = avatar_surface(avatar).coarse
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        origin, scale = (low + high) / 2, float((high - low).max()) / 2
        local = replace(avatar, centers=(avatar.centers - origin) / scale, weights=avatar.weights / scale**2)
        vertices = (vertices - origin) / scale
        low, high = (low - origin) / scale, (high - origin) / scale
        spacing = 2.0 / _GRID
        margin = 0.06
        axes = [np.arange(a - margin, b + margin + spacing, spacing) for a, b in zip(low, high, strict=True)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        inside = np.asarray(local.field(grid)) >= 1.0
        return cls(
            local,
            origin,
            scale,
            _spread_over(vertices, faces, _SURFACE_POINTS, rng),
            vertices,
            grid,
            inside,
            rng,
        )

    def distance_and_normal(
        self, points: Float[np.ndarray, "m 3"]
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 3"]]:
        """Return the first-order distance to the avatar (negative inside) and its outward direction."""
        value = np.asarray(self.avatar.field(points))
        slope = np.asarray(self.avatar.gradient(points))
        steepness = np.maximum(np.linalg.norm(slope, axis=1), 1e-12)
        u = value**-0.5
        return (u - 1.0) * 2.0 / (u**3 * steepness), -slope / steepness[:, None]


def nearest_sphere(
    points: Float[np.ndarray, "m 3"], centers: Float[np.ndarray, "n 3"], radii: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Return the sphere whose surface is nearest (or deepest around) each point, and that signed distance."""
    owner, best = np.zeros(len(points), dtype=np.int64), np.empty(len(points))
    _nearest_sphere(np.ascontiguousarray(points), centers, radii, owner, best)
    return owner, best


@njit(cache=True, nogil=True)
def _nearest_sphere(points, centers, radii, owner, best):  # pragma: no cover - compiled
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        smallest = np.inf
        for i in range(len(radii)):
            dx, dy, dz = x - centers[i, 0], y - centers[i, 1], z - centers[i, 2]
            distance = np.sqrt(dx * dx + dy * dy + dz * dz) - radii[i]
            if distance < smallest:
                smallest = distance
                owner[p] = i
        best[p] = smallest


def _spread_over(
    vertices: Float[np.ndarray, "v 3"], faces: np.ndarray, count: int, rng: np.random.Generator
) -> Float[np.ndarray, "s 3"]:
    """Return points spread evenly over a mesh (stratified by area)."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    ends = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    picks = np.searchsorted(ends, (np.arange(count) + rng.random(count)) / count * ends[-1])
    picks = np.minimum(picks, len(faces) - 1)
    r, s = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return (1 - r) * a[picks] + r * (1 - s) * b[picks] + r * s * c[picks]


def _greedy_start(task: _Task, spheres: int) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Pick inscribed spheres (a little too large, so that they overlap), each for what it newly covers."""
    from scipy.spatial import cKDTree

    interior = task.grid[task.inside]
    depth = cKDTree(task.surface_all).query(interior)[0]
    chance = depth**1.5
    count = min(_CANDIDATES, len(interior))
    chosen = task.rng.choice(len(interior), count, replace=False, p=chance / chance.sum())
    chosen[0] = depth.argmax()
    centers, radii = interior[chosen], depth[chosen] * 1.02 + 0.01
    covered_points = interior[
        task.rng.choice(len(interior), min(_COVERED_POINTS, len(interior)), replace=False)
    ]
    squared = (
        (covered_points**2).sum(axis=1)[None] + (centers**2).sum(axis=1)[:, None]
    ) - 2 * centers @ covered_points.T
    covers = (squared <= radii[:, None] ** 2).astype(np.float32)
    uncovered = np.ones(len(covered_points), dtype=np.float32)
    picked: list[int] = []
    for _ in range(spheres):
        gain = covers @ uncovered
        if picked:
            gain[picked] = -1.0
        best = int(gain.argmax())
        picked.append(best)
        uncovered *= 1.0 - covers[best]
    return centers[picked], radii[picked]


def _meet_surfaces(
    task: _Task, centers: Float[np.ndarray, "n 3"], radii: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Move all spheres until both surfaces meet; return the best state on the way."""
    directions = _sphere_points(_SPHERE_POINTS)
    smallest = _SMALLEST * float(radii.max())
    best = (np.inf, centers, radii)
    damping = 1e-2
    for round_ in range(_ROUNDS):
        owner, gaps = nearest_sphere(task.surface, centers, radii)
        bare, sphere_of_bare, overshoot, normals = _bare_points(task, centers, radii, directions)
        # Each bare point stands for its share of the clump's surface, each surface point for its share.
        share = radii[sphere_of_bare] ** 2 * 4 * np.pi / len(directions)
        share *= len(task.surface) / max(float(share.sum()), 1e-12)
        score = float(np.abs(gaps).mean() + (share * np.abs(overshoot)).sum() / len(task.surface))
        if score < best[0]:
            best = (score, centers, radii)
        if round_ in (8, 16, 24):
            centers, radii = _move_idle_sphere(task, centers, radii, owner, gaps)
            continue
        outward = (task.surface - centers[owner]) / (gaps + radii[owner])[:, None]
        floor = max(0.25 * score, 1e-4)
        # d gap = -outward . dc - dr ; d overshoot = normal . dc + (normal . direction) dr
        rows = np.concatenate(
            [
                np.column_stack([-outward, -np.ones(len(gaps))]),
                np.column_stack([normals, np.einsum("ij,ij->i", normals, bare)]),
            ]
        )
        values = np.concatenate([gaps, overshoot])
        weights = np.concatenate([np.ones(len(gaps)), share]) / np.sqrt(values**2 + floor**2)
        steps = _block_steps(
            np.concatenate([owner, sphere_of_bare]), rows, values, weights, len(radii), damping
        )
        limit = 0.3 * radii[:, None]
        steps = np.clip(steps, -limit, limit) * 0.7
        centers = centers + steps[:, :3]
        radii = np.maximum(radii + steps[:, 3], smallest)
    return best[1], best[2]


def _bare_points(
    task: _Task,
    centers: Float[np.ndarray, "n 3"],
    radii: Float[np.ndarray, " n"],
    directions: Float[np.ndarray, "d 3"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the points of the clump's bare surface: direction, sphere, distance to the avatar, normal."""
    points = (centers[:, None] + radii[:, None, None] * directions).reshape(-1, 3)
    sphere = np.repeat(np.arange(len(radii)), len(directions))
    towards = np.tile(directions, (len(radii), 1))
    bare = nearest_sphere(points, centers, radii)[1] > -1e-9
    distance, normals = task.distance_and_normal(points[bare])
    return towards[bare], sphere[bare], np.clip(distance, -0.5, 0.5), normals


def _block_steps(
    sphere: np.ndarray, rows: np.ndarray, values: np.ndarray, weights: np.ndarray, count: int, damping: float
) -> Float[np.ndarray, "n 4"]:
    """Solve the damped normal equations of every sphere: (J^T W J + damping) step = -J^T W r."""
    products = np.einsum("m,mi,mj->mij", weights, rows, rows).reshape(-1, 16)
    normal = np.stack([np.bincount(sphere, products[:, e], count) for e in range(16)], axis=1).reshape(
        -1, 4, 4
    )
    loads = rows * (weights * values)[:, None]
    right = np.stack([np.bincount(sphere, loads[:, e], count) for e in range(4)], axis=1)
    trace = np.einsum("nii->n", normal)
    normal += (damping * trace + 1e-6)[:, None, None] * np.eye(4)
    return -np.linalg.solve(normal, right[..., None])[..., 0]


def _move_idle_sphere(
    task: _Task, centers: np.ndarray, radii: np.ndarray, owner: np.ndarray, gaps: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Put the spheres that hold the fewest surface points where the clump lies furthest below the surface."""
    held = np.bincount(owner, minlength=len(radii))
    idle = np.argsort(held, kind="stable")[: max(1, len(radii) // 12)]
    idle = idle[held[idle] < 0.25 * len(owner) / len(radii)]
    centers, radii, gaps = centers.copy(), radii.copy(), gaps.copy()
    _, normals = task.distance_and_normal(task.surface)
    for index in idle:
        worst = int(gaps.argmax())
        radius = max(3.0 * float(gaps[worst]), 2 * _SMALLEST * float(radii.max()))
        centers[index] = task.surface[worst] - normals[worst] * radius
        radii[index] = radius
        gaps = np.minimum(gaps, np.linalg.norm(task.surface - centers[index], axis=1) - radius)
    return centers, radii


def _finish(task: _Task, centers: Float[np.ndarray, "n 3"], radii: Float[np.ndarray, " n"]) -> Clump:
    """Make volume and centre of mass those of the avatar, and say how good the clump is."""
    floor = 0.5 * float(radii.min())
    for _ in range(2):
        distance = nearest_sphere(task.grid, centers, radii)[1]
        wanted = int(task.inside.sum())
        # A common offset of all radii moves the union's distance by the same amount everywhere.
        offset = float(np.partition(distance, wanted)[wanted])
        radii = np.maximum(radii + offset, floor)
        filled = nearest_sphere(task.grid, centers, radii)[1] <= 0
        centers = centers + task.grid[task.inside].mean(axis=0) - task.grid[filled].mean(axis=0)
    filled = nearest_sphere(task.grid, centers, radii)[1] <= 0
    union, both = np.count_nonzero(filled | task.inside), np.count_nonzero(filled & task.inside)
    _, _, overshoot, _ = _bare_points(task, centers, radii, _sphere_points(4 * _SPHERE_POINTS))
    gaps = np.abs(nearest_sphere(task.surface, centers, radii)[1])
    return Clump(
        centers * task.scale + task.origin,
        radii * task.scale,
        task.avatar.unit,
        iou=float(both / union),
        volume_ratio=float(np.count_nonzero(filled) / np.count_nonzero(task.inside)),
        mean_distance=float(np.concatenate([gaps, np.abs(overshoot)]).mean()) * task.scale,
        hausdorff=float(max(gaps.max(), np.abs(overshoot).max(initial=0.0))) * task.scale,
    )


def _sphere_points(count: int) -> Float[np.ndarray, "d 3"]:
    """Evenly spread points on the unit sphere (Fibonacci)."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    azimuth = np.pi * (1 + np.sqrt(5.0)) * index
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)
