"""Where the bodies of a twin touch: gap, place and normal of each pair, and how probable a contact is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float64
from scipy.special import ndtr

from mbstudio.core.metaball.signed_distance import first_order_distance
from mbstudio.core.twin.body import Body, normal_equations, prior, render
from mbstudio.core.twin.feet import Feet, feet_of_points, find_feet
from mbstudio.core.twin.middles import middle_of_volume
from mbstudio.core.twin.optics import REACH, fill_rows
from mbstudio.core.twin.sweeps import Sweeps

TOUCHING = 0.1
"""Voxels: bodies whose gap is no larger touch."""
FARTHEST = 1.0
"""Voxels: pairs with a larger gap are not listed."""
MODEL_DEVIATION = 0.06
"""Voxels: what avatars and blur leave of a gap's error where noise leaves none; from smooth phantoms."""
EVEN = 0.1
"""Voxels: where the gap is larger than the least by no more, it counts as contact area."""
_SEARCHED = 2.0  # voxels from the surface of one body where the other is looked for
_ROUNDS = 7
_FIRST_WINDOW = 1.5  # voxels from the middle of the search
_FACET = 4.0  # times the contact area of two balls
_GRID = np.stack(np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5)), axis=-1).reshape(-1, 2)
_AREA_SIDE = 33

COLUMNS = (
    "a", "b", "x", "y", "z", "nx", "ny", "nz", "gap", "gap_deviation", "probability", "area", "kind",
    "branch_x", "branch_y", "branch_z", "touches_border",
)  # fmt: skip


class Meeting(NamedTuple):
    """Where two bodies are nearest, in voxels.

    Attributes
    ----------
    point, normal : float array, shape (3,)
        Half-way between them; outward from the first, averaged over the contact area.
    gap : float
        Negative where they overlap.
    area : float
        Over which the gap is even.
    is_facet : bool
    """

    point: Float64[np.ndarray, "3"]
    normal: Float64[np.ndarray, "3"]
    gap: float
    area: float
    is_facet: bool


def _across(normal: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "2 3"]:
    """Return two directions across a normal."""
    least = np.eye(3)[int(np.abs(normal).argmin())]
    first = np.cross(normal, least)
    first /= np.linalg.norm(first)
    return np.stack((first, np.cross(normal, first)))


def _both(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[Feet, Feet, np.ndarray]:
    one, other = feet_of_points(points, a), feet_of_points(points, b)
    gap = one.distance + other.distance
    return one, other, np.where(np.isfinite(gap), gap, np.inf)


def _normal_of(one: Feet, other: Feet, chosen: np.ndarray) -> Float64[np.ndarray, "3"] | None:
    total = (one.normal[:, chosen] - other.normal[:, chosen]).sum(axis=1)
    length = float(np.linalg.norm(total))
    return total / length if length > 1e-9 else None


def meet(
    a: Float64[np.ndarray, "4 n"], b: Float64[np.ndarray, "4 m"], start: Float64[np.ndarray, "3"]
) -> Meeting | None:
    """Return where the sum of the distances to two bodies is least, near a start; None if it is not found.

    The search goes over 5 x 5 points across the normal in a window that follows a quadratic's minimum and
    shrinks; half-way between the bodies is found again in each round.
    """
    point, window = start.copy(), _FIRST_WINDOW
    for _ in range(_ROUNDS):
        one, other, gap = _both(point[None], a, b)
        normal = _normal_of(one, other, np.array([True])) if np.isfinite(gap[0]) else None
        if normal is None:
            return None
        point = point + 0.5 * (other.distance[0] - one.distance[0]) * normal
        axes = _across(normal)
        offsets = window * _GRID
        _, _, gaps = _both(point + offsets @ axes, a, b)
        if not np.isfinite(gaps).any():
            return None
        move, inside = _least_of(offsets, gaps, window)
        point = point + move @ axes
        window *= 0.5 if inside else 1.0
    return _describe(point, a, b)


def _least_of(offsets: np.ndarray, gaps: np.ndarray, window: float) -> tuple[np.ndarray, bool]:
    """Return where a quadratic through gaps in a window is least, and whether that lies inside."""
    best = offsets[int(gaps.argmin())]
    good = np.isfinite(gaps)
    if good.sum() >= 12:
        u, v = offsets[good].T
        terms = np.column_stack((np.ones_like(u), u, v, u * u, u * v, v * v))
        c = np.linalg.lstsq(terms, gaps[good], rcond=None)[0]
        hessian = np.array([[2 * c[3], c[4]], [c[4], 2 * c[5]]])
        if c[3] > 1e-6 and np.linalg.det(hessian) > 1e-9:
            move = -np.linalg.solve(hessian, c[1:3])
            if np.abs(move).max() <= window:
                return move, bool(np.abs(move).max() <= 0.6 * window)
    return best, bool(np.abs(best).max() < 0.9 * window)


def _describe(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> Meeting | None:
    one, other, gap = _both(point[None], a, b)
    normal = _normal_of(one, other, np.array([True])) if np.isfinite(gap[0]) else None
    if normal is None:
        return None
    axes, half = _across(normal), 3.0
    ticks = np.linspace(-1, 1, _AREA_SIDE)
    square = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    for _ in range(3):
        one, other, gaps = _both(point + half * square @ axes, a, b)
        even = gaps <= gap[0] + EVEN
        rim = np.abs(square).max(axis=1) > 0.99
        if not (even & rim).any():
            break
        half *= 2.0
    area = float(even.sum()) * (2 * half / (_AREA_SIDE - 1)) ** 2
    averaged = _normal_of(one, other, even) if even.any() else None
    # Two balls of these bodies' radii: the gap grows by r^2 / (2 R) (1 + 1), R their reduced radius.
    radii = [float(np.sqrt(body[3].sum())) for body in (a, b)]
    reduced = radii[0] * radii[1] / (radii[0] + radii[1])
    return Meeting(
        point, normal if averaged is None else averaged, float(gap[0]), area,
        area > _FACET * 2 * np.pi * reduced * EVEN,
    )  # fmt: skip


def _pairs(run: Sweeps) -> list[tuple[int, int, Meeting]]:
    """Return the pairs of bodies, by place, whose gap is small, and where they meet."""
    bodies, spacing = run.bodies, run.frame.spacing
    ends = np.array([[(part.start, part.stop) for part in body.box] for body in bodies])
    found = []
    for i, body in enumerate(bodies):
        near = (ends[i + 1 :, :, 0] < ends[i, :, 1]).all(axis=1)
        near &= (ends[i + 1 :, :, 1] > ends[i, :, 0]).all(axis=1)
        others = i + 1 + np.flatnonzero(near)
        if not len(others):
            continue
        feet = find_feet(body.control, body.low, spacing, body.shape, min(_SEARCHED, REACH * body.blur))
        index = np.stack(np.unravel_index(feet.places, body.shape), axis=1)
        points = index[:, ::-1] * spacing + body.low
        for j in others.tolist():
            start = _start_between(points, feet, bodies[j], spacing)
            meeting = meet(body.control, bodies[j].control, start) if start is not None else None
            if meeting is not None and meeting.gap <= FARTHEST:
                found.append((i, j, meeting))
    return found


def _start_between(
    points: np.ndarray, feet: Feet, other: Body, spacing: np.ndarray
) -> Float64[np.ndarray, "3"] | None:
    """Return the voxel near one body where the sum of both distances is least."""
    high = other.low + (np.array(other.shape[::-1]) - 1) * spacing
    there = np.flatnonzero(((points >= other.low) & (points <= high)).all(axis=1))
    if not len(there):
        return None
    away = first_order_distance(points[there], other.control)
    away = np.where(np.isfinite(away), away, np.inf)
    gap = feet.distance[there] + away
    gap[away < -2 * _SEARCHED] = np.inf  # a first-order distance means nothing deep inside
    best = int(gap.argmin())
    if not gap[best] < FARTHEST + 1.0:
        return None
    chosen: np.ndarray = points[there[best]]
    return chosen


def _variances(run: Sweeps, wanted: dict[int, list[Float64[np.ndarray, "3"]]]) -> dict[int, np.ndarray]:
    """Return by body the variances of its distances to points, in voxels squared, that noise leaves."""
    found = {}
    for i, points in wanted.items():
        body = run.bodies[i]
        share = render(body, run.frame.spacing, run.blur)
        normal = normal_equations(body, share, run.surroundings(body, share))
        size, n = len(normal.gradient), body.control.shape[1]
        matrix = np.tril(normal.matrix)
        matrix = matrix + np.tril(matrix, -1).T + np.diag(prior(body, len(share.feet.places), size))
        feet = feet_of_points(np.array(points), body.control)
        rows = np.zeros((size, len(points)), np.float32)
        fill_rows(feet, np.ones(len(points)), body.control, rows[: 4 * n])
        found[i] = np.maximum((rows * np.linalg.solve(matrix, rows.astype(np.float64))).sum(axis=0), 0.0)
    return found


def contact_table(run: Sweeps) -> pd.DataFrame:
    """Return a row a pair of bodies that touch or nearly do.

    Parameters
    ----------
    run : Sweeps
        After its last step.

    Returns
    -------
    pandas.DataFrame
        Labels ``a < b``; ``x, y, z`` of the contact, ``nx, ny, nz`` from a to b, averaged over the contact
        area; ``gap`` and ``gap_deviation``; ``probability`` that the gap is no larger than 0.1 voxel;
        ``area`` over which the gap is within 0.1 voxel of its least; ``kind``, 'point' or 'facet'; the
        branch vector between the middles of the avatars' volumes; and whether a grain of the pair is cut by
        the border. Lengths are in the unit of the scan.
    """
    pairs = _pairs(run)
    wanted: dict[int, list[Float64[np.ndarray, "3"]]] = {}
    for i, j, meeting in pairs:
        wanted.setdefault(i, []).append(meeting.point)
        wanted.setdefault(j, []).append(meeting.point)
    variances = {i: iter(values.tolist()) for i, values in _variances(run, wanted).items()}
    middles = {i: middle_of_volume(run.bodies[i].control) for i in wanted}
    edge, rows = run.frame.edge, []
    for i, j, meeting in pairs:
        deviation = float(np.sqrt(next(variances[i]) + next(variances[j]) + MODEL_DEVIATION**2))
        probability = float(ndtr((TOUCHING - meeting.gap) / deviation))
        point, branch = run.frame.points_of(meeting.point[None])[0], edge * (middles[j] - middles[i])
        a, b = run.bodies[i], run.bodies[j]
        rows.append(
            (a.label, b.label, *point, *meeting.normal, edge * meeting.gap, edge * deviation, probability,
             edge**2 * meeting.area, "facet" if meeting.is_facet else "point", *branch,
             a.touches_border or b.touches_border)
        )  # fmt: skip
    return pd.DataFrame(rows, columns=list(COLUMNS))
