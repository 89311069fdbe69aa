"""Moving the least useful control points to where they help most, in the midst of a search.

Sphere clustering decides where control points start, and the search moves none of them across the
grain: edges and corners that began without a point of their own stay blunt. Here the control
points whose loss would cost least (after the others have made up for it) are taken away, and as
many new ones placed where they lower the sum of squares most, both to first order: *optimal brain
surgery* and *orthogonal matching pursuit* on the normal equations of the search.

References
----------
Hassibi & Stork (1993), Second order derivatives for network pruning, NIPS 5, 164-171.
Pati, Rezaiifar & Krishnaprasad (1993), Orthogonal matching pursuit, Asilomar 27, 40-44.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from mbstudio.core.compiled import compiled
from mbstudio.core.errors import FitError
from mbstudio.core.imaging.depths import push_in
from mbstudio.core.imaging.fast.levenberg_marquardt import add_normal_matrix, jacobian_of_rows, solve_damped
from mbstudio.core.imaging.fast.refine import Refinement
from mbstudio.core.imaging.fast.rows import SurfaceRows

_PLACES = 100  # surface points below which a new control point may come
_DEPTHS = (1.0, 2.0, 4.0)  # of the new control points, times the least depth
_SMALLEST, _LARGEST = 0.05, 0.5  # sqrt(k) of a new control point, times its depth
_STEEPEST = 1e6  # change of a distance with k, in working lengths, of a place too near to a surface point
_MOST_OFFSET = 0.05  # that a control point moves to make up for those taken away


@compiled(error_model="numpy")
def solve_lower(factor: np.ndarray, columns: np.ndarray) -> None:
    """Solve factor x = columns in place, 32 columns at a time."""
    size, total = columns.shape
    part = np.empty((size, 32))
    for start in range(0, total, 32):
        count = min(32, total - start)
        for i in range(size):
            row = part[i]
            for c in range(count):
                row[c] = columns[i, start + c]
            for p in range(i):
                times, other = factor[i, p], part[p]
                for c in range(32):
                    row[c] -= times * other[c]
            for c in range(32):
                row[c] /= factor[i, i]
            for c in range(count):
                columns[i, start + c] = row[c]


def solve(
    matrix: np.ndarray, damping: np.ndarray, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Cholesky factor, solution of (matrix + damping) x = -force, and the damping that it took."""
    factor, step = np.zeros_like(matrix), np.empty_like(force)
    # Sums in single precision can leave the matrix a shade short of positive definite.
    for _ in range(12):
        if solve_damped(matrix, damping, force, factor, step):
            return factor, step, damping
        damping = 10 * damping
    raise FitError(
        "The equations of the search cannot be solved: check that control points and voxels are finite."
    )


def relocate(search: Refinement, count: int, rng: np.random.Generator) -> None:
    """Take the `count` least useful control points of a search away and place as many anew.

    Parameters
    ----------
    search : Refinement
        Changed in place; the sum of squares can rise until the next steps have settled it.
    count : int
    rng : numpy.random.Generator
        Chooses the surface points below which new control points are tried.
    """
    control = without_the_least_useful(search, count)
    rows = search.surface_rows_at(control)
    places = candidates(search, rows.points, rows.residual, _PLACES, rng)
    search.set_control(np.hstack([control, most_useful(search, rows, control, places, count)[0]]))


def without_the_least_useful(search: Refinement, count: int) -> Float64[np.ndarray, "4 n"]:
    """Return the control points of a search but for `count`, the others moved to make up for them."""
    matrix, _ = search.linearise()
    n = search.control.shape[1]
    diagonal = np.diagonal(matrix)
    damping = 1e-5 * diagonal + 1e-6 * diagonal.mean()
    factor, _, damping = solve(matrix, damping, np.zeros(4 * n))
    # The inverse's block of the ln k is the Gram matrix of these columns.
    columns = np.zeros((4 * n, n))
    np.fill_diagonal(columns, 1.0)
    solve_lower(factor, columns)
    dropped: list[int] = []
    left = columns.copy()
    for _ in range(count):
        uselessness = np.square(left).sum(axis=0)
        uselessness[dropped] = 0
        i = int(uselessness.argmax())
        dropped.append(i)
        direction = left[:, i] / np.sqrt(uselessness[i])
        left -= direction[:, None] * (left * direction[:, None]).sum(axis=0)
    # The least change of the others that makes up for ln k falling by 1, the first-order image of k = 0.
    inverse = np.array([(columns[:, dropped] * columns[:, [i]]).sum(axis=0) for i in dropped])
    force = np.zeros(4 * n)
    force[dropped] = np.linalg.solve(inverse, np.ones(count))
    _, step, _ = solve(matrix, damping, force)
    moved = search.control.copy()
    moved[3] *= np.exp(np.clip(step[:n], -0.3, 0.3))
    moved[:3] += np.clip(step[n:].reshape(3, n), -_MOST_OFFSET, _MOST_OFFSET)
    search.keep_deep(moved)
    return np.delete(moved, dropped, axis=1)


def most_useful(
    search: Refinement,
    rows_at: SurfaceRows,
    control: Float64[np.ndarray, "4 n"],
    places: Float64[np.ndarray, "3 t"],
    count: int,
) -> tuple[Float64[np.ndarray, "4 c"], Float64[np.ndarray, "c"]]:
    """Return the new control points that lower the sum of squares most, and by how much each does.

    Parameters
    ----------
    search : Refinement
        Tells how deep places lie.
    rows_at : SurfaceRows
        The rows that are to be lowered.
    control : float array, shape (4, n)
        Control points that stand nearby: what they can do by themselves needs no new one.
    places : float array, shape (3, t)
        Where a new one may come.
    count : int
        New ones at most.
    """
    points, residual, slope = rows_at
    n, m, tried = control.shape[1], len(residual), places.shape[1]
    rows = np.zeros((4 * n + tried + (-tried) % 4, m), dtype=np.float32)
    jacobian_of_rows(points, control.astype(np.float32), slope, rows[: 4 * n])
    unit = np.vstack([places, np.full(tried, 1.0)]).astype(np.float32)
    by_weight = np.empty((4 * tried, m), dtype=np.float32)
    jacobian_of_rows(points, unit, slope, by_weight)
    # In a groove the place below one wall may lie on the other: nothing is to be gained there.
    by_weight[:tried][~(np.abs(by_weight[:tried]).max(axis=1) < _STEEPEST)] = 0.0
    rows[4 * n : 4 * n + tried] = by_weight[:tried]
    matrix, gradient = np.zeros((len(rows), len(rows))), np.zeros(len(rows))
    add_normal_matrix(rows, residual, matrix, gradient)
    old = np.ascontiguousarray(matrix[: 4 * n, : 4 * n])
    diagonal = np.diagonal(old)
    damping = 1e-3 * diagonal + 1e-4 * diagonal.mean()
    factor, _, _ = solve(old, damping, gradient[: 4 * n])
    shared = np.ascontiguousarray(
        np.hstack([matrix[4 * n : 4 * n + tried, : 4 * n].T, gradient[: 4 * n, None]])
    )
    solve_lower(factor, shared)
    new_ones = slice(4 * n, 4 * n + tried)
    gram, down = _symmetric(matrix[new_ones, new_ones]), gradient[new_ones].copy()
    own = np.diagonal(gram).copy()
    taken, taken_down = _products(shared[:, :tried].T, shared[:, tried])
    gram -= taken
    down -= taken_down
    chosen, gains = _pursue(gram.copy(), down.copy(), own, count)
    weights = -np.linalg.solve(gram[np.ix_(chosen, chosen)], down[chosen])
    depth = search.depth_of(places[:, chosen])
    weights = np.clip(weights, (_SMALLEST * depth) ** 2, (_LARGEST * depth) ** 2)
    return np.vstack([places[:, chosen], weights]), gains


def _symmetric(lower: np.ndarray) -> np.ndarray:
    symmetric: np.ndarray = np.tril(lower) + np.tril(lower, -1).T
    return symmetric


def _products(rows: np.ndarray, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows rows^T and rows vector; not by a matrix product, whose rounding could depend on threads."""
    padded = np.zeros((len(rows) + (-len(rows)) % 4, rows.shape[1]))
    padded[: len(rows)] = rows
    matrix, product = np.zeros((len(padded), len(padded))), np.zeros(len(padded))
    add_normal_matrix(padded, vector.copy(), matrix, product)
    return _symmetric(matrix[: len(rows), : len(rows)]), product[: len(rows)]


def candidates(
    search: Refinement, points: np.ndarray, residual: np.ndarray, most: int, rng: np.random.Generator
) -> np.ndarray:
    """Return places (rows x, y, z) below surface points, chosen the likelier the farther they lie off.

    Parameters
    ----------
    search : Refinement
    points, residual : float32 arrays, shapes (3, m) and (m,)
    most : int
        Surface points that are chosen; below each there are places at several depths.
    rng : numpy.random.Generator
    """
    share = np.square(residual, dtype=np.float64) + 1e-16
    chosen = rng.choice(
        len(residual), min(most, len(residual)), replace=False, p=share / share.sum(), shuffle=False
    )
    tried = []
    for times in _DEPTHS:
        surface = points[:, chosen].astype(np.float64)
        places, depth = surface.copy(), np.full(len(chosen), times * search.soft_depth)
        push_in(search.prepared, places, depth, surface)
        tried.append(places[:, search.depth_of(places) > 0.9 * search.hard_depth])
    return np.hstack(tried)


def _pursue(gram: np.ndarray, down: np.ndarray, own: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the candidates that lower the sum of squares most, one after the other, with k > 0.

    Parameters
    ----------
    gram, down : float arrays, shapes (t, t) and (t,)
        Normal matrix and gradient of the candidates, less what the control points there are can do; both are
        used up.
    own : float array, shape (t,)
        Diagonal of the matrix before that.
    count : int

    Returns
    -------
    chosen : int array
        At most `count` of the candidates.
    gains : float array
        By how much each lowers twice the sum of squares' half, with those before it there.
    """
    chosen: list[int] = []
    gains: list[float] = []
    for _ in range(count):
        left = np.diagonal(gram)
        usable = (down < 0) & (left > 1e-3 * own)
        usable[chosen] = False
        if not usable.any():
            break
        gain = np.where(usable, down**2 / np.maximum(left, 1e-30), -1.0)
        best = int(gain.argmax())
        chosen.append(best)
        gains.append(float(gain[best]))
        column = gram[:, best] / gram[best, best]
        down -= column * down[best]
        gram -= column[:, None] * gram[best]
    return np.array(chosen, dtype=int), np.array(gains)
