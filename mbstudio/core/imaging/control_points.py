"""Control points as the search starts from them, and how their number changes on the way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from mbstudio.core.imaging.preprocess import PreparedGrain
from mbstudio.core.imaging.sphere_clustering import Sphere
from mbstudio.core.metaball.field import field_at


def control_of_spheres(
    prepared: PreparedGrain, spheres: Sequence[Sphere], *, weight: str = "square", common_factor: bool = True
) -> Float64[np.ndarray, "4 n"]:
    """Return control points (rows x, y, z, k in the working frame) from inscribed spheres.

    Parameters
    ----------
    prepared : PreparedGrain
    spheres : sequence of Sphere
        Radii in working lengths, as the distance transform gives them: half a voxel is taken off.
    weight : {'square', 'radius'}
        k = r**2, so that one sphere alone is its own metaball; or k = r as the paper prints it.
    common_factor : bool
        Whether all k are divided by one factor so that ln f is 0 on average over the hull: many
        spheres at their own weights are far too large together.
    """
    voxels = np.array([sphere.voxel for sphere in spheres], dtype=np.float64)
    radii = np.maximum(
        np.array([sphere.radius for sphere in spheres]) - 0.5 * prepared.voxel, 0.25 * prepared.voxel
    )
    control = np.empty((4, len(spheres)))
    control[:3] = (voxels[:, ::-1] * prepared.spacing + prepared.origin).T
    control[3] = radii**2 if weight == "square" else radii
    if common_factor:
        rescale(control, prepared)
    return control


def rescale(control: Float64[np.ndarray, "4 n"], prepared: PreparedGrain) -> None:
    """Divide all k, in place, by one factor so that the mean of ln f over the hull is 0."""
    field = field_at(prepared.hull[:: max(1, len(prepared.hull) // 6000)], control)
    control[3] /= np.exp(np.mean(np.log(field)))


def with_number(
    control: Float64[np.ndarray, "4 n"], n: int, prepared: PreparedGrain
) -> Float64[np.ndarray, "4 n2"]:
    """Return `n` control points made from those there are: the worst split, or the nearest merged.

    Splitting a point into two halves of its weight, a short way apart, hardly changes f; the worst
    are those nearest to the hull points that lie farthest from the surface now.
    """
    changed = _merged(control, n) if n < control.shape[1] else _split(control, n, prepared)
    if n != control.shape[1]:
        rescale(changed, prepared)
    return changed


def _split(control: np.ndarray, n: int, prepared: PreparedGrain) -> np.ndarray:
    from scipy.spatial import cKDTree

    stride = max(1, len(prepared.hull) // 6000)
    points = prepared.hull[::stride]
    while control.shape[1] < n:
        # At most a third of the points are split at once, so that one bad place cannot take all.
        count = min(n - control.shape[1], max(1, control.shape[1] // 3))
        error = np.square(np.log(field_at(points, control)))
        _, nearest = cKDTree(control[:3].T).query(points)
        burden = np.bincount(nearest, weights=error, minlength=control.shape[1])
        worst = np.argsort(-burden, kind="stable")[:count]
        new = control[:, worst].copy()
        for column, i in enumerate(worst):
            mine = nearest == i
            # Along the line to the middle of its error, by a quarter of its radius.
            toward = (
                np.average(points[mine], axis=0, weights=error[mine] + 1e-12) - control[:3, i]
                if mine.any()
                else control[:3, i]
            )
            length = max(float(np.linalg.norm(toward)), 1e-9)
            shift = toward / length * min(0.25 * np.sqrt(control[3, i]), 0.25 * length)
            new[:3, column] = control[:3, i] + shift
            control = control.copy()
            control[:3, i] -= 0.5 * shift
        new[3] *= 0.5
        control[3, worst] *= 0.5
        control = np.hstack([control, new])
    return control


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
