"""A sphere clump fitted to an avatar: overlapping spheres, as many as asked for.

The start is greedy: from spheres inscribed in the avatar, each next one covers the most that is
still uncovered. Then all centres and radii move together so that the surfaces meet: points of the
avatar's surface pull the sphere nearest to them, points of the clump's bare surface are pulled to
the avatar (iteratively reweighted Gauss-Newton, which minimises the mean distance, hence nearly
the volume that only one of both holds). As every residual belongs to one sphere, the normal
equations fall into 4 x 4 blocks. At last volume, centre of mass and inertia are made the avatar's
(:mod:`mbstudio.core.dem.shapes.clump_finish`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from mbstudio.core.dem.shapes.clump_finish import figures, finished
from mbstudio.core.dem.shapes.clump_memory import MEMORY, normal_form
from mbstudio.core.dem.shapes.clump_task import (
    SPHERE_POINTS,
    ClumpTask,
    bare_points,
    nearest_sphere,
    sphere_points,
)
from mbstudio.core.errors import ExportError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.units import conversion_factor, parse_unit

_CANDIDATES = 1200
_COVERED_POINTS = 6000
_ROUNDS = 60
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
    inertia_error : float
        Of the union of spheres, as a solid of the avatar's density: Frobenius norm of the difference of both
        inertia tensors about the centres of mass, over that of the avatar's.
    mean_distance, hausdorff : float
        Mean and largest distance between both surfaces (both ways), in unit.
    """

    centers: Float[np.ndarray, "n 3"]
    radii: Float[np.ndarray, " n"]
    unit: str
    iou: float = float("nan")
    volume_ratio: float = float("nan")
    inertia_error: float = float("nan")
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

    What was fitted before to the same avatar, in whatever unit, is not fitted again.

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
        raise ExportError(f"A clump needs at least 2 spheres, not {spheres}.")
    normal = normal_form(avatar)
    kept = MEMORY.find(normal.digest, spheres, seed)
    if kept is None:
        kept = _fitted(normal.avatar, spheres, seed)
        MEMORY.keep(normal.digest, spheres, seed, *kept)
    rows, (iou, volume_ratio, inertia_error, mean_distance, hausdorff) = kept
    return Clump(
        rows[:, :3] * normal.size,
        rows[:, 3] * normal.size,
        avatar.unit,
        iou=iou,
        volume_ratio=volume_ratio,
        inertia_error=inertia_error,
        mean_distance=mean_distance * normal.size,
        hausdorff=hausdorff * normal.size,
    )


def _fitted(avatar: Avatar, spheres: int, seed: int) -> tuple[Float[np.ndarray, "n 4"], tuple[float, ...]]:
    """Return rows x, y, z, r of a clump and its figures, in the order of :class:`Clump`."""
    task = ClumpTask.from_avatar(avatar, np.random.default_rng(seed))
    centers, radii = _greedy_start(task, spheres)
    centers, radii = _meet_surfaces(task, centers, radii)
    centers, radii = finished(task, centers, radii)
    found = figures(task, centers, radii)
    return np.column_stack([centers * task.scale + task.origin, radii * task.scale]), (
        found.iou,
        found.volume_ratio,
        found.inertia_error,
        found.mean_distance * task.scale,
        found.hausdorff * task.scale,
    )


def is_remembered(avatar: Avatar, spheres: int, seed: int = 0) -> bool:
    """Whether :func:`sphere_clump` would not have to fit."""
    return MEMORY.find(normal_form(avatar).digest, spheres, seed) is not None


def _greedy_start(task: ClumpTask, spheres: int) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
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
    task: ClumpTask, centers: Float[np.ndarray, "n 3"], radii: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Move all spheres until both surfaces meet; return the best state on the way."""
    directions = sphere_points(SPHERE_POINTS)
    smallest = _SMALLEST * float(radii.max())
    best = (np.inf, centers, radii)
    damping = 1e-2
    for round_ in range(_ROUNDS):
        owner, gaps = nearest_sphere(task.surface, centers, radii)
        bare, sphere_of_bare, overshoot, normals = bare_points(task, centers, radii, directions)
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
    task: ClumpTask, centers: np.ndarray, radii: np.ndarray, owner: np.ndarray, gaps: np.ndarray
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
