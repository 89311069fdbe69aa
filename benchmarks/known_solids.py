"""Solids whose volume, area and moments are known in closed form, as voxels and as truth.

Shared by the benchmarks and the tests of the metrics. Those of polyhedra follow from their corners.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipeinc, ellipkinc

KINDS = ("sphere", "ellipsoid", "cube", "tetrahedron", "torus", "dumb-bell")
ALL_KINDS = (
    *KINDS, "oblate", "prolate", "blade", "box", "plate", "needle", "octahedron", "icosahedron", "prism",
    "cylinder", "disc", "rod", "capsule", "cone",
)  # fmt: skip
"""Twenty solids: round and sharp, flat and long, convex and not, with a hole and without."""

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
    lengths : float array, shape (3,), or None
        Edges of its smallest bounding box, ascending; None where they are not known in closed form.
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
    lengths: np.ndarray | None
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
        """Corey shape factor of the bounding box; NaN where that is not known."""
        if self.lengths is None:
            return float("nan")
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
    if kind in _SHAPES:
        return _SHAPES[kind](size)
    raise ValueError(f"'{kind}' is none of {', '.join(ALL_KINDS)}.")


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


def box(edges: np.ndarray, kind: str = "box") -> Solid:
    """Return a box; along its largest projection all six faces are seen edge on alike."""
    a, b, c = edges
    normal = np.array([b * c, c * a, a * b])
    shadow = float(np.linalg.norm(normal))
    perimeter = 2 * float(np.sum(edges * np.sqrt(1 - (normal / shadow) ** 2)))
    squares = edges**2 / 12
    return Solid(
        kind, float(edges.prod()), float(2 * normal.sum()), np.sort(squares.sum() - squares),
        (shadow, perimeter), np.sort(edges), float(np.linalg.norm(edges)) / 2,
        lambda points: (np.abs(points) <= edges / 2).all(axis=-1),
    )  # fmt: skip


def polyhedron(corners: np.ndarray, kind: str) -> Solid:
    """Return a convex polyhedron about its centre of volume, from its corners."""
    hull = ConvexHull(corners)
    inside = corners.mean(axis=0)
    tetrahedra = np.concatenate(
        [np.broadcast_to(inside, (len(hull.simplices), 1, 3)), corners[hull.simplices]], axis=1
    )
    volumes = np.abs(np.linalg.det(tetrahedra[:, 1:] - tetrahedra[:, :1])) / 6
    volume = float(volumes.sum())
    centre = volumes @ tetrahedra.mean(axis=1) / volume
    tetrahedra, points = tetrahedra - centre, corners - centre
    # The second moments of a tetrahedron: V / 20 (sum of corners times themselves + of the sum with itself).
    total = tetrahedra.sum(axis=1)
    second = np.einsum("t,tij,tik->jk", volumes, tetrahedra, tetrahedra)
    second = (second + np.einsum("t,tj,tk->jk", volumes, total, total)) / (20 * volume)
    moments = np.sort(np.trace(second) - np.linalg.eigvalsh(second))
    normals = hull.equations[:, :3]
    areas = np.linalg.norm(
        np.cross(*(corners[hull.simplices[:, k]] - corners[hull.simplices[:, 0]] for k in (1, 2))), axis=1
    ) / 2  # fmt: skip
    inradii = -hull.equations[:, 3] - normals @ centre
    return Solid(
        kind, volume, float(areas.sum()), moments, _shadow_of(points, normals, areas), None,
        float(np.linalg.norm(points, axis=1).max()),
        lambda given: (given @ normals.T <= inradii).all(axis=-1),
    )  # fmt: skip


def _shadow_of(points: np.ndarray, normals: np.ndarray, areas: np.ndarray) -> tuple[float, float]:
    """Return area and perimeter of the largest projection of a convex polyhedron.

    Its area along n is half the sum of A |n . m| over the faces, which is linear while no face turns edge on.
    So the largest lies where n is along the sum of the area vectors of the faces that look towards it.
    """
    rng = np.random.default_rng(0)
    best, along = 0.0, normals[0]
    for start in rng.normal(size=(400, 3)):
        n = start / np.linalg.norm(start)
        for _ in range(50):
            towards = np.sign(normals @ n) * areas @ normals
            turned = towards / np.linalg.norm(towards)
            if np.allclose(turned, n, atol=1e-14):
                break
            n = turned
        shadow = float(areas @ np.abs(normals @ n)) / 2
        if shadow > best:
            best, along = shadow, n
    frame = np.linalg.svd(along[None])[2][1:]
    return best, float(ConvexHull(points @ frame.T).area)


def cylinder(radius: float, height: float, kind: str = "cylinder") -> Solid:
    """Return a cylinder about z; seen along its largest projection, an ellipse swept along a line."""
    lid, side = np.pi * radius**2, 2 * radius * height
    across, along = radius**2 / 4 + height**2 / 12, radius**2 / 2
    shadow = float(np.hypot(lid, side))
    cosine, sine = lid / shadow, side / shadow
    perimeter = 4 * radius * float(ellipe(1 - cosine**2)) + 2 * height * sine
    return Solid(
        kind, lid * height, 2 * lid + 2 * np.pi * radius * height, np.sort([across, across, along]),
        (shadow, perimeter), np.sort([2 * radius, 2 * radius, height]), float(np.hypot(radius, height / 2)),
        lambda points: (
            (np.hypot(points[..., 0], points[..., 1]) <= radius) & (np.abs(points[..., 2]) <= height / 2)
        ),
    )  # fmt: skip


def capsule(radius: float, height: float) -> Solid:
    """Return a cylinder about z with half a ball on either end."""
    tube, ball = np.pi * radius**2 * height, 4 / 3 * np.pi * radius**3
    along = (tube * radius**2 / 2 + ball * radius**2 * 2 / 5) / (tube + ball)
    # Half a ball has its centre 3/8 of the radius from the lid.
    across = (
        tube * (radius**2 / 4 + height**2 / 12)
        + ball * (2 / 5 * radius**2 + height**2 / 4 + 3 / 8 * height * radius)
    ) / (tube + ball)
    return Solid(
        "capsule", tube + ball, 2 * np.pi * radius * height + 4 * np.pi * radius**2,
        np.sort([along, across, across]),
        (np.pi * radius**2 + 2 * radius * height, 2 * np.pi * radius + 2 * height),
        np.array([2 * radius, 2 * radius, height + 2 * radius]), radius + height / 2,
        lambda points: (
            points[..., 0] ** 2
            + points[..., 1] ** 2
            + np.maximum(np.abs(points[..., 2]) - height / 2, 0) ** 2
            <= radius**2
        ),
    )  # fmt: skip


def cone(radius: float, height: float) -> Solid:
    """Return a cone about z, no higher than its base is wide, about its centre of volume.

    Its largest projection is then that along its axis if the base is larger than the triangle, pi r^2 > r h.
    """
    slope = float(np.hypot(radius, height))
    # An ellipse of half width r cos and the apex at h sin beside it: the disc is larger for every angle.
    if height > radius:
        raise ValueError(
            "The largest projection of a cone is known here where it is no higher than its radius."
        )
    across, along = 3 / 20 * radius**2 + 3 / 80 * height**2, 3 / 10 * radius**2
    return Solid(
        "cone", np.pi * radius**2 * height / 3, np.pi * radius * (radius + slope),
        np.sort([across, across, along]), (np.pi * radius**2, 2 * np.pi * radius), None,
        float(max(np.hypot(radius, height / 4), 3 * height / 4)),
        lambda points: (
            (points[..., 2] >= -height / 4)
            & (np.hypot(points[..., 0], points[..., 1]) <= radius * (3 / 4 - points[..., 2] / height))
        ),
    )  # fmt: skip


_GOLDEN = (1 + np.sqrt(5)) / 2
_ICOSAHEDRON = np.array(
    [np.roll([0, one, two], turn) for turn in range(3) for one in (-1, 1) for two in (-_GOLDEN, _GOLDEN)]
) / np.hypot(1, _GOLDEN)
_OCTAHEDRON = np.concatenate([np.eye(3), -np.eye(3)])
_PRISM = np.array(
    [
        [np.cos(turn), np.sin(turn), end]
        for turn in 2 * np.pi * np.arange(3) / 3
        for end in (-np.sqrt(3) / 2, np.sqrt(3) / 2)
    ]
) / np.hypot(1, np.sqrt(3) / 2)
_SHAPES: dict[str, Callable[[float], Solid]] = {
    "oblate": lambda size: ellipsoid(size * np.array([1, 1, 0.4]), "oblate"),
    "prolate": lambda size: ellipsoid(size * np.array([1, 0.4, 0.4]), "prolate"),
    "blade": lambda size: ellipsoid(size * np.array([1, 0.5, 0.25]), "blade"),
    "box": lambda size: box(2 * size * np.array([0.8, 0.5, 0.3])),
    "plate": lambda size: box(2 * size * np.array([0.7, 0.7, 0.15]), "plate"),
    "needle": lambda size: box(2 * size * np.array([0.95, 0.2, 0.2]), "needle"),
    "octahedron": lambda size: polyhedron(size * _OCTAHEDRON, "octahedron"),
    "icosahedron": lambda size: polyhedron(size * _ICOSAHEDRON, "icosahedron"),
    "prism": lambda size: polyhedron(size * _PRISM, "prism"),
    "cylinder": lambda size: cylinder(0.7 * size, 1.4 * size),
    "disc": lambda size: cylinder(0.95 * size, 0.5 * size, "disc"),
    "rod": lambda size: cylinder(0.25 * size, 1.9 * size, "rod"),
    "capsule": lambda size: capsule(0.35 * size, 1.3 * size),
    "cone": lambda size: cone(0.95 * size, 0.9 * size),
}
"""The solids beside the first six, by a radius that holds them."""
