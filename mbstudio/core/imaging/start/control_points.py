"""Control points as the search starts from them, and how their number changes on the way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float64

from mbstudio.core.imaging.loss import mean_loss
from mbstudio.core.imaging.preprocess import PreparedGrain
from mbstudio.core.imaging.start.sphere_clustering import Sphere
from mbstudio.core.metaball.field import field_at

# Shifts of a split that are tried, in those of the widest: near the end of a search shorter ones
# keep what was reached, but points too near to one another part slowly.
_SHIFTS = (1.0, 0.6, 0.35)


def control_of_spheres(
    prepared: PreparedGrain,
    spheres: Sequence[Sphere],
    *,
    weight: Literal["square", "radius"] = "square",
    common_factor: bool = True,
    radius_offset: float = 0.5,
) -> Float64[np.ndarray, "4 n"]:
    """Return control points (rows x, y, z, k in the working frame) from inscribed spheres.

    Parameters
    ----------
    prepared : PreparedGrain
    spheres : sequence of Sphere
        Radii in working lengths, as the distance transform gives them.
    weight : {'square', 'radius'}
        k = r**2, so that one sphere alone is its own metaball; or k = r as the paper prints it.
    common_factor : bool
        Whether all k are divided by one factor so that ln f is 0 on average over the hull: many
        spheres at their own weights are far too large together.
    radius_offset : float
        Voxels taken off each radius, of which a quarter of a voxel is left at least: the transform
        reaches to the centre of the nearest voxel outside, half a voxel beyond the surface.
    """
    voxels = np.array([sphere.voxel for sphere in spheres], dtype=np.float64)
    radii = np.maximum(
        np.array([sphere.radius for sphere in spheres]) - radius_offset * prepared.voxel,
        0.25 * prepared.voxel,
    )
    control = np.empty((4, len(spheres)))
    control[:3] = (voxels[:, ::-1] * prepared.spacing + prepared.origin).T
    control[3] = radii**2 if weight == "square" else radii
    if common_factor:
        rescale(control, prepared)
    return control


def rescale(control: Float64[np.ndarray, "4 n"], prepared: PreparedGrain) -> None:
    """Divide all k, in place, by one factor so that the mean of ln f over the hull is 0."""
    field = field_at(_thin_hull(prepared), control)
    control[3] /= np.exp(np.mean(np.log(field)))


def with_number(
    control: Float64[np.ndarray, "4 n"], n: int, prepared: PreparedGrain
) -> Float64[np.ndarray, "4 n2"]:
    """Return `n` control points made from those there are: the worst split, or the nearest merged.

    Splitting a point into two halves of its weight, a short way apart, hardly changes f; the worst
    are those nearest to the hull points that lie farthest from the surface now. One factor on all
    weights follows where it lowers the loss.
    """
    if n == control.shape[1]:
        return control.copy()
    points = _thin_hull(prepared)
    changed = _merged(control, n) if n < control.shape[1] else _split(control, n, points)
    scaled = changed.copy()
    rescale(scaled, prepared)
    return min(changed, scaled, key=lambda one: mean_loss(field_at(points, one)))


def _thin_hull(prepared: PreparedGrain) -> np.ndarray:
    return prepared.hull[:: max(1, len(prepared.hull) // 6000)]


def _split(control: np.ndarray, n: int, points: np.ndarray) -> np.ndarray:
    from scipy.spatial import cKDTree

    while control.shape[1] < n:
        # At most a third of the points are split at once, so that one bad place cannot take all.
        count = min(n - control.shape[1], max(1, control.shape[1] // 3))
        error = np.square(np.log(field_at(points, control)))
        _, nearest = cKDTree(control[:3].T).query(points)
        burden = np.bincount(nearest, weights=error, minlength=control.shape[1])
        worst = np.argsort(-burden, kind="stable")[:count]
        shift = _shifts(control, worst, points, nearest, error)
        tried = [_split_by(control, worst, scale * shift) for scale in _SHIFTS]
        control = min(tried, key=lambda one: mean_loss(field_at(points, one)))
    return control


def _shifts(
    control: np.ndarray, worst: np.ndarray, points: np.ndarray, nearest: np.ndarray, error: np.ndarray
) -> np.ndarray:
    """Return for each point to be split a quarter of its radius along the line to the middle of its error."""
    shift = np.empty((3, len(worst)))
    for column, i in enumerate(worst):
        mine = nearest == i
        toward = (
            np.average(points[mine], axis=0, weights=error[mine] + 1e-12) - control[:3, i]
            if mine.any()
            else control[:3, i]
        )
        length = max(float(np.linalg.norm(toward)), 1e-9)
        shift[:, column] = toward / length * min(0.25 * np.sqrt(control[3, i]), 0.25 * length)
    return shift


def _split_by(control: np.ndarray, which: np.ndarray, shift: np.ndarray) -> np.ndarray:
    split, new = control.copy(), control[:, which].copy()
    new[:3] += shift
    split[:3, which] -= 0.5 * shift
    new[3] *= 0.5
    split[3, which] *= 0.5
    return np.hstack([split, new])


def _merged(control: np.ndarray, n: int) -> np.ndarray:
    """Merge the pair whose joint surface changes least, until `n` are left."""
    control = control.copy()
    while control.shape[1] > n:
        delta = control[:3, :, None] - control[:3, None, :]
        square = (delta**2).sum(axis=0)
        # Merging points of weights a and b at distance d changes f by about a b d**2 / (a + b).
        a, b = control[3][:, None], control[3][None, :]
        change = square * a * b / (a + b)
        change[np.diag_indices(control.shape[1])] = np.inf
        i, j = sorted(int(index) for index in np.unravel_index(int(change.argmin()), change.shape))
        total = control[3, i] + control[3, j]
        control[:3, i] = (control[:3, i] * control[3, i] + control[:3, j] * control[3, j]) / total
        control[3, i] = total
        control = np.delete(control, j, axis=1)
    return control
