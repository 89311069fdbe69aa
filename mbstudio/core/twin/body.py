"""One avatar of a twin: how it stands in the scan, and its step towards the grey values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64

from mbstudio.core.imaging.depths import depth_at
from mbstudio.core.imaging.fast.levenberg_marquardt import add_normal_matrix, solve_damped
from mbstudio.core.metaball.signed_distance import first_order_distance
from mbstudio.core.twin.feet import Feet, find_feet
from mbstudio.core.twin.optics import REACH, fill_rows, shade

HUBER = 2.5
"""Deviations from which a voxel's residual counts linearly."""
_PRIOR_PLACE = (
    0.3  # voxels that a control point may move in a step for the price of one deviation of one voxel
)
_PRIOR_WEIGHT = 0.3  # of ln k
_MOST_MOVE = 0.7  # voxels a step
_MOST_GROWTH = 0.4  # of ln k a step
_MOST_TRIES = 4
_SMALLEST_DAMPING = 1e-4
_FEWEST_PER_PARAMETER = 30  # voxels near the surface; with fewer the prior is tighter


@dataclass(eq=False)
class Depths:
    """How deep places lie in a grain's labels: what keeps control points inside.

    Attributes
    ----------
    distance : float32 array, shape (z, y, x)
        Signed distance in voxels, positive inside.
    low, spacing : float array, shape (3,)
        First voxel's centre and edges (x, y, z).
    least : float
        The depth below which no control point may go.
    """

    distance: Float32[np.ndarray, "z y x"]
    low: Float64[np.ndarray, "3"]
    spacing: Float64[np.ndarray, "3"]
    least: float

    def of(
        self, control: Float64[np.ndarray, "4 n"]
    ) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "3 n"]]:
        """Return the depth of control points and its gradient."""
        n = control.shape[1]
        depth, slope = np.empty(n), np.empty((3, n))
        depth_at(np.ascontiguousarray(control[:3]), self.distance, self.low, self.spacing, depth, slope)
        return depth, slope

    def hold(self, control: Float64[np.ndarray, "4 n"], before: Float64[np.ndarray, "4 n"]) -> None:
        """Bring control points that have come too near to the surface back in, in place."""
        least = np.minimum(self.least, self.of(before)[0])
        for _ in range(2):
            depth, slope = self.of(control)
            low = depth < least
            if not low.any():
                return
            norm = np.maximum((slope[:, low] ** 2).sum(axis=0), 1e-3)
            control[:3, low] += slope[:, low] * ((least[low] - depth[low]) / norm)
        stuck = self.of(control)[0] < least - 1e-6
        control[:3, stuck] = before[:3, stuck]


@dataclass(eq=False)
class Body:
    """An avatar among the others of a twin; lengths in voxels.

    Attributes
    ----------
    label : int
    control : float array, shape (4, n)
    tone : float array, shape (1,) or (4,)
        Its tone above the void level in contrasts, at its middle, and how it changes with x, y, z over
        a radius.
    middle : float array, shape (3,)
    radius : float
    box : tuple of slice
        The voxels that it may have to do with.
    low : float array, shape (3,)
        Centre of the box's first voxel (x, y, z).
    depths : Depths
    blur : float
        With which its share of the model stands.
    damping : float
    moved : float
        By how much its surface went in the last sweep, root mean square.
    shift : float
        By how much it lies off where it started, root mean square.
    note : str
        What went other than usual.
    touches_border : bool
        Whether the scan's border cuts its grain.
    start, whole : float array, shape (4, n)
        Control points as they started, and as they were when last seen to be one piece without a void.
    """

    label: int
    control: Float64[np.ndarray, "4 n"]
    tone: Float64[np.ndarray, "q"]
    middle: Float64[np.ndarray, "3"]
    radius: float
    box: tuple[slice, slice, slice]
    low: Float64[np.ndarray, "3"]
    depths: Depths
    blur: float = 1.0
    damping: float = 1e-2
    moved: float = float("inf")
    shift: float = float("nan")
    note: str = ""
    touches_border: bool = False
    start: Float64[np.ndarray, "4 n"] = field(init=False)
    whole: Float64[np.ndarray, "4 n"] = field(init=False)

    def __post_init__(self) -> None:
        self.start = self.whole = self.control.copy()

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels of the box along z, y, x."""
        z, y, x = (part.stop - part.start for part in self.box)
        return z, y, x


class Share(NamedTuple):
    """What a body adds to the grey values of its box, and what that hangs on.

    Attributes
    ----------
    feet : Feet
    share, by_distance, by_blur : float array, shape (m,)
        Of the voxels near the surface.
    near_terms, core_terms : float array, shapes (m, q) and (c, q)
        Terms of the tone at the voxels.
    near_tone : float array, shape (m,)
        Tone there.
    added : float32 array, shape of the box, flat
    """

    feet: Feet
    share: Float64[np.ndarray, "m"]
    by_distance: Float64[np.ndarray, "m"]
    by_blur: Float64[np.ndarray, "m"]
    near_terms: Float64[np.ndarray, "m q"]
    core_terms: Float64[np.ndarray, "c q"]
    near_tone: Float64[np.ndarray, "m"]
    added: Float32[np.ndarray, "v"]


class Surroundings(NamedTuple):
    """What the scan leaves for a body to explain in its box; all flat.

    Attributes
    ----------
    rest : float32 array, shape (v,)
        Grey values less the void level and all other bodies, in contrasts.
    sharpness : float32 array, shape (v,)
        One over the noise in contrasts; 0 outside the field of view.
    """

    rest: Float32[np.ndarray, "v"]
    sharpness: Float32[np.ndarray, "v"]


def tone_terms(body: Body, flat: np.ndarray, spacing: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "m q"]:
    """Return the terms of a body's tone at voxels of its box."""
    if len(body.tone) == 1:
        return np.ones((len(flat), 1))
    index = np.stack(np.unravel_index(flat, body.shape), axis=1)[:, ::-1]
    away = (index * spacing + body.low - body.middle) / body.radius
    return np.column_stack((np.ones(len(flat)), away))


def render(body: Body, spacing: Float64[np.ndarray, "3"], blur: float, feet: Feet | None = None) -> Share:
    """Return what a body adds to the grey values of its box, in contrasts.

    Parameters
    ----------
    body : Body
    spacing : float array, shape (3,)
    blur : float
        In voxels.
    feet : Feet, optional
        Where they are known.
    """
    feet = find_feet(body.control, body.low, spacing, body.shape, REACH * blur) if feet is None else feet
    share, by_distance, by_blur = shade(feet, blur)
    near, core = tone_terms(body, feet.places, spacing), tone_terms(body, feet.core, spacing)
    near_tone = near @ body.tone
    added = np.zeros(int(np.prod(body.shape)), np.float32)
    added[feet.places] = near_tone * share
    added[feet.core] = core @ body.tone
    return Share(feet, share, by_distance, by_blur, near, core, near_tone, added)


def misfit(found: Share, around: Surroundings) -> float:
    """Return half the sum of the squared residuals in deviations of the noise, large ones linearly."""
    away = np.abs((around.rest - found.added) * around.sharpness)
    small = np.minimum(away, np.float32(HUBER))
    return float((small * (away - np.float32(0.5) * small)).sum(dtype=np.float64))


class Normal(NamedTuple):
    """The normal equations of a body: in its lower triangle J^T J, and J^T r; padded to a multiple of 4."""

    matrix: Float64[np.ndarray, "p p"]
    gradient: Float64[np.ndarray, "p"]
    rows: Float32[np.ndarray, "p m"]


def _linearise(residual: np.ndarray) -> np.ndarray:
    """Return the roots of the weights by which squares give large residuals linearly."""
    roots: np.ndarray = np.sqrt(np.minimum(1.0, HUBER / np.maximum(np.abs(residual), 1e-9)))
    return roots


def normal_equations(body: Body, found: Share, around: Surroundings) -> Normal:
    """Return the normal equations of ln k, x, y, z of all control points, and the tone."""
    feet, n, q = found.feet, body.control.shape[1], len(body.tone)
    size = -(-(4 * n + q) // 4) * 4
    sharp = around.sharpness[feet.places].astype(np.float64)
    residual = (found.near_tone * found.share - around.rest[feet.places]) * sharp
    roots = _linearise(residual) * sharp
    rows = np.zeros((size, len(sharp)), np.float32)
    fill_rows(feet, found.near_tone * found.by_distance * roots, body.control, rows)
    rows[4 * n : 4 * n + q] = found.near_terms.T * (found.share * roots)
    matrix, gradient = np.zeros((size, size)), np.zeros(size)
    add_normal_matrix(rows, (residual * _linearise(residual)).astype(np.float32), matrix, gradient)
    sharp = around.sharpness[feet.core].astype(np.float64)
    residual = (found.added[feet.core] - around.rest[feet.core]) * sharp
    roots = _linearise(residual)
    terms = found.core_terms * (roots * sharp)[:, None]
    tones = slice(4 * n, 4 * n + q)
    # No product of matrices by a library, whose last digits hang on its threads.
    matrix[tones, tones] += np.einsum("ma,mb->ab", terms, terms)
    gradient[tones] += np.einsum("ma,m->a", terms, residual * roots)
    return Normal(matrix, gradient, rows)


def prior(body: Body, near: int, size: int) -> Float64[np.ndarray, "p"]:
    """Return what a step costs for its own sake: the prior's precision, re-centred where the body stands."""
    n, q = body.control.shape[1], len(body.tone)
    tighter = max(1.0, _FEWEST_PER_PARAMETER * 4 * n / max(near, 1))
    precision = np.ones(size)
    precision[:n] = tighter / _PRIOR_WEIGHT**2
    precision[n : 4 * n] = tighter / _PRIOR_PLACE**2
    precision[4 * n : 4 * n + q] = 1.0
    return precision


def advance(
    body: Body, found: Share, around: Surroundings, spacing: Float64[np.ndarray, "3"], blur: float
) -> tuple[Share, bool]:
    """Take one damped step; return what the body then adds, and whether a step was found that helps."""
    n, q = body.control.shape[1], len(body.tone)
    normal = normal_equations(body, found, around)
    size = len(normal.gradient)
    own, before = prior(body, len(found.feet.places), size), misfit(found, around)
    control, tone = body.control, body.tone
    factor, step = np.zeros((size, size)), np.zeros(size)
    for _ in range(_MOST_TRIES):
        damped = own + body.damping * np.diag(normal.matrix)
        if solve_damped(normal.matrix, damped, normal.gradient, factor, step):
            longest = np.sqrt((step[n : 4 * n].reshape(3, n) ** 2).sum(axis=0)).max()
            share = min(
                1.0, _MOST_MOVE / max(longest, 1e-9), _MOST_GROWTH / max(np.abs(step[:n]).max(), 1e-9)
            )
            body.control = control.copy()
            body.control[3] *= np.exp(share * step[:n])
            body.control[:3] += share * step[n : 4 * n].reshape(3, n)
            body.depths.hold(body.control, control)
            body.tone = tone + share * step[4 * n : 4 * n + q]
            trial = render(body, spacing, blur)
            if misfit(trial, around) < before:
                body.damping = max(body.damping / 5.0, _SMALLEST_DAMPING)
                return trial, True
        body.damping *= 8.0
        body.control, body.tone = control, tone
    return found, False


def surface_change(before: Float64[np.ndarray, "4 n"], found: Share) -> float:
    """Return how far a body's surface lies from an earlier one, root mean square, to first order."""
    near = np.abs(found.feet.distance) < 1.0
    if not near.any():
        return 0.0
    away = first_order_distance(found.feet.foot[:, near].T, before)
    away = away[np.isfinite(away)]
    return float(np.sqrt(np.mean(away**2))) if len(away) else 0.0
