"""The last touch to a fitted sphere clump: no bulges, and the avatar's volume, centre of mass and inertia."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from mbstudio.core.dem.shapes.clump_task import (
    SPHERE_POINTS,
    ClumpTask,
    bare_points,
    filled_share,
    nearest_sphere,
    sphere_points,
)

_TRIMS = 6
_BULGE = 2.5
"""How many times the mean distance a sphere may stand out of the avatar."""
_STRETCHES = 8
_GOOD_INERTIA = 5e-4
_OVERLAP_FOR_INERTIA = 0.002

Spheres = tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]


@dataclass(frozen=True, eq=False)
class ClumpFigures:
    """How true a clump is, lengths in the scale of its task.

    Attributes
    ----------
    iou, volume_ratio, inertia_error, mean_distance, hausdorff : float
        As in :class:`mbstudio.core.dem.shapes.clump.Clump`.
    """

    iou: float
    volume_ratio: float
    inertia_error: float
    mean_distance: float
    hausdorff: float


def finished(task: ClumpTask, centers: Float[np.ndarray, "n 3"], radii: Float[np.ndarray, " n"]) -> Spheres:
    """Return the spheres without bulges, with the volume, centre of mass and inertia of the avatar.

    The radii take one common offset for the volume; the centres are moved as a whole, and stretched about
    the centre of mass until the second moments agree. The stretch is given up where it would cost overlap.
    """
    centers, radii = _without_bulges(task, centers, radii)
    _, wanted_center, wanted = _moments(task, task.filled)
    best, best_error, least = (centers, radii), np.inf, 0.0
    for _ in range(_STRETCHES + 1):
        radii, filled = _with_volume(task, centers, radii)
        _, center, tensor = _moments(task, filled)
        error, overlap = _tensor_error(tensor, wanted), _overlap(task, filled)
        centers = centers + wanted_center - center
        least = least or overlap - _OVERLAP_FOR_INERTIA
        if overlap >= least and error < best_error:
            best, best_error = (centers, radii), error
        if best_error < _GOOD_INERTIA:
            break
        centers = wanted_center + (centers - wanted_center) @ _stretch(tensor, wanted)
    return best


def figures(
    task: ClumpTask, centers: Float[np.ndarray, "n 3"], radii: Float[np.ndarray, " n"]
) -> ClumpFigures:
    """Return how true a clump is."""
    filled = _filled(task, centers, radii)
    volume, _, tensor = _moments(task, filled)
    wanted_volume, _, wanted = _moments(task, task.filled)
    overshoot = bare_points(task, centers, radii, sphere_points(4 * SPHERE_POINTS))[2]
    gaps = np.abs(nearest_sphere(task.surface, centers, radii)[1])
    return ClumpFigures(
        _overlap(task, filled),
        volume / wanted_volume,
        # Both as they are: a clump of more volume has more inertia, too.
        _tensor_error(tensor * volume, wanted * wanted_volume),
        float(np.concatenate([gaps, np.abs(overshoot)]).mean()),
        float(max(gaps.max(), np.abs(overshoot).max(initial=0.0))),
    )


def _without_bulges(
    task: ClumpTask, centers: Float[np.ndarray, "n 3"], radii: Float[np.ndarray, " n"]
) -> Spheres:
    """Push back into the avatar the few spheres that stand out of it by far more than the clump does."""
    directions = sphere_points(SPHERE_POINTS)
    centers = centers.copy()
    gaps = np.abs(nearest_sphere(task.surface, centers, radii)[1])
    for _ in range(_TRIMS):
        _, sphere, overshoot, normals = bare_points(task, centers, radii, directions)
        allowed = _BULGE * float(np.concatenate([gaps, np.abs(overshoot)]).mean())
        worst = np.full(len(radii), -1)
        order = np.argsort(overshoot, kind="stable")
        worst[sphere[order]] = order  # the last of each sphere is the one that stands out most
        out = np.flatnonzero((worst >= 0) & (np.where(worst >= 0, overshoot[worst], 0.0) > allowed))
        if not len(out):
            break
        centers[out] -= normals[worst[out]] * (overshoot[worst[out]] - allowed)[:, None]
    return centers, radii


def _with_volume(
    task: ClumpTask, centers: Float[np.ndarray, "n 3"], radii: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " g"]]:
    """Offset all radii alike, which moves the distance to the clump by as much everywhere.

    Returns
    -------
    radii : float array, shape (n,)
    filled : float array, shape (nodes,)
        Share of each node's cell that the clump then fills.
    """
    smallest = 0.5 * float(radii.min())
    while True:
        distance = nearest_sphere(task.grid, centers, radii)[1]
        offset = 0.0
        for _ in range(6):
            filled = filled_share(distance - offset, task.spacing)
            surface = np.count_nonzero((filled > 0) & (filled < 1)) / task.spacing
            if surface == 0:
                break
            offset += float(task.filled.sum() - filled.sum()) / surface
        if offset >= smallest - float(radii.min()) or radii.min() <= smallest:
            return np.maximum(radii + offset, smallest), filled_share(distance - offset, task.spacing)
        radii = np.maximum(radii + offset, smallest)


def _filled(
    task: ClumpTask, centers: Float[np.ndarray, "n 3"], radii: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " g"]:
    return filled_share(nearest_sphere(task.grid, centers, radii)[1], task.spacing)


def _overlap(task: ClumpTask, filled: Float[np.ndarray, " g"]) -> float:
    inside = filled >= 0.5
    return float(np.count_nonzero(inside & task.inside) / np.count_nonzero(inside | task.inside))


def _moments(
    task: ClumpTask, filled: Float[np.ndarray, " g"]
) -> tuple[float, Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]]:
    """Return volume, centre of mass, and second moments about it over the volume."""
    some = filled > 0
    weights, places = filled[some], task.grid[some]
    volume = float(weights.sum())
    # Not by BLAS, whose sums depend on the number of its threads.
    center = np.einsum("g,gi->i", weights, places) / volume
    offsets = places - center
    second = np.einsum("gi,gj->ij", offsets * weights[:, None], offsets) / volume
    return volume * task.spacing**3, center, second


def _tensor_error(moments: Float[np.ndarray, "3 3"], wanted: Float[np.ndarray, "3 3"]) -> float:
    """Return the difference of the inertia tensors over the wanted one (Frobenius norms)."""
    tensor, target = (np.trace(second) * np.eye(3) - second for second in (moments, wanted))
    return float(np.linalg.norm(tensor - target) / np.linalg.norm(target))


def _stretch(moments: Float[np.ndarray, "3 3"], wanted: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Return what to multiply rows of offsets by so that their second moments become the wanted ones."""
    values, axes = np.linalg.eigh(moments)
    root = axes * np.sqrt(values) @ axes.T
    inverse = axes / np.sqrt(values) @ axes.T
    inner, turned = np.linalg.eigh(root @ wanted @ root)
    # The symmetric map between two Gaussians (their optimal transport), held close to doing nothing.
    both = inverse @ (turned * np.sqrt(inner) @ turned.T) @ inverse
    growth, along = np.linalg.eigh(both)
    return np.asarray(along * np.clip(growth, 0.9, 1.1) @ along.T)
