"""Decoded control points kept in one body: none stands so far out that it would be a drop of its own.

A decoder makes control points from sums of what parents have, and where two parents disagree about a
control point far out on a corner, the sum can leave it just outside the reach of the others. Principal
components and networks know nothing of that; this condition on what they give back does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit

from mbstudio.core.metaball.topology import join_by_lines, lowest_between, nearest_link
from mbstudio.core.vae.serialization import Serialization

_SAMPLES = 64
_ENOUGH = 1.02
_HALVINGS = 12


@njit(cache=True, nogil=True, error_model="numpy")
def _heaviest(control, group):  # pragma: no cover - compiled
    weights = np.zeros(len(group))
    for i in range(len(group)):
        weights[group[i]] += control[3, i]
    return weights.argmax()


@njit(cache=True, nogil=True, error_model="numpy")
def _draw_in(control):  # pragma: no cover - compiled
    """Draw groups of control points to the heaviest one, each just as far as joins it; True if any moved."""
    n = control.shape[1]
    group = np.arange(n)
    join_by_lines(control, group, _SAMPLES)
    moved = False
    for _ in range(n):
        main = _heaviest(control, group)
        apart = (group != main).astype(np.int64)
        if apart.sum() == 0:
            break
        a, b, _ = nearest_link(control, apart, _SAMPLES)
        if apart[a] == 0:
            a, b = b, a
        way = control[:3, b] - control[:3, a]
        drawn = group == group[a]
        before = control.copy()
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            share = 0.5 * (low + high)
            for i in range(n):
                if drawn[i]:
                    control[:3, i] = before[:3, i] + share * way
            if lowest_between(control, a, b, _SAMPLES, _ENOUGH) >= _ENOUGH:
                high = share
            else:
                low = share
        for i in range(n):
            if drawn[i]:
                control[:3, i] = before[:3, i] + high * way
                group[i] = main
        moved = True
    return moved


def held_together(avatars: Serialization) -> Serialization:
    """Return the avatars with every control point in one body.

    Control points are in one body if straight lines inside it lead from each to every other, from control
    point to control point. Those that are not are drawn, as a group, along the line on which they are
    nearest to joined, no farther than joins them. Avatars of one body come back as they are.

    Parameters
    ----------
    avatars : Serialization

    Notes
    -----
    The paper's loss knows no such condition; it is mbstudio's own.
    """
    centers = avatars.centers.copy()
    changed = False
    for i in range(len(avatars)):
        control = np.concatenate([avatars.centers[i].T, np.exp(avatars.log_weights[i])[None]])
        if _draw_in(control):
            centers[i] = control[:3].T
            changed = True
    return replace(avatars, centers=centers) if changed else avatars
