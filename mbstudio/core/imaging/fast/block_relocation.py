"""Moving the least useful of many control points to where they help most, block by block.

As :mod:`~mbstudio.core.imaging.fast.relocation`, but each control point is judged among its neighbours alone,
and only as many move as gain more than they cost.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from mbstudio.core.imaging.fast.block_refine import BlockRefinement, Part
from mbstudio.core.imaging.fast.relocation import candidates, most_useful, solve, solve_lower
from mbstudio.core.imaging.fast.rows import SurfaceRows

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
        wanted.append(_wanted(search, part, part.surface_rows(at), rng))
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


def _wanted(search: BlockRefinement, part: Part, rows: SurfaceRows, rng: np.random.Generator) -> _Wanted:
    if not part.own:
        return _Wanted(np.empty((4, 0)), np.empty(0))
    places = candidates(search, rows.points[:, : part.own], rows.residual[: part.own], _PLACES, rng)
    if not places.shape[1]:
        return _Wanted(np.empty((4, 0)), np.empty(0))
    return _Wanted(*most_useful(search, rows, part.begun, places, _MOST_OF_BLOCK))
