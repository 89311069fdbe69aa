"""Which control points are joined by straight lines within the solid f >= 1.

Such a line proves that both lie in one piece, however thin it is: no grid is needed to find it.
"""

from __future__ import annotations

import numpy as np

from mbstudio.core.compiled import compiled


@compiled()
def group_root(parent: np.ndarray, i: int) -> int:
    """Return the group of i in a disjoint-set forest, and shorten the way to it."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@compiled(error_model="numpy")
def lowest_between(control: np.ndarray, a: int, b: int, samples: int, enough: float) -> float:
    """Return the lowest f on the line between control points a and b; any value below `enough` does."""
    lowest = np.inf
    for step in range(1, samples):
        t = step / samples
        x = control[0, a] + t * (control[0, b] - control[0, a])
        y = control[1, a] + t * (control[1, b] - control[1, a])
        z = control[2, a] + t * (control[2, b] - control[2, a])
        total = 0.0
        for i in range(control.shape[1]):
            dx, dy, dz = x - control[0, i], y - control[1, i], z - control[2, i]
            total += control[3, i] / max(dx * dx + dy * dy + dz * dz, 1e-300)
        lowest = min(lowest, total)
        if lowest < enough:
            return lowest
    return lowest


@compiled(error_model="numpy")
def nearest_link(control: np.ndarray, piece: np.ndarray, samples: int) -> tuple[int, int, float]:
    """Return the two control points of different pieces nearest to joined, and the lowest f between."""
    best, at_a, at_b = -1.0, -1, -1
    for a in range(control.shape[1]):
        for b in range(a):
            if piece[a] == piece[b]:
                continue
            lowest = lowest_between(control, a, b, samples, best)
            if lowest > best:
                best, at_a, at_b = lowest, a, b
    return at_a, at_b, best


@compiled()
def join_by_lines(control: np.ndarray, parent: np.ndarray, samples: int) -> None:
    """Join control points of different groups where the line between them stays in the solid."""
    n = control.shape[1]
    for a in range(n):
        for b in range(a):
            ra, rb = group_root(parent, a), group_root(parent, b)
            if ra != rb and lowest_between(control, a, b, samples, 1.0) >= 1.0:
                parent[max(ra, rb)] = min(ra, rb)
    for a in range(n):
        parent[a] = group_root(parent, a)
