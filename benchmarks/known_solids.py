"""Solids whose volume, area and moments are known in closed form, as voxels and as truth.

Shared by the benchmarks and the tests of the metrics.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipeinc, ellipkinc

KINDS = ("sphere", "ellipsoid", "cube", "tetrahedron", "torus", "dumb-bell")

_TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / (2 * np.sqrt(2))
"""Corners of a regular tetrahedron of edge 1."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid about the origin.

    Attributes
    ----------
    kind : str
    volume, area : float
        In closed form.
    moments : float array, shape (3,)
        Principal moments of inertia over the mass, ascending.
    shadow : tuple of float
        Area and perimeter (holes included) of its largest projection.
    lengths : float array, shape (3,)
        Edges of its smallest bounding box, ascending.
    reach : float
        Radius of a ball about the origin that holds the solid.
    contains : callable
        Takes points of shape (..., 3), returns which lie inside.
    """

    kind: str
    volume: float
    area: float
    moments: np.ndarray
    shadow: tuple[float, float]
    lengths: np.ndarray
    reach: float
    contains: Callable[[np.ndarray], np.ndarray]

    @property
    def sphericity(self) -> float:
        """Wadell's sphericity."""
        return float((36 * np.pi * self.volume**2) ** (1 / 3) / self.area)

    @property
    def ds(self) -> float:
        """Diameter of the circle with the area of the largest projection."""
        return float(np.sqrt(4 * self.shadow[0] / np.pi))

    @property
    def circularity(self) -> float:
        """Of the largest projection."""
        return float(np.pi * self.ds / self.shadow[1])

    @property
    def csf(self) -> float:
        """Corey shape factor of the bounding box."""
        return float(self.lengths[0] / np.sqrt(self.lengths[1] * self.lengths[2]))

    def voxels(
        self, rng: np.random.Generator, edges: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ) -> np.ndarray:
        """Return the solid as voxels [z, y, x] of these edges, in random rotation and sub-voxel shift."""
        turn = Rotation.random(rng=rng).as_matrix()
        ticks = []
        for edge, shift in zip(edges, rng.uniform(-0.5, 0.5, 3), strict=True):
            count = int(np.ceil(self.reach / edge)) + 2
            ticks.append((np.arange(-count, count + 1) - shift) * edge)
        z, y, x = np.meshgrid(*ticks, indexing="ij")
        return self.contains(np.stack([x, y, z], axis=-1) @ turn)


def solid(kind: str, radius: float, rng: np.random.Generator | None = None) -> Solid:
    """Return a solid of about twice the radius across; with a generator its size varies by up to 5 %."""
    size = radius * (1.0 if rng is None else rng.uniform(0.95, 1.05))
    if kind == "sphere":
        return ellipsoid(np.array([size, size, size]), kind)
    if kind == "ellipsoid":
        spread = np.ones(3) if rng is None else rng.uniform(0.95, 1.05, 3)
        return ellipsoid(size * np.array([1, 0.8, 0.65]) * spread)
    if kind == "cube":
        return cube(1.6 * size)
    if kind == "tetrahedron":
        return tetrahedron(2 * size)
    if kind == "torus":
        return torus(0.7 * size, 0.3 * size)
    if kind == "dumb-bell":
        return dumb_bell(0.45 * size, 0.55 * size, 0.2 * size)
    raise ValueError(f"'{kind}' is none of {', '.join(KINDS)}.")


def ellipsoid_area(axes: np.ndarray) -> float:
    """Return the area of an ellipsoid by Legendre's formula."""
    c, b, a = np.sort(axes)
    if a - c < 1e-9 * a:
        return float(4 * np.pi * a * a)
    phi = np.arccos(c / a)
    k2 = a**2 * (b**2 - c**2) / (b**2 * (a**2 - c**2))
    bracket = ellipeinc(phi, k2) * np.sin(phi) ** 2 + ellipkinc(phi, k2) * np.cos(phi) ** 2
    return float(2 * np.pi * (c**2 + a * b / np.sin(phi) * bracket))


def ellipsoid(axes: np.ndarray, kind: str = "ellipsoid") -> Solid:
    """Return an ellipsoid of these semi-axes."""
    squares = axes**2 / 5
    _, b, a = np.sort(axes)
    ellipse = (float(np.pi * a * b), float(4 * a * ellipe(1 - (b / a) ** 2)))
    return Solid(
        kind, float(4 / 3 * np.pi * axes.prod()), ellipsoid_area(axes), np.sort(squares.sum() - squares),
        ellipse, 2 * np.sort(axes), float(axes.max()),
        lambda points: ((points / axes) ** 2).sum(axis=-1) <= 1,
    )  # fmt: skip


def cube(edge: float) -> Solid:
    """Return a cube; its largest projection is a regular hexagon."""
    return Solid(
        "cube", edge**3, 6 * edge**2, np.full(3, edge**2 / 6),
        (np.sqrt(3) * edge**2, 6 * edge * np.sqrt(2 / 3)), np.full(3, edge), edge * np.sqrt(3) / 2,
        lambda points: np.abs(points).max(axis=-1) <= edge / 2,
    )  # fmt: skip


def tetrahedron(edge: float) -> Solid:
    """Return a regular tetrahedron; its moment over the mass is edge**2 / 20.

    Its largest projection is the square across two edges, its smallest box the cube of the face diagonals.
    """
    inwards = -_TETRAHEDRON / np.linalg.norm(_TETRAHEDRON[0])
    inradius = edge / np.sqrt(24)
    return Solid(
        "tetrahedron", edge**3 / (6 * np.sqrt(2)), np.sqrt(3) * edge**2, np.full(3, edge**2 / 20),
        (edge**2 / 2, edge * np.sqrt(8)), np.full(3, edge / np.sqrt(2)), edge * np.sqrt(3 / 8),
        lambda points: (points @ inwards.T).max(axis=-1) <= inradius,
    )  # fmt: skip


def torus(major: float, minor: float) -> Solid:
    """Return a ring torus about z; its largest projection is the annulus, if the hole is not too small."""
    across = major**2 / 2 + 5 * minor**2 / 8
    along = major**2 + 3 * minor**2 / 4
    return Solid(
        "torus", 2 * np.pi**2 * major * minor**2, 4 * np.pi**2 * major * minor,
        np.array([across, across, along]), (4 * np.pi * major * minor, 4 * np.pi * major),
        2 * np.array([minor, major + minor, major + minor]), major + minor,
        lambda points: (
            (np.hypot(points[..., 0], points[..., 1]) - major) ** 2 + points[..., 2] ** 2 <= minor**2
        ),
    )  # fmt: skip


def dumb_bell(ball: float, offset: float, neck: float) -> Solid:
    """Return two balls at z = -offset and +offset with a cylinder between them."""
    meet = offset - np.sqrt(ball**2 - neck**2)
    cap = ball - (offset - meet)
    # Half of it in two pieces, each a polynomial in z, for which Gauss's rule is exact.
    nodes, weights = np.polynomial.legendre.leggauss(8)
    volume = along = across = 0.0
    for low, high, squared in (
        (0.0, meet, lambda z: np.full_like(z, neck**2)),
        (meet, offset + ball, lambda z: ball**2 - (z - offset) ** 2),
    ):
        z = low + (nodes + 1) / 2 * (high - low)
        w = weights * (high - low) / 2
        r2 = squared(z)
        volume += 2 * np.pi * float(w @ r2)
        along += np.pi * float(w @ r2**2)
        across += 2 * np.pi * float(w @ (r2**2 / 4 + r2 * z**2))
    # Side on: two discs less the segments where the neck's rectangle meets them.
    half_angle = np.arccos((offset - meet) / ball)
    segment = ball**2 * half_angle - (offset - meet) * neck
    shadow = (2 * (np.pi * ball**2 - segment) + 4 * neck * meet, 4 * ball * (np.pi - half_angle) + 4 * meet)
    area = 2 * (4 * np.pi * ball**2 - 2 * np.pi * ball * cap) + 4 * np.pi * neck * meet
    return Solid(
        "dumb-bell", volume, float(area), np.array([along, across, across]) / volume,
        (float(shadow[0]), float(shadow[1])), 2 * np.array([ball, ball, offset + ball]), offset + ball,
        lambda points: (
            ((points[..., :2] ** 2).sum(axis=-1) + (np.abs(points[..., 2]) - offset) ** 2 <= ball**2)
            | (((points[..., :2] ** 2).sum(axis=-1) <= neck**2) & (np.abs(points[..., 2]) <= offset))
        ),
    )  # fmt: skip
