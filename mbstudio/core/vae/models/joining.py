"""Decoded control points kept in one body: none stands so far out that it would be a drop of its own.

A decoder makes control points from sums of what parents have, and where two parents disagree about a
control point far out on a corner, the sum can leave it just outside the reach of the others. Principal
components and networks know nothing of that; this condition on what they give back does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbstudio.core.compiled import compiled
from mbstudio.core.metaball.lines import join_by_lines, lowest_between, nearest_link
from mbstudio.core.metaball.topology import topology
from mbstudio.core.vae.serialize.serialization import Serialization

_SAMPLES = 64
_ENOUGH = 1.02
_HALVINGS = 12


@compiled(error_model="numpy")
def _heaviest(control: np.ndarray, group: np.ndarray) -> np.intp:
    weights = np.zeros(len(group))
    for i in range(len(group)):
        weights[group[i]] += control[3, i]
    return weights.argmax()


@compiled(error_model="numpy")
def _groups_by_lines(control: np.ndarray) -> np.ndarray:
    group = np.arange(control.shape[1])
    join_by_lines(control, group, _SAMPLES)
    return group


@compiled(error_model="numpy")
def _draw_in(control: np.ndarray, group: np.ndarray) -> None:
    """Draw groups of control points to the heaviest one, each just as far as joins it."""
    n = control.shape[1]
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


def hold_together(avatars: Serialization) -> Serialization:
    """Return the avatars with every control point in one body.

    A group of control points whose body is a drop of its own is drawn in along the line on which it is
    nearest to joined, no farther than joins it. Avatars of one body come back as they are.

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
        # Straight lines in the body lead from each control point to every other in nearly all avatars;
        # in the others a grid has to tell, for a way may be bent.
        if _groups_by_lines(control).any():
            pieces = topology(control).piece_of_point
            if pieces.any():
                _draw_in(control, pieces.astype(np.int64))
                centers[i] = control[:3].T
                changed = True
    return replace(avatars, centers=centers) if changed else avatars
