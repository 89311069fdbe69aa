"""Shapes of the synthetic grains: implicit bodies, negative inside, about a distance near the surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

ImplicitBody = Callable[[Float[np.ndarray, "m 3"]], Float[np.ndarray, "m"]]


@dataclass(frozen=True)
class PhantomGrain:
    """One synthetic grain about the origin.

    Attributes
    ----------
    body : callable
        Implicit function of points (x, y, z) in voxels; negative inside.
    reach : float
        Half the edge in voxels of a cube about the origin that holds the grain.
    kind : str
    """

    body: ImplicitBody
    reach: float
    kind: str


def _random_rotation(rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    """Return a uniformly distributed rotation (QR of a Gaussian matrix, signs fixed)."""
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    q *= np.sign(np.diag(r))
    rotation: np.ndarray = q * np.sign(np.linalg.det(q))
    return rotation


def _directions(rng: np.random.Generator, count: int) -> Float[np.ndarray, "count 3"]:
    vectors = rng.standard_normal((count, 3))
    directions: np.ndarray = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return directions


def _bumpy_ellipsoid(rng: np.random.Generator, axes: Float[np.ndarray, "3"], bumps: float) -> ImplicitBody:
    """An ellipsoid whose radius varies smoothly with direction by the share `bumps`."""
    rotation = _random_rotation(rng)
    waves = _directions(rng, 5) * rng.uniform(2.0, 4.0, (5, 1))
    phases = rng.uniform(0, 2 * np.pi, 5)

    def body(points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m"]:
        scaled = (points @ rotation) / axes
        length = np.linalg.norm(scaled, axis=1)
        direction = scaled / np.maximum(length, 1e-9)[:, None]
        radius = 1 + bumps * np.sin(direction @ waves.T + phases).mean(axis=1)
        # Dividing by the gradient's length makes the value a distance near the surface.
        slope = np.linalg.norm(direction / axes, axis=1)
        distances: np.ndarray = (length - radius) / np.maximum(slope, 1e-9)
        return distances

    return body


def _polyhedron(
    rng: np.random.Generator, radius: float, faces: int, rounding: float, flatness: float = 1.0
) -> ImplicitBody:
    """An intersection of half spaces whose edges are rounded over about `rounding` voxels."""
    normals = _directions(rng, 6 * faces)
    chosen = [normals[0]]
    for normal in normals[1:]:  # well apart, so that no face is a sliver
        if len(chosen) < faces and max(float(normal @ other) for other in chosen) < 0.8:
            chosen.append(normal)
    planes = np.array(chosen)
    # Half the box between each pair of opposite axes keeps the body bounded.
    frame = _random_rotation(rng)
    planes = np.vstack([planes, frame, -frame])
    distances = np.concatenate([rng.uniform(0.72, 1.0, len(chosen)), np.full(6, 1.05)]) * radius
    squeeze = np.array([1.0, 1.0, 1.0 / flatness])
    turn = _random_rotation(rng)

    def body(points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m"]:
        heights = ((points @ turn) * squeeze) @ planes.T - distances
        top = heights.max(axis=1)
        rounded: np.ndarray = top + rounding * np.log(np.exp((heights - top[:, None]) / rounding).sum(axis=1))
        return rounded

    return body


def _dented(rng: np.random.Generator, body: ImplicitBody, radius: float) -> ImplicitBody:
    """The body with one hollow pressed into it by a ball."""
    place = _directions(rng, 1)[0] * radius * rng.uniform(1.05, 1.2)
    hollow = radius * rng.uniform(0.5, 0.65)
    rounding = 0.8

    def dented(points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m"]:
        outside = hollow - np.linalg.norm(points - place, axis=1)
        distances: np.ndarray = rounding * np.logaddexp(body(points) / rounding, outside / rounding)
        return distances

    return dented


def make_grain(kind: str, diameter: float, rng: np.random.Generator) -> PhantomGrain:
    """Return a random grain of a kind: ``cobble``, ``angular``, ``elongated`` or ``concave``."""
    radius = diameter / 2
    if kind == "cobble":
        axes = radius * np.array([1.12, 1.0, 0.9]) * rng.uniform(0.94, 1.06, 3)
        return PhantomGrain(_bumpy_ellipsoid(rng, axes, 0.16), 1.4 * radius, kind)
    if kind == "angular":
        return PhantomGrain(
            _polyhedron(rng, 1.12 * radius, int(rng.integers(7, 12)), 0.8), 2.0 * radius, kind
        )
    if kind == "elongated":
        axes = radius * np.array([1.45, 1.0, 0.7]) * rng.uniform(0.95, 1.05, 3)
        return PhantomGrain(_bumpy_ellipsoid(rng, axes, 0.1), 1.75 * radius, kind)
    if kind == "concave":
        axes = 1.06 * radius * np.array([1.08, 1.0, 0.95])
        return PhantomGrain(_dented(rng, _bumpy_ellipsoid(rng, axes, 0.1), 1.06 * radius), 1.4 * radius, kind)
    raise ValueError(f"'{kind}' is not a kind of grain: use cobble, angular, elongated or concave.")
