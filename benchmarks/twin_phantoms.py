"""Packings of bodies that are known exactly, and their scans: truth for the twin, by code of its own.

Nothing here uses mbstudio's metaballs: bodies are star-shaped and given by a function F, negative inside, and
its gradient; gaps are found on their surfaces, volumes by quadrature over directions, grey values by filling
voxels from subsamples before they are blurred.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation
from scipy.special import gamma

VOID, TONE, TONE_SPREAD = 17000.0, 34000.0, 1200.0
_SUBSAMPLES = 5
_CLOSE = 1e-4  # voxels that a gap is brought to


def _sphere(count: int) -> np.ndarray:
    """Return directions spread evenly over the sphere (a spiral)."""
    k = np.arange(count) + 0.5
    polar, turn = np.arccos(1 - 2 * k / count), np.pi * (1 + 5**0.5) * k
    return np.column_stack((np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)))


DIRECTIONS = _sphere(1500)


@dataclass
class Body:
    """A body: |x/a|^p + |y/b|^p + |z/c|^p <= 1 turned, or a sum of k/r^2 >= 1; `middle` is (x, y, z)."""

    middle: np.ndarray
    turn: np.ndarray
    axes: np.ndarray
    power: float = 2.0
    points: np.ndarray | None = None
    weights: np.ndarray | None = None
    _radii: np.ndarray | None = field(default=None, repr=False)

    def value(self, places: np.ndarray) -> np.ndarray:
        """Return F at places, negative inside: it grows about as the distance over the radius."""
        local = (places - self.middle) @ self.turn
        if self.points is not None:
            squares = ((local[:, None] - self.points) ** 2).sum(axis=2)
            return (self.weights / squares).sum(axis=1) ** -0.5 - 1
        return (np.abs(local / self.axes) ** self.power).sum(axis=1) ** (1 / self.power) - 1

    def gradient(self, places: np.ndarray) -> np.ndarray:
        """Return the gradient of F."""
        local = (places - self.middle) @ self.turn
        if self.points is not None:
            away = local[:, None] - self.points
            squares = (away**2).sum(axis=2)
            f = (self.weights / squares).sum(axis=1)
            found = f[:, None] ** -1.5 * (self.weights / squares**2)[..., None].__mul__(away).sum(axis=1)
        else:
            scaled = np.abs(local / self.axes)
            total = (scaled**self.power).sum(axis=1)
            found = total[:, None] ** (1 / self.power - 1) * scaled ** (self.power - 1)
            found = found * np.sign(local) / self.axes
        return found @ self.turn.T

    def distance(self, places: np.ndarray) -> np.ndarray:
        """Return the distance to the surface, for places near to it."""
        return self.value(places) / np.linalg.norm(self.gradient(places), axis=1)

    def radii(self, directions: np.ndarray) -> np.ndarray:
        """Return how far the surface lies in directions (of the turned body's own frame)."""
        if self.points is None:
            return (np.abs(directions / self.axes) ** self.power).sum(axis=1) ** (-1 / self.power)
        low, high = np.zeros(len(directions)), np.full(len(directions), 3 * self.weights.sum() ** 0.5)
        for _ in range(50):
            half = 0.5 * (low + high)
            inside = self.value(self.middle + half[:, None] * directions @ self.turn.T) < 0
            low, high = np.where(inside, half, low), np.where(inside, high, half)
        return 0.5 * (low + high)

    def surface(self, directions: np.ndarray | None = None) -> np.ndarray:
        """Return points on the surface."""
        if directions is None:
            if self._radii is None:
                self._radii = self.radii(DIRECTIONS)
            directions, radii = DIRECTIONS, self._radii
        else:
            radii = self.radii(directions)
        return self.middle + radii[:, None] * directions @ self.turn.T

    @property
    def volume(self) -> float:
        """Volume in closed form, or by quadrature over directions (right to 1e-8)."""
        if self.points is None:
            p = self.power
            return float(8 * self.axes.prod() * gamma(1 + 1 / p) ** 3 / gamma(1 + 3 / p))
        nodes, weights = np.polynomial.legendre.leggauss(48)
        turns = 2 * np.pi * np.arange(96) / 96
        z, t = (array.ravel() for array in np.meshgrid(nodes, turns, indexing="ij"))
        around = np.sqrt(1 - z**2)
        cubes = self.radii(np.column_stack((around * np.cos(t), around * np.sin(t), z))) ** 3
        return float((cubes.reshape(48, 96).mean(axis=1) * 2 * np.pi) @ weights / 3)


def make_body(kind: str, across: float, rng: np.random.Generator) -> Body:
    """Return a body of about this diameter: 'sphere', 'ellipsoid', 'metaball', 'angular' or 'concave'."""
    turn = Rotation.random(rng=rng).as_matrix()
    radius = 0.5 * across * rng.uniform(0.9, 1.1)
    if kind == "sphere":
        return Body(np.zeros(3), turn, np.full(3, radius))
    if kind == "ellipsoid":
        body = Body(np.zeros(3), turn, rng.uniform(0.75, 1.3, 3))
    elif kind == "angular":
        body = Body(np.zeros(3), turn, rng.uniform(0.8, 1.25, 3), rng.uniform(4, 6))
    else:
        spread, count = (0.33, 5) if kind == "metaball" else (0.62, 3)
        points = rng.normal(size=(count, 3))
        points *= spread / np.linalg.norm(points, axis=1)[:, None]
        weights = rng.uniform(0.6, 1.4, count)
        points -= weights @ points / weights.sum()
        body = Body(np.zeros(3), turn, np.ones(3), points=points, weights=weights / weights.sum())
    size = radius / (0.75 * body.volume / np.pi) ** (1 / 3)
    if body.points is None:
        body.axes = body.axes * size
    else:
        body.points, body.weights = body.points * size, body.weights * size**2
    return body


def gap(a: Body, b: Body) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the least distance of b from the surface of a, where, and the normal of b there, from a to b."""
    directions = DIRECTIONS
    window = 0.08
    best = None
    for _ in range(7):
        places = a.surface(None if best is None else directions)
        away = b.distance(places)
        chosen = int(away.argmin())
        best = (float(away[chosen]), places[chosen])
        centre = (places[chosen] - a.middle) @ a.turn
        centre = centre / np.linalg.norm(centre)
        shift = np.random.default_rng(0).normal(size=(40, 3)) * window
        directions = np.vstack((centre, centre + shift))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        window *= 0.35
    normal = -b.gradient(best[1][None])[0]
    return best[0], best[1], normal / np.linalg.norm(normal)


def _least_gap(body: Body, others: list[Body]) -> tuple[float, int]:
    """Return the least gap to bodies near by, and to which; no more is sought than 6 voxels."""
    reach, gaps = body.surface(), []
    size = np.linalg.norm(reach - body.middle, axis=1).max()
    for other in others:
        far = np.linalg.norm(other.middle - body.middle) - size
        far -= np.linalg.norm(other.surface() - other.middle, axis=1).max()
        gaps.append(far if far > 3 else gap(body, other)[0])
    return (min(gaps), int(np.argmin(gaps))) if gaps else (np.inf, -1)


def _touch(
    body: Body, others: list[Body], start: np.ndarray, way: np.ndarray, length: float, clearance: float
) -> bool:
    """Move a body from `start` along `way` until a gap is as small as `clearance`; return whether it is."""
    at = 0.0
    for _ in range(200):
        body.middle = start + at * way
        least = _least_gap(body, others)[0]
        if least < clearance + _CLOSE:
            return True
        at += max(0.9 * (least - clearance), 0.5 * _CLOSE)
        if at > length:
            return False
    return False


def pack(kinds: tuple[str, ...], across: float, count: int, seed: int) -> list[Body]:
    """Return bodies that touch: each comes from outside towards the middle until it meets another.

    Then it slides along that one, towards the middle again, until it meets a second. Every third stops
    before it touches the first, at a gap of 0.1 to 0.5 voxel.
    """
    return deepcopy(_packed(kinds, across, count, seed))


@cache
def _packed(kinds: tuple[str, ...], across: float, count: int, seed: int) -> list[Body]:
    rng = np.random.default_rng(seed)
    bodies = [make_body(kinds[0], across, rng)]
    while len(bodies) < count:
        body = make_body(kinds[len(bodies) % len(kinds)], across, rng)
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        far = across * (2.5 + count ** (1 / 3))
        clearance = rng.uniform(0.1, 0.5) if len(bodies) % 3 == 0 else _CLOSE
        if not _touch(body, bodies, -far * way, way, 2 * far, clearance):
            continue
        _slide(body, bodies, clearance)
        if _least_gap(body, bodies)[0] > 0:
            bodies.append(body)
    return bodies


def _slide(body: Body, others: list[Body], clearance: float) -> None:
    """Slide a body along the one that it is near to, towards the middle, until it touches a second."""
    touched = _least_gap(body, others)[1]
    rest = [other for k, other in enumerate(others) if k != touched]
    if not rest:
        return
    step, kept = 1.0, body.middle.copy()
    for _ in range(50):
        _, _, normal = gap(body, others[touched])
        inward = -body.middle - (-body.middle @ normal) * normal
        length = np.linalg.norm(inward)
        if length < 1e-3:
            return
        kept = body.middle.copy()
        body.middle = kept + min(step, length) * inward / length
        for _ in range(3):
            away, _, normal = gap(body, others[touched])
            body.middle = body.middle + (away - clearance) * normal
        least = _least_gap(body, rest)[0]
        if least < 0 or abs(gap(body, others[touched])[0] - clearance) > _CLOSE:
            body.middle, step = kept, 0.5 * step
            if step < 0.2 * _CLOSE:
                return
        elif least < 3 * _CLOSE:
            return
        else:
            step = min(step, max(0.7 * least, _CLOSE))


@dataclass
class Truth:
    """Bodies, moved so that a box with a margin about them begins at 0, and their scan."""

    bodies: list[Body]
    voxels: np.ndarray
    owner: np.ndarray


def scan_of(
    bodies: list[Body],
    seed: int,
    *,
    blur: float = 0.7,
    noise: float = 0.035,
    cupping: float = 0.0,
    rings: float = 0.0,
    margin: float = 8.0,
) -> Truth:
    """Return the scan of bodies: filled by subsamples, blurred, then with noise (a share of the tone).

    Cupping and rings are shares of the grey value, brighter outside.
    """
    rng = np.random.default_rng([seed, 7])
    low = np.min([body.surface().min(axis=0) for body in bodies], axis=0) - margin
    for body in bodies:
        body.middle = body.middle - low
    high = np.max([body.surface().max(axis=0) for body in bodies], axis=0) + margin
    shape = tuple(int(np.ceil(length)) + 1 for length in high[::-1])
    grey, owner = np.full(shape, VOID, np.float64), np.zeros(shape, np.int32)
    ticks = (np.arange(_SUBSAMPLES) + 0.5) / _SUBSAMPLES - 0.5
    offsets = np.stack(np.meshgrid(ticks, ticks, ticks), axis=-1).reshape(-1, 3)
    for number, body in enumerate(bodies, start=1):
        surface = body.surface()
        first = np.maximum(np.floor(surface.min(axis=0)).astype(int) - 2, 0)
        last = np.ceil(surface.max(axis=0)).astype(int) + 3
        z, y, x = np.meshgrid(*(np.arange(first[a], last[a]) for a in (2, 1, 0)), indexing="ij")
        places = np.column_stack((x.ravel(), y.ravel(), z.ravel())).astype(float)
        distance = body.value(places) / np.maximum(np.linalg.norm(body.gradient(places), axis=1), 1e-9)
        share = (distance < 0).astype(float)
        edge = np.flatnonzero(np.abs(distance) < 2.0)
        fine = body.distance((places[edge][:, None] + offsets).reshape(-1, 3)).reshape(len(edge), -1)
        share[edge] = np.clip(0.5 - _SUBSAMPLES * fine, 0, 1).mean(axis=1)
        tone = TONE + TONE_SPREAD * rng.standard_normal()
        at = (places[:, 2].astype(int), places[:, 1].astype(int), places[:, 0].astype(int))
        grey[at] += share * (tone - VOID)
        owner[at] = np.where(share > 0.5, number, owner[at])
    image = ndimage.gaussian_filter(grey, blur, mode="nearest", truncate=6)
    _, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    away = np.sqrt((x**2 + y**2) / 2)
    image *= 1 + cupping * (away**2 - 0.5) + rings * 0.5 * np.sin(2 * np.pi * away * max(shape) / 14)
    image += noise * TONE * rng.standard_normal(shape)
    return Truth(bodies, image.astype(np.float32), owner)
