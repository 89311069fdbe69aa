"""Shape factors of star-shaped avatars by rays from the centre: quick, for choosing among many candidates.

The surface is met along the 642 directions of a subdivided icosahedron and again half-way between them, so
that volume and area are extrapolated from two nested meshes. The bounding box and the maximum projection
are searched on the coarser one. About a twentieth of the cost of
:func:`mbstudio.core.metrics.measure`; of a body that hides a part of its surface from the centre it
sees the first crossing only.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float, Float64, Int

from mbstudio.core import formulas
from mbstudio.core.compiled import compiled
from mbstudio.core.metaball.field import field_and_gradient_at
from mbstudio.core.metaball.rays import first_hits
from mbstudio.core.metrics.axes import spread_frames
from mbstudio.core.metrics.sphere_directions import half_sphere, turns
from mbstudio.core.metrics.surfaces import subdivide

STAR_FACTORS = (
    "volume", "area", "sphericity", "circularity", "csf", "dn", "ds", "dns", "shortest", "intermediate",
    "longest",
)  # fmt: skip
"""What `star_factors` finds, in its order; all as in `ShapeFactors`."""

_SUBDIVISIONS = 3
_CHORD = 1e-3
_NEWTON_STEPS = 4
_AZIMUTHS = 120
_VIEWS = 64
_CLIMBS = 2
_FRAMES_KEPT = 8
_FRAMES_CLOSELY = 2
_TRIALS = 24
_STAGES = 8
_SHRINK = 0.6


@cache
def star_directions() -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Return the unit vertices and the faces of an icosahedron subdivided three times: 642 and 1280."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    corners = [(sign, up * golden, 0.0) for sign in (-1.0, 1.0) for up in (-1.0, 1.0)]
    vertices = np.array([np.roll(corner, shift) for shift in range(3) for corner in corners])
    vertices /= np.linalg.norm(vertices[0])
    apart = np.linalg.norm(vertices[:, None] - vertices[None], axis=2)
    near = (apart > 0) & (apart < 1.1)
    faces = np.array([
        (a, b, c)
        for a in range(12) for b in range(a + 1, 12) for c in range(b + 1, 12)
        if near[a, b] and near[b, c] and near[a, c]
    ])  # fmt: skip
    turned = np.linalg.det(vertices[faces]) < 0
    faces[turned] = faces[turned][:, ::-1]
    for _ in range(_SUBDIVISIONS):
        vertices, faces = _refine(vertices, faces)
    return vertices, faces


@cache
def _fine_star() -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]:
    return _refine(*star_directions())


def _refine(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    middles, split = subdivide(vertices, faces)
    return np.concatenate([vertices, middles / np.linalg.norm(middles, axis=1)[:, None]]), split


@cache
def _edges() -> Int[np.ndarray, "e 2"]:
    faces = star_directions()[1]
    return np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)


def star_radii(
    control: Float64[np.ndarray, "4 n"], directions: Float[np.ndarray, "d 3"]
) -> Float64[np.ndarray, " d"]:
    """Return how far the surface lies from the origin along each direction, infinity for a miss.

    Parameters
    ----------
    control : float array, shape (4, n)
        Rows x, y, z, k, the origin in the solid.
    directions : float array, shape (d, 3)
    """
    return first_hits(np.zeros_like(directions), directions, control, shortest_chord=_CHORD)


def star_factors(control: Float64[np.ndarray, "4 n"]) -> Float64[np.ndarray, " 11"]:
    """Return the factors named in `STAR_FACTORS`; NaN for a body whose centre is hollow.

    Parameters
    ----------
    control : float array, shape (4, n)
        Rows x, y, z, k about the centre of the body, so that the whole surface is seen from the origin.
    """
    directions, faces = star_directions()
    fine_directions, fine_faces = _fine_star()
    radii = star_radii(control, directions)
    if not np.isfinite(radii).all():
        return np.full(len(STAR_FACTORS), np.nan)
    points = directions * radii[:, None]
    edges = np.concatenate([np.arange(len(points))[:, None].repeat(2, axis=1), _middle_parents()])
    fine = _project_to_surface(fine_directions, radii[edges].mean(axis=1), control)
    coarse_integrals, fine_integrals = _volume_and_area(points, faces), _volume_and_area(fine, fine_faces)
    volume, area = (4.0 * fine_integrals - coarse_integrals) / 3.0
    shortest, intermediate, longest = _box_lengths(points, fine)
    shadow, perimeter = _largest_projection(points)
    if not (volume > 0 and area > 0 and shadow > 0):
        return np.full(len(STAR_FACTORS), np.nan)
    dn, ds = formulas.nominal_diameters(volume), formulas.projected_diameter(shadow)
    # The choice among candidates rests on the last bits: pi D_n**2 / A and pi D_s / P_p stay in this order.
    return np.array([
        volume, area, np.pi * dn * dn / area, np.pi * ds / perimeter,
        formulas.corey_shape_factor(shortest, intermediate, longest), dn, ds,
        formulas.diameter_ratio(dn, ds), shortest, intermediate, longest,
    ])  # fmt: skip


@cache
def _middle_parents() -> Int[np.ndarray, "e 2"]:
    """Return the two coarse vertices that each further vertex of the fine star lies between."""
    vertices, faces = star_directions()
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).astype(np.int64)
    keys = np.unique(edges[:, 0] * len(vertices) + edges[:, 1])
    return np.stack(np.divmod(keys, len(vertices)), axis=1)


def _project_to_surface(directions: np.ndarray, radii: np.ndarray, control: np.ndarray) -> np.ndarray:
    """Move points along their rays onto f = 1 by Newton steps on f**(-1/2), each at most a tenth."""
    for _ in range(_NEWTON_STEPS):
        value, gradient = field_and_gradient_at(directions * radii[:, None], control)
        along = np.einsum("ij,ij->i", gradient, directions)
        step = 2.0 * (value - value * np.sqrt(value)) / np.where(along == 0, -np.inf, along)
        radii = radii + np.clip(step, -0.1 * radii, 0.1 * radii)
    points: np.ndarray = directions * radii[:, None]
    return points


@compiled()
def _volume_and_area(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the volume and the area of a closed mesh."""
    volume = area = 0.0
    for f in range(len(faces)):
        a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
        volume += (
            a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
        )
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area += np.sqrt(x * x + y * y + z * z)
    return np.array([volume / 6.0, area / 2.0])


@compiled()
def _extents(points: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Return the edges of the box around points along the rows of a frame."""
    out = np.empty(3)
    for row in range(3):
        a, b, c = frame[row, 0], frame[row, 1], frame[row, 2]
        high, low = -np.inf, np.inf
        for j in range(points.shape[1]):
            height = a * points[0, j] + b * points[1, j] + c * points[2, j]
            high, low = max(high, height), min(low, height)
        out[row] = high - low
    return out


@compiled()
def _turn_frame(frame: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return a frame turned by a rotation vector (Rodrigues)."""
    angle = np.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    x, y, z = turn[0] / angle, turn[1] / angle, turn[2] / angle
    c, s = np.cos(angle), np.sin(angle)
    out = np.empty((3, 3))
    for row in range(3):
        a, b, d = frame[row, 0], frame[row, 1], frame[row, 2]
        dot = (x * a + y * b + z * d) * (1.0 - c)
        out[row, 0] = a * c + (y * d - z * b) * s + x * dot
        out[row, 1] = b * c + (z * a - x * d) * s + y * dot
        out[row, 2] = d * c + (x * b - y * a) * s + z * dot
    return out


@compiled()
def _narrow_box(
    points: np.ndarray, frame: np.ndarray, offsets: np.ndarray, angle: float, stages: int
) -> tuple[np.ndarray, float]:
    """Return a frame of a smaller box and its volume, found by ever smaller turns."""
    edges = _extents(points, frame)
    volume = edges[0] * edges[1] * edges[2]
    for _ in range(stages):
        base = frame
        for trial in range(len(offsets)):
            turned = _turn_frame(base, offsets[trial] * angle)
            edges = _extents(points, turned)
            product = edges[0] * edges[1] * edges[2]
            if product < volume:
                volume, frame = product, turned
        angle *= _SHRINK
    return frame, volume


@compiled()
def _least_box(points: np.ndarray, fine: np.ndarray, frames: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return the edges of the smallest box: the best few of many frames, then the best of these closely."""
    volumes = np.empty(len(frames))
    for f in range(len(frames)):
        edges = _extents(points, frames[f])
        volumes[f] = edges[0] * edges[1] * edges[2]
    order = np.argsort(volumes)
    found = np.empty((_FRAMES_KEPT, 3, 3))
    reached = np.empty(_FRAMES_KEPT)
    for place in range(_FRAMES_KEPT):
        found[place], reached[place] = _narrow_box(points, frames[order[place]], offsets, 0.2, _STAGES)
    best, lengths = np.inf, np.empty(3)
    for place in np.argsort(reached)[:_FRAMES_CLOSELY]:
        frame, volume = _narrow_box(fine, found[place], offsets, 0.04, _STAGES)
        if volume < best:
            best, lengths = volume, _extents(fine, frame)
    return np.sort(lengths)


def _box_lengths(points: np.ndarray, fine: np.ndarray) -> np.ndarray:
    frames = np.concatenate([np.eye(3)[None], spread_frames()[::4]])
    lengths: np.ndarray = _least_box(
        np.ascontiguousarray(points.T), np.ascontiguousarray(fine.T), frames, turns(_TRIALS)
    )
    return lengths


@compiled()
def _project_star(
    points: np.ndarray, edges: np.ndarray, direction: np.ndarray, rays: np.ndarray
) -> tuple[float, float]:
    """Return area and perimeter of a star-shaped body's projection: farthest edge along each azimuth."""
    azimuths = rays.shape[1]
    lateral = np.zeros(3)
    lateral[np.argmin(np.abs(direction))] = 1.0
    first = np.cross(lateral, direction)
    first /= np.sqrt((first * first).sum())
    second = np.cross(direction, first)
    count = len(points)
    x, y, turn = np.empty(count), np.empty(count), np.empty(count)
    for i in range(count):
        x[i] = points[i, 0] * first[0] + points[i, 1] * first[1] + points[i, 2] * first[2]
        y[i] = points[i, 0] * second[0] + points[i, 1] * second[1] + points[i, 2] * second[2]
        turn[i] = np.arctan2(y[i], x[i]) * azimuths / (2.0 * np.pi)
    far = np.zeros(azimuths)
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        low, high = turn[a], turn[b]
        if high < low:
            low, high = high, low
        if high - low > 0.5 * azimuths:
            low, high = high, low + azimuths
        # Along azimuth t the line through both ends lies at (xa yb - xb ya) / (cos t dy - sin t dx).
        across = x[a] * y[b] - x[b] * y[a]
        dx, dy = x[b] - x[a], y[b] - y[a]
        for step in range(int(np.ceil(low)), int(np.floor(high)) + 1):
            place = step % azimuths
            below = rays[0, place] * dy - rays[1, place] * dx
            if below != 0.0:
                far[place] = max(far[place], across / below)
    area = perimeter = 0.0
    cosine, sine = rays[0, 1], rays[1, 1]
    for k in range(azimuths):
        a, b = far[k], far[(k + 1) % azimuths]
        area += 0.5 * a * b * sine
        perimeter += np.sqrt(max(a * a + b * b - 2.0 * a * b * cosine, 0.0))
    return area, perimeter


@compiled()
def _climb_views(
    points: np.ndarray, edges: np.ndarray, views: np.ndarray, climbs: int, rays: np.ndarray
) -> tuple[float, float]:
    """Return area and perimeter of the largest projection found from the best views."""
    areas = np.empty(len(views))
    for v in range(len(views)):
        areas[v], _ = _project_star(points, edges, views[v], rays)
    order = np.argsort(-areas)
    best, around = -1.0, 0.0
    for place in range(climbs):
        direction, area = views[order[place]].copy(), areas[order[place]]
        angle = 0.12
        while angle > 0.01:
            base, improved = direction.copy(), False
            lateral = np.zeros(3)
            lateral[np.argmin(np.abs(base))] = 1.0
            first = np.cross(lateral, base)
            second = np.cross(base, first)
            for k in range(6):
                trial = base + angle * (np.cos(k * np.pi / 3) * first + np.sin(k * np.pi / 3) * second)
                trial /= np.sqrt((trial * trial).sum())
                found, _ = _project_star(points, edges, trial, rays)
                if found > area:
                    area, direction, improved = found, trial, True
            if not improved:
                angle *= 0.5
        if area > best:
            best, around = _project_star(points, edges, direction, rays)
    return best, around


@cache
def _rays() -> np.ndarray:
    """Return cosine and sine of the azimuths."""
    turn = 2.0 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    return np.stack([np.cos(turn), np.sin(turn)])


def _largest_projection(points: np.ndarray) -> tuple[float, float]:
    found: tuple[float, float] = _climb_views(points, _edges(), half_sphere(_VIEWS), _CLIMBS, _rays())
    return found
