"""The guard of the fast search: no stray piece and no void leaves it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from mbstudio.core.imaging.levenberg_marquardt import depth_at
from mbstudio.core.imaging.preprocess import PreparedGrain
from mbstudio.core.imaging.refine import Refinement
from mbstudio.core.metaball.field import field_on_grid
from mbstudio.core.metaball.topology import Topology, topology

MOST_ROUNDS = 4
ITERATIONS_PER_ROUND = 15
_SMALL_ISLAND = 0.002  # of the volume of the body
_MOST_POINTS = 600


def wrongly_empty(
    control: Float64[np.ndarray, "4 n"], prepared: PreparedGrain, rng: np.random.Generator
) -> tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "p"]]:
    """Return points (and depths) inside the grain where f < 1: at most 600, the deepest surely among them."""
    step = max(1, int(np.ceil(max(prepared.distance.shape) / 64)))
    depth = prepared.distance[::step, ::step, ::step]
    field = field_on_grid(prepared.origin, prepared.spacing * step, depth.shape, control)
    where = np.argwhere((field < 1.0) & (depth > 0.75 * prepared.voxel))
    depths = depth[tuple(where.T)].astype(np.float64)
    if len(where) > _MOST_POINTS:
        deepest = np.argsort(-depths, kind="stable")[: _MOST_POINTS // 2]
        rest = np.setdiff1d(np.arange(len(where)), deepest)
        chosen = np.concatenate([deepest, rng.choice(rest, _MOST_POINTS // 2, replace=False, shuffle=False)])
        where, depths = where[chosen], depths[chosen]
    return where[:, ::-1] * step * prepared.spacing + prepared.origin, depths


def repair(search: Refinement, found: Topology, round_number: int, rng: np.random.Generator) -> str:
    """Prepare a search whose avatar is unsound for another round; return what was done, in words."""
    notes = []
    if found.pieces > 1:
        islands = np.flatnonzero(found.volumes < _SMALL_ISLAND * found.volumes[0])
        if round_number >= MOST_ROUNDS // 2:  # the gentler way has had its chance
            islands = np.flatnonzero(found.volumes < 0.05 * found.volumes[0])
        stray = np.isin(found.piece_of_point, islands)
        if stray.any():
            search.set_control(search.control[:, ~stray])
            points = "control point" if stray.sum() == 1 else "control points"
            notes.append(f"{int(stray.sum())} {points} of an island dropped")
    points, depths = wrongly_empty(search.control, search.prepared, rng)
    if len(points):
        search.keep_filled(points, depths, weight=2.0 * (1 + round_number))
        notes.append(f"{len(points)} empty places inside the grain to be filled")
    search.damping = max(search.damping, 0.1)
    return ", ".join(notes)


def force_sound(
    control: Float64[np.ndarray, "4 n"], prepared: PreparedGrain
) -> tuple[Float64[np.ndarray, "4 n2"], Topology, str]:
    """Return one body without a void, whatever it costs in truth: the last resort.

    Control points of all but the largest piece are dropped where that piece holds nearly all of
    the volume; then all weights grow together until pieces join and voids close, which they do:
    f grows everywhere.
    """
    control, notes = control.copy(), []
    found = topology(control)
    if found.pieces > 1 and found.volumes[0] > 0.9 * found.volumes.sum():
        keep = found.piece_of_point == 0
        notes.append(f"{int((~keep).sum())} control points of islands dropped")
        control = control[:, keep]
        found = topology(control)
    grown = 1.0
    while not found.is_sound:
        control[3] *= 1.03
        grown *= 1.03
        found = topology(control)
    if grown > 1:
        notes.append(f"all weights grown by {100 * (grown - 1):.0f} % to join pieces and close voids")
    return control, found, ", ".join(notes)


def lies_outside(control: Float64[np.ndarray, "4 n"], prepared: PreparedGrain) -> int:
    """Return how many control points lie in no voxel of the prepared grain."""
    depth, slope = np.empty(control.shape[1]), np.empty((3, control.shape[1]))
    depth_at(control[:3], prepared.distance, prepared.origin, prepared.spacing, depth, slope)
    return int(np.count_nonzero(depth < -0.5 * prepared.voxel))
