"""The guard of the fast search: no stray piece and no void leaves it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from mbstudio.core.imaging.fast.homotopy import topology_errors
from mbstudio.core.imaging.fast.refine import Refinement
from mbstudio.core.imaging.fast.relocation import without_the_least_useful
from mbstudio.core.imaging.preprocess import PreparedGrain
from mbstudio.core.metaball.field import field_on_grid
from mbstudio.core.metaball.lines import nearest_link
from mbstudio.core.metaball.surface import volume_and_area_of_thin
from mbstudio.core.metaball.topology import Topology, topology

MOST_ROUNDS = 4
ITERATIONS_PER_ROUND = 15
_SMALL_ISLAND = 0.002  # of the volume of the body
_LARGER_ISLAND = 0.05
_MOST_POINTS = 600
_MOST_LINKS = 40
_LEAST_MARGIN = 0.02  # working lengths


@dataclass(frozen=True, eq=False)
class Candidate:
    """A sound avatar that the guard can fall back on.

    Attributes
    ----------
    control : float array, shape (4, n)
    found : Topology
    score : float
        RMS distance (working lengths) plus relative volume error.
    note : str
        What was done to make it sound, in words.
    """

    control: Float64[np.ndarray, "4 n"]
    found: Topology
    score: float
    note: str


def is_sound(found: Topology, prepared: PreparedGrain) -> bool:
    """Return whether an avatar is one piece, without a void beyond the cavities that were kept on purpose."""
    return found.pieces == 1 and found.voids <= prepared.cavities


def make_candidate(search: Refinement, found: Topology) -> Candidate:
    """Return the avatar of a search, made sound by force where it is not, scored by its errors."""
    note = "the best valid avatar so far"
    if not is_sound(found, search.prepared):
        control, found, note = force_sound(search.control, search.prepared)
        search = Refinement(search.prepared, control)
    volume, _ = volume_and_area_of_thin(search.control)
    score = search.rms() + abs(volume / search.prepared.volume - 1)
    return Candidate(search.control.copy(), found, score, note)


def hold_empty_places(search: Refinement, round_number: int, rng: np.random.Generator) -> int:
    """Hold points of the grain that its avatar leaves empty, damp the search, return how many there are."""
    empty, depths = _find_wrongly_empty(search.control, search.prepared, rng)
    if len(empty):
        search.hold_points(empty, depths, weight=2.0 * (1 + round_number))
    search.damping = max(search.damping, 0.1)
    return len(empty)


def _find_wrongly_empty(
    control: Float64[np.ndarray, "4 n"], prepared: PreparedGrain, rng: np.random.Generator
) -> tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "p"]]:
    """Return points (and depths) inside the grain where f < 1: at most 600, the deepest surely among them."""
    step = max(1, int(np.ceil(max(prepared.distance.shape) / 64)))
    # In filaments and flakes of a few voxels every voxel counts, in thicker grains not the outermost.
    shallowest = (0.75 if prepared.deepest > 3 * prepared.voxel else 0.25) * prepared.voxel
    depth = prepared.distance[::step, ::step, ::step]
    field = field_on_grid(prepared.origin, prepared.spacing * step, depth.shape, control)
    where = np.argwhere((field < 1.0) & (depth > shallowest))
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
        # The gentler way first; later also larger islands, if few control points make them.
        share = _SMALL_ISLAND if round_number < MOST_ROUNDS // 2 else _LARGER_ISLAND
        stray = np.isin(found.piece_of_point, np.flatnonzero(found.volumes < share * found.volumes[0]))
        if 0 < stray.sum() <= max(1, len(stray) // 5):
            search.set_control(search.control[:, ~stray])
            notes.append(f"{int(stray.sum())} control point(s) of islands dropped")
    empty = hold_empty_places(search, round_number, rng)
    if empty:
        notes.append(f"{empty} empty places inside the grain to fill")
    return ", ".join(notes)


def mend_handles(search: Refinement, round_number: int) -> str:
    """Prepare a search whose avatar has other handles than its grain for another round; return what was done.

    Points where the two differ are held inside or outside; holes in walls get a control point each
    from where it is needed least. Returns an empty text where no difference is found.
    """
    errors = topology_errors(search.control, search.prepared)
    notes = []
    plugs = errors.plugs[: max(1, search.control.shape[1] // 10)].T
    if plugs.shape[1] and search.control.shape[1] > 2 * plugs.shape[1] and round_number < MOST_ROUNDS - 1:
        radius = 0.5 * np.maximum(search.depth_of(plugs), search.prepared.voxel)
        control = without_the_least_useful(search, plugs.shape[1])
        search.set_control(np.hstack([control, np.vstack([plugs, radius**2])]))
        notes.append(f"{plugs.shape[1]} control point(s) moved into holes that the grain does not have")
    for points, filled, told in (
        (errors.holes, True, "to fill in holes that the grain does not have"),
        (errors.bridges, False, "to clear on bridges that the grain does not have"),
    ):
        if len(points):
            depth = np.maximum(np.abs(search.depth_of(points.T)), _LEAST_MARGIN)
            search.hold_points(points, depth, weight=2.0 * (1 + round_number), filled=filled)
            notes.append(f"{len(points)} places {told}")
    return ", ".join(notes)


def force_sound(
    control: Float64[np.ndarray, "4 n"], prepared: PreparedGrain
) -> tuple[Float64[np.ndarray, "4 n2"], Topology, str]:
    """Return one body without a void, whatever it costs in truth: the last resort.

    Control points of all but the largest piece are dropped where that piece holds nearly all of
    the volume; then the two control points nearest to joining two pieces grow until they do; at
    last all weights grow together until pieces join and voids close, which they do: f grows
    everywhere.
    """
    control, notes = control.copy(), []
    found = topology(control, finest=64)
    if found.pieces > 1 and found.volumes[0] > 0.97 * found.volumes.sum():
        keep = found.piece_of_point == 0
        notes.append(f"{int((~keep).sum())} control point(s) of islands dropped")
        control = control[:, keep]
        found = topology(control, finest=64)
    for _ in range(_MOST_LINKS):
        if found.pieces == 1:
            break
        a, b, lowest = nearest_link(control, found.piece_of_point, 64)
        control[3, [a, b]] *= float(np.clip(1.02 / lowest, 1.01, 1.3))
        notes = [*notes, "necks grown"] if "necks grown" not in notes else notes
        found = topology(control, finest=64)
    grown = 1.0
    # The coarse grid decides as long as it finds faults; only its praise is looked at closely.
    while not (found.is_sound and (found := topology(control)).is_sound):
        control[3] *= 1.03
        grown *= 1.03
        found = topology(control, finest=64)
    if grown > 1:
        notes.append(f"all weights grown by {100 * (grown - 1):.0f} % to join pieces and close voids")
    return control, found, ", ".join(notes)
