"""What the fit of a sphere clump works on: the avatar, points of its surface, and a grid around it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from mbstudio.core.compiled import compiled
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.surfaces import avatar_surface

_SURFACE_POINTS = 3000
_GRID = 72
_MARGIN = 0.2
"""Of the grid around the avatar, over half its longest side: a clump of few spheres stands out."""
SPHERE_POINTS = 96


@dataclass(frozen=True, eq=False)
class ClumpTask:
    """The avatar as the fit sees it, centred and scaled to half a longest side of one.

    Attributes
    ----------
    avatar : Avatar
    origin : float array, shape (3,)
        What was taken from places, in the unit of the avatar that was given.
    scale : float
        What lengths were divided by.
    surface, surface_all : float array, shape (points, 3)
        Some points spread evenly over the surface, and all vertices of its mesh.
    grid : float array, shape (nodes, 3)
    spacing : float
        Of the nodes.
    inside : bool array, shape (nodes,)
    filled : float array, shape (nodes,)
        Share of each node's cell that the avatar fills.
    rng : numpy Generator
    """

    avatar: Avatar
    origin: Float[np.ndarray, " 3"]
    scale: float
    surface: Float[np.ndarray, "s 3"]
    surface_all: Float[np.ndarray, "v 3"]
    grid: Float[np.ndarray, "g 3"]
    spacing: float
    inside: Bool[np.ndarray, " g"]
    filled: Float[np.ndarray, " g"]
    rng: np.random.Generator

    @classmethod
    def from_avatar(cls, avatar: Avatar, rng: np.random.Generator) -> ClumpTask:
        vertices, faces = avatar_surface(avatar).coarse
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        origin, scale = (low + high) / 2, float((high - low).max()) / 2
        local = replace(avatar, centers=(avatar.centers - origin) / scale, weights=avatar.weights / scale**2)
        vertices = (vertices - origin) / scale
        low, high = (low - origin) / scale, (high - origin) / scale
        spacing = 2.0 / _GRID
        axes = [
            np.arange(a - _MARGIN, b + _MARGIN + spacing, spacing) for a, b in zip(low, high, strict=True)
        ]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        field = np.asarray(local.field(grid))
        inside = field >= 1.0
        return cls(
            local,
            origin,
            scale,
            spread_over(vertices, faces, _SURFACE_POINTS, rng),
            vertices,
            grid,
            spacing,
            inside,
            _filled_share(local, grid, field, spacing),
            rng,
        )

    def distance_and_normal(
        self, points: Float[np.ndarray, "m 3"]
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 3"]]:
        """Return the first-order distance to the avatar (negative inside) and its outward direction."""
        return _first_order(self.avatar, points, np.asarray(self.avatar.field(points)))


def nearest_sphere(
    points: Float[np.ndarray, "m 3"], centers: Float[np.ndarray, "n 3"], radii: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Return the sphere whose surface is nearest (or deepest around) each point, and that signed distance."""
    owner, best = np.zeros(len(points), dtype=np.int64), np.empty(len(points))
    _nearest_sphere(np.ascontiguousarray(points), centers, radii, owner, best)
    return owner, best


@compiled()
def _nearest_sphere(
    points: np.ndarray, centers: np.ndarray, radii: np.ndarray, owner: np.ndarray, best: np.ndarray
) -> None:
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


def spread_over(
    vertices: Float[np.ndarray, "v 3"], faces: np.ndarray, count: int, rng: np.random.Generator
) -> Float[np.ndarray, "s 3"]:
    """Return points spread evenly over a mesh (stratified by area)."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    ends = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    picks = np.searchsorted(ends, (np.arange(count) + rng.random(count)) / count * ends[-1])
    picks = np.minimum(picks, len(faces) - 1)
    r, s = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    points: np.ndarray = (1 - r) * a[picks] + r * (1 - s) * b[picks] + r * s * c[picks]
    return points


def bare_points(
    task: ClumpTask,
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


def sphere_points(count: int) -> Float[np.ndarray, "d 3"]:
    """Evenly spread points on the unit sphere (Fibonacci)."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    azimuth = np.pi * (1 + np.sqrt(5.0)) * index
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)


def filled_share(distance: Float[np.ndarray, " m"], spacing: float) -> Float[np.ndarray, " m"]:
    """Return the share of cells that a body fills whose surface is so far from their middles."""
    return np.clip(0.5 - distance / spacing, 0.0, 1.0)


def _filled_share(
    avatar: Avatar, grid: Float[np.ndarray, "g 3"], field: Float[np.ndarray, " g"], spacing: float
) -> Float[np.ndarray, " g"]:
    filled = (field >= 1.0).astype(float)
    # u = field**(-1/2) changes by less than about one over half a side: far cells are full or empty.
    near = np.abs(field**-0.5 - 1.0) < 8 * spacing
    filled[near] = filled_share(_first_order(avatar, grid[near], field[near])[0], spacing)
    return filled


def _first_order(
    avatar: Avatar, points: Float[np.ndarray, "m 3"], value: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 3"]]:
    slope = np.asarray(avatar.gradient(points))
    steepness = np.maximum(np.linalg.norm(slope, axis=1), 1e-12)
    u = value**-0.5
    return (u - 1.0) * 2.0 / (u**3 * steepness), -slope / steepness[:, None]
