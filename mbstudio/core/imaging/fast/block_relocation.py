"""Moving the least useful of many control points to where they help most, block by block.

As :mod:`~mbstudio.core.imaging.fast.relocation`, but each control point is judged among its neighbours alone,
and only as many move as gain more than they cost.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from mbstudio.core.imaging.depths import push_in
from mbstudio.core.imaging.fast.block_refine import BlockRefinement, Part
from mbstudio.core.imaging.fast.levenberg_marquardt import add_normal_matrix, jacobian_of_rows
from mbstudio.core.imaging.fast.relocation import (
    DEPTHS,
    LARGEST,
    SMALLEST,
    STEEPEST,
    products,
    pursue,
    solve,
    solve_lower,
    symmetric,
)

_PLACES = 24
"""Surface points of a block below which a new control point may come."""
_MOST_OF_BLOCK = 8
"""New control points that a block takes at a time."""


class _Wanted(NamedTuple):
    """Control points that a block could do with, and by how much each would lower the sum of squares."""

    control: Float64[np.ndarray, "4 c"]
    gains: Float64[np.ndarray, "c"]


def relocate_in_blocks(search: BlockRefinement, most: int, rng: np.random.Generator) -> int:
    """Take control points of a search away where they cost little, and place as many where they gain more.

    Parameters
    ----------
    search : BlockRefinement
        Changed in place; the sum of squares can rise until the next steps have settled it.
    most : int
        That move at most.
    rng : numpy.random.Generator
        Chooses the surface points below which new control points are tried.

    Returns
    -------
    int
        How many moved.
    """
    losses = np.empty(search.control.shape[1])
    wanted = []
    for part in search.parts():
        at = part.rows(part.begun)
        losses[part.block] = _losses(part.normal_equations(at)[0])
        wanted.append(_wanted(search, part, rng))
    gains = np.concatenate([found.gains for found in wanted])
    cheapest = np.argsort(losses, kind="stable")[:most]
    best = np.argsort(-gains, kind="stable")[: len(cheapest)]
    cheapest = cheapest[: len(best)]
    worth = int(np.count_nonzero(gains[best] > losses[cheapest]))
    if worth:
        control = np.hstack([found.control for found in wanted])
        search.exchange(cheapest[:worth], control[:, best[:worth]])
    return worth


def _losses(matrix: np.ndarray) -> np.ndarray:
    """Return by how much the sum of squares grows, to first order, without each control point of a block.

    The others of the block make up for it: the least of the quadratic form with ln k lower by 1.
    """
    size = len(matrix)
    diagonal = np.diagonal(matrix)
    factor, _, _ = solve(matrix, 1e-5 * diagonal + 1e-6 * diagonal.mean(), np.zeros(size))
    columns = np.zeros((size, size // 4))
    np.fill_diagonal(columns, 1.0)
    solve_lower(factor, columns)
    found: np.ndarray = 1 / np.square(columns).sum(axis=0)
    return found


def _wanted(search: BlockRefinement, part: Part, rng: np.random.Generator) -> _Wanted:
    at = part.rows(part.begun)
    points, slope, residual = part.at_points(at)
    places = _candidates(search, points[:, : part.own], residual[: part.own], rng)
    tried, b = places.shape[1], 4 * part.begun.shape[1]
    if not tried:
        return _Wanted(np.empty((4, 0)), np.empty(0))
    rows = np.zeros((b + tried + (-tried) % 4, points.shape[1]), dtype=np.float32)
    jacobian_of_rows(points, part.begun.astype(np.float32), slope, rows[:b])
    unit = np.vstack([places, np.ones(tried)]).astype(np.float32)
    by_weight = np.empty((4 * tried, points.shape[1]), dtype=np.float32)
    jacobian_of_rows(points, unit, slope, by_weight)
    by_weight[:tried][~(np.abs(by_weight[:tried]).max(axis=1) < STEEPEST)] = 0.0
    rows[b : b + tried] = by_weight[:tried]
    matrix, gradient = np.zeros((len(rows), len(rows))), np.zeros(len(rows))
    add_normal_matrix(rows, residual, matrix, gradient)
    # What the control points of the block can do by themselves is taken out of the new ones.
    old = np.ascontiguousarray(matrix[:b, :b])
    diagonal = np.diagonal(old)
    factor, _, _ = solve(old, 1e-3 * diagonal + 1e-4 * diagonal.mean(), gradient[:b])
    new = slice(b, b + tried)
    shared = np.ascontiguousarray(np.hstack([matrix[new, :b].T, gradient[:b, None]]))
    solve_lower(factor, shared)
    gram, down = symmetric(matrix[new, new]), gradient[new].copy()
    own = np.diagonal(gram).copy()
    taken, taken_down = products(shared[:, :tried].T, shared[:, tried])
    gram -= taken
    down -= taken_down
    chosen, gains = pursue(gram.copy(), down.copy(), own, _MOST_OF_BLOCK)
    weights = -np.linalg.solve(gram[np.ix_(chosen, chosen)], down[chosen])
    depth = search.depth_of(places[:, chosen])
    weights = np.clip(weights, (SMALLEST * depth) ** 2, (LARGEST * depth) ** 2)
    return _Wanted(np.vstack([places[:, chosen], weights]), gains)


def _candidates(
    search: BlockRefinement, points: np.ndarray, residual: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return places (rows x, y, z) below surface points, chosen the likelier the farther they lie off."""
    if not len(residual):
        return np.empty((3, 0))
    share = np.square(residual, dtype=np.float64) + 1e-16
    chosen = rng.choice(
        len(residual), min(_PLACES, len(residual)), replace=False, p=share / share.sum(), shuffle=False
    )
    surface = points[:, chosen].astype(np.float64)
    tried = []
    for times in DEPTHS:
        places = surface.copy()
        push_in(search.prepared, places, np.full(len(chosen), times * search.soft_depth), surface)
        tried.append(places[:, search.depth_of(places) > 0.9 * search.hard_depth])
    return np.hstack(tried)
