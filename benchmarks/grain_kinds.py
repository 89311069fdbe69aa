"""Synthetic grains whose true surface is known: cobbles, angular, concave and craggy ones.

Each kind is an implicit function (negative inside) on the box [-1, 1]**3; the voxels are its
signs at voxel centres, the truth a mesh whose vertices are moved onto its zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh

from mbstudio.core.grains import Grain
from mbstudio.core.units import VoxelSize

Implicit = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class KnownGrain:
    """A grain and its true surface in the grain's frame and unit."""

    kind: str
    name: str
    grain: Grain
    truth: trimesh.Trimesh


def turned(rng: np.random.Generator) -> np.ndarray:
    matrix, upper = np.linalg.qr(rng.normal(size=(3, 3)))
    return matrix * np.sign(np.diag(upper))


def smooth_least(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    h = np.clip(0.5 + 0.5 * (b - a) / width, 0, 1)
    return b + (a - b) * h - width * h * (1 - h)


def cobble(rng: np.random.Generator) -> Implicit:
    """Return an ellipsoid with gentle waves."""
    axes = np.array([0.9, rng.uniform(0.65, 0.85), rng.uniform(0.45, 0.65)])
    turn, waves, phases = turned(rng), rng.normal(size=(6, 3)) * 2.0, rng.uniform(0, 6.3, 6)

    def value(points: np.ndarray) -> np.ndarray:
        local = points @ turn
        return np.linalg.norm(local / axes, axis=1) - 1 + 0.02 * np.sin(local @ waves.T + phases).sum(axis=1)

    return value


def angular(rng: np.random.Generator) -> Implicit:
    """Return the intersection of some 14 half spaces: flat faces, sharp edges."""
    normals = rng.normal(size=(14, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.vstack([normals, np.eye(3), -np.eye(3)])
    distances = np.concatenate([rng.uniform(0.5, 0.75, 14), np.full(6, 0.85)])
    return lambda points: (points @ normals.T - distances).max(axis=1)


def concave(rng: np.random.Generator) -> Implicit:
    """Return four to six blobs grown together, with two bites taken out."""
    count = int(rng.integers(4, 7))
    centers = rng.normal(size=(count, 3))
    centers *= rng.uniform(0.25, 0.5, (count, 1)) / np.linalg.norm(centers, axis=1, keepdims=True)
    radii = rng.uniform(0.25, 0.42, count)
    bites = rng.normal(size=(2, 3))
    bites *= 0.75 / np.linalg.norm(bites, axis=1, keepdims=True)

    def value(points: np.ndarray) -> np.ndarray:
        body = np.linalg.norm(points, axis=1) - 0.35
        for center, radius in zip(centers, radii, strict=True):
            body = smooth_least(body, np.linalg.norm(points - center, axis=1) - radius, 0.12)
        for bite in bites:
            body = -smooth_least(-body, np.linalg.norm(points - bite, axis=1) - 0.35, 0.06)
        return body

    return value


def craggy(rng: np.random.Generator) -> Implicit:
    """Return blobs grown together, with sharp-edged bites out of them and rough faces."""
    count = int(rng.integers(5, 9))
    centers = rng.normal(size=(count, 3))
    centers *= rng.uniform(0.3, 0.6, (count, 1)) / np.linalg.norm(centers, axis=1, keepdims=True)
    radii = rng.uniform(0.22, 0.4, count)
    bites = rng.normal(size=(5, 3))
    bites *= rng.uniform(0.5, 0.8, (5, 1)) / np.linalg.norm(bites, axis=1, keepdims=True)
    bite_radii = rng.uniform(0.2, 0.38, 5)
    waves = [
        (rng.normal(size=(8, 3)) * frequency, rng.uniform(0, 6.3, 8), height)
        for frequency, height in ((4, 0.0085), (9, 0.0042), (18, 0.0021))
    ]

    def value(points: np.ndarray) -> np.ndarray:
        body = np.linalg.norm(points, axis=1) - 0.3
        for center, radius in zip(centers, radii, strict=True):
            body = smooth_least(body, np.linalg.norm(points - center, axis=1) - radius, 0.05)
        for bite, radius in zip(bites, bite_radii, strict=True):
            body = np.maximum(body, radius - np.linalg.norm(points - bite, axis=1))
        for directions, phases, height in waves:
            body = body + height * np.sin(points @ directions.T + phases).sum(axis=1)
        return body

    return value


def box_distance(points: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return the signed distance of points to a box about the origin with these half edges."""
    q = np.abs(points) - half
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)


def _values(implicit: Implicit, axes: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """Return an implicit body's values on a grid of axes z, y, x, layer by layer."""
    z, y, x = axes
    yy, xx = np.meshgrid(y, x, indexing="ij")
    flat = [np.stack([xx.ravel(), yy.ravel(), np.full(xx.size, height)], axis=1) for height in z]
    return np.stack([implicit(points).reshape(xx.shape) for points in flat])


def _true_surface(implicit: Implicit, fine: int) -> tuple[np.ndarray, np.ndarray]:
    """Return corners, moved onto the body's zero, and triangles of its contour on `fine` cells a side."""
    from skimage.measure import marching_cubes

    step = 2.0 / fine
    axis = (np.arange(fine) + 0.5) * step - 1
    padded = np.pad(_values(implicit, (axis, axis, axis)), 1, constant_values=step)
    vertices, faces, _, _ = marching_cubes(padded, 0.0, gradient_direction="ascent")
    points = (vertices[:, ::-1] - 0.5) * step - 1
    for _ in range(3):
        here = implicit(points)
        slope = np.stack(
            [(implicit(points + d) - implicit(points - d)) / 2e-4 for d in 1e-4 * np.eye(3)], axis=1
        )
        move = -slope * (here / np.maximum((slope**2).sum(axis=1), 1e-6))[:, None]
        points = (
            points
            + move * np.minimum(1, 0.5 * step / np.maximum(np.linalg.norm(move, axis=1), 1e-12))[:, None]
        )
    return points, faces


def known_grain(
    kind: str,
    name: str,
    implicit: Implicit,
    side: int,
    size: str | VoxelSize = "10 um",
    ratio: tuple[float, float, float] = (1, 1, 1),
) -> KnownGrain:
    """Return voxels and true surface of an implicit body; `side` voxels span the box.

    A `ratio` (z, y, x) makes the voxels longer, and so fewer, along an axis; the body stays the same.
    """
    import cc3d

    edge, base = 2.0 / side, VoxelSize.parse(size)
    axes = [(np.arange(int(np.ceil(side / r))) + 0.5) * edge * r - 1 for r in ratio]
    labels = cc3d.connected_components(_values(implicit, (axes[0], axes[1], axes[2])) < 0, connectivity=6)
    mask = labels == np.bincount(labels.ravel())[1:].argmax() + 1
    # The truth is contoured at least 128 across, whatever the voxels.
    points, faces = _true_surface(implicit, min(max(side, 128), 256))
    low = np.argwhere(mask).min(axis=0)
    high = np.argwhere(mask).max(axis=0) + 1
    voxel = VoxelSize(base.z * ratio[0], base.y * ratio[1], base.x * ratio[2], base.unit)
    box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    # The frame: the box's corner at -voxel/2, so that voxel [0, 0, 0] of the whole box is at 0.
    origin = tuple(float(v) for v in low[::-1] * np.array(voxel.xyz))
    corners = (points + 1) / edge * base.xyz - 0.5 * np.array(voxel.xyz)
    mesh = trimesh.Trimesh(corners, faces, process=False)
    parts = mesh.split(only_watertight=True) if mesh.body_count > 1 else [mesh]
    truth = max(parts, key=lambda part: part.volume)
    return KnownGrain(
        kind, name, Grain(mask[box].copy(), voxel, (origin[0], origin[1], origin[2]), name=name), truth
    )


def synthetic(side: int = 200, count: int = 5, seed: int = 2023) -> list[KnownGrain]:
    """Return `count` grains of each of the four kinds."""
    makers = {"cobble": cobble, "angular": angular, "concave": concave, "craggy": craggy}
    return [
        known_grain(kind, f"{kind} {i}", maker(np.random.default_rng([seed, k, i])), side)
        for k, (kind, maker) in enumerate(makers.items())
        for i in range(count)
    ]
