"""Choosing from many candidates a subset whose statistics are given.

Each candidate is taken with a probability that departs as little as possible (least Kullback-Leibler
divergence) from an even draw while the expected sums over the subset are those asked for; the draw
itself then keeps these sums, not only on average.

References
----------
Hainmueller (2012), Entropy balancing for causal effects, Political Analysis 20, 25-46. Deville & Särndal
(1992), Calibration estimators in survey sampling, J. Am. Stat. Assoc. 87, 376-382 (the logit distance, which
keeps every probability below 1). Deville & Tillé (2004), Efficient balanced sampling: the cube method,
Biometrika 91, 893-912.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int

_MOST_ITERATIONS = 80
_MET = 1e-6
_DIVERGED = 1e4
_UNDECIDED = 1e-9


@dataclass(frozen=True, eq=False)
class Inclusion:
    """How probably each candidate is taken.

    Attributes
    ----------
    probabilities : float array, shape (candidates,)
        Of sum `count`, each below 1.
    effective : float
        sum(p)**2 / sum(p**2): so many candidates are really chosen among, from `count` (nothing is left to
        chance) up to the number of candidates (an even draw).
    converged : bool
        Whether the constraints are met as closely as asked.
    """

    probabilities: Float64[np.ndarray, " candidates"]
    effective: float
    converged: bool


def inclusion(
    rows: Float[np.ndarray, "candidates constraints"],
    count: int,
    *,
    log_odds: Float[np.ndarray, " candidates"] | None = None,
    softness: Float[np.ndarray, " constraints"] | float = 0.0,
) -> Inclusion:
    """Return the inclusion probabilities of sum `count` nearest to even ones that balance the rows.

    Parameters
    ----------
    rows : float array, shape (candidates, constraints)
        The weighted sum of each column is to be zero: a statistic of each candidate less what it is to be on
        average.
    count : int
        How many candidates will be taken, fewer than there are.
    log_odds : float array, shape (candidates,), optional
        Where the probabilities start from, up to a constant; even by default.
    softness : float or float array, shape (constraints,)
        0 asks for exactness. Above, a residual of this size costs as much as a change of the draw by half a
        nat per body taken: what would need an extreme choice is met in part.
    """
    rows = np.asarray(rows, dtype=np.float64)
    candidates, constraints = rows.shape
    scale = rows.std(axis=0)
    scale[scale <= 1e-12 * np.abs(rows).max(axis=0, initial=1e-300)] = 1.0
    design = np.column_stack([np.ones(candidates), rows / scale])
    base = np.zeros(candidates) if log_odds is None else np.asarray(log_odds, dtype=np.float64)
    base = base - base.max()
    penalty = np.concatenate([[0.0], np.broadcast_to(np.asarray(softness, dtype=float) ** 2, constraints)])
    wanted = np.zeros(1 + constraints)
    wanted[0] = count
    factors = np.zeros(1 + constraints)
    factors[0] = _offset_for_count(base, count)
    value = _dual(design, base, factors, wanted, penalty * count)
    for _ in range(_MOST_ITERATIONS):
        p = _sigmoid(base + design @ factors)
        slope = design.T @ p - wanted + penalty * count * factors
        if np.abs(slope).max() < 0.1 * _MET * count:
            break
        curvature = (design * (p * (1.0 - p))[:, None]).T @ design + np.diag(penalty * count)
        curvature[np.diag_indices_from(curvature)] += 1e-10 * count
        step = np.linalg.solve(curvature, slope)
        length = 1.0
        while length > 1e-8:
            trial = factors - length * step
            found = _dual(design, base, trial, wanted, penalty * count)
            if found <= value - 1e-4 * length * float(slope @ step):
                break
            length *= 0.5
        else:
            break
        factors, value = trial, found
        if np.abs(factors).max() > _DIVERGED:
            break
    p = _sigmoid(base + design @ factors)
    missed = (design.T @ p - wanted) / count
    converged = np.abs(missed + penalty * factors).max() < _MET
    return Inclusion(p, float(p.sum() ** 2 / max(np.square(p).sum(), 1e-300)), bool(converged))


def _offset_for_count(base: np.ndarray, count: int) -> float:
    """Return the constant to add to the log odds so that the probabilities sum to `count`."""
    low, high = -50.0 - base.max(), 50.0 - base.min()
    for _ in range(200):
        middle = 0.5 * (low + high)
        if _sigmoid(base + middle).sum() < count:
            low = middle
        else:
            high = middle
    root: float = 0.5 * (low + high)
    return root


def _sigmoid(x: np.ndarray) -> np.ndarray:
    values: np.ndarray = np.where(x >= 0, 1.0, np.exp(np.minimum(x, 0.0))) / (1.0 + np.exp(-np.abs(x)))
    return values


def _dual(
    design: np.ndarray, base: np.ndarray, factors: np.ndarray, wanted: np.ndarray, penalty: np.ndarray
) -> float:
    odds = base + design @ factors
    return float(np.logaddexp(0.0, odds).sum() - wanted @ factors + 0.5 * (penalty * factors) @ factors)


def draw_balanced(
    probabilities: Float[np.ndarray, " candidates"],
    rows: Float[np.ndarray, "candidates balanced"],
    rng: np.random.Generator,
) -> Int[np.ndarray, " taken"]:
    """Draw candidates without replacement, each with its probability, so that sums come out as expected.

    Parameters
    ----------
    probabilities : float array, shape (candidates,)
        Their sum, a whole number up to rounding, is how many are taken.
    rows : float array, shape (candidates, balanced)
        The sum of each column over the candidates taken is that expected, but for the last few candidates;
        the first columns are kept the longest.
    rng : numpy.random.Generator

    Returns
    -------
    int array, shape (taken,)
        Rising.

    Notes
    -----
    The flight phase of the cube method on one more candidate than there are columns at a time, the landing by
    giving up columns from the last.
    """
    p = np.clip(np.asarray(probabilities, dtype=np.float64), 0.0, 1.0).copy()
    count = round(float(p.sum()))
    scale = rows.std(axis=0) if len(rows) else np.ones(rows.shape[1])
    design = np.column_stack([np.ones(len(p)), rows / np.where(scale > 0, scale, 1.0)])
    order = rng.permutation(len(p))
    waiting = [int(i) for i in order if _UNDECIDED < p[i] < 1.0 - _UNDECIDED]
    waiting.reverse()
    columns = design.shape[1]
    working: list[int] = []
    while columns:
        while waiting and len(working) <= columns:
            working.append(waiting.pop())
        if not working:
            break
        if len(working) <= columns:
            columns = min(columns, len(working)) - 1  # landing: the last column is given up
            continue
        working = _flight(p, working, design[:, :columns], rng)
    for i in working:
        p[i] = round(p[i])
    taken = np.flatnonzero(p > 0.5)
    # What rounding left: with a whole sum there is nothing.
    if len(taken) > count:
        taken = np.sort(rng.permutation(taken)[:count])
    elif len(taken) < count:
        rest = np.setdiff1d(np.arange(len(p)), taken)
        best = rest[np.argsort(-np.asarray(probabilities)[rest], kind="stable")[: count - len(taken)]]
        taken = np.sort(np.concatenate([taken, best]))
    return taken


def _flight(p: np.ndarray, working: list[int], design: np.ndarray, rng: np.random.Generator) -> list[int]:
    """Move probabilities of the working candidates along a way that changes no sum until one is decided."""
    chosen = np.array(working)
    # The last column of the complete Q is at right angles to all others, so to all columns of the design.
    way = np.linalg.qr(design[chosen], mode="complete")[0][:, -1]
    now = p[chosen]
    with np.errstate(divide="ignore", invalid="ignore"):
        up = np.where(way > 0, (1.0 - now) / way, np.where(way < 0, -now / way, np.inf)).min()
        down = np.where(way > 0, now / way, np.where(way < 0, (now - 1.0) / way, np.inf)).min()
    # The longer of both ways is taken the more rarely, so that the expected probability stays.
    p[chosen] = np.clip(now + up * way if rng.random() < down / (up + down) else now - down * way, 0.0, 1.0)
    return [i for i in working if _UNDECIDED < p[i] < 1.0 - _UNDECIDED]
