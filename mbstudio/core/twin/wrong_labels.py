"""Grains whose labels are probably wrong, as their twin tells: several grains in one, or a part of one."""

from __future__ import annotations

import pandas as pd

from mbstudio.core.grains.suspicion.scoring import BORDERLINE
from mbstudio.core.grains.suspicion.suspects import Suspect
from mbstudio.core.twin.contacts import TOUCHING
from mbstudio.core.twin.kept_fits import MOST_BURIED, usual_limits
from mbstudio.core.twin.kept_twin import KeptTwin

MOST_OVERLAP = 0.5
"""Voxels: two grains whose labels are right do not lie so deep in each other."""
_MOST_OF_MOVED = 0.45
"""Score that a surface that still moves can lead to by itself: it does not say what is wrong."""


def suspects_of_twin(twin: KeptTwin) -> dict[int, Suspect]:
    """Return the grains that a twin makes suspicious, by label.

    A grain that lies half a voxel deep in another one, or is buried in others by more than 15 % of its
    surface, is probably a part of that one, or of the one with which it shares the largest contact: merging
    the two is proposed. One that the scan differs from by more than is usual in it is probably several:
    splitting is proposed. A mineral looks the same, so that a person must decide. One whose surface still
    moves is doubtful.

    Parameters
    ----------
    twin : KeptTwin

    Returns
    -------
    dict of int to Suspect
        Scores are 0.3 at the limit, and higher the farther beyond it a grain is.
    """
    limits = usual_limits(twin.residuals)
    found = {}
    for row in twin.residuals.to_dict("records"):
        label = int(row["label"])
        depth, deepest, largest = _contacts_of(twin.contacts, label, twin.voxel)
        buried, overlap = _score(row["buried"], MOST_BURIED), _score(depth, MOST_OVERLAP)
        peak = _score(row["peak"], float(limits["peak"]))
        moved = min(_score(row["moved"], float(limits["moved"])), _MOST_OF_MOVED)
        if not max(buried, overlap, peak, moved):
            continue
        neighbour = deepest if overlap else largest if buried else 0
        kind = "split" if neighbour else "merged"
        reasons = []
        if overlap:
            reasons.append(f"it lies {depth:.1f} voxels deep in grain {deepest}")
        if buried:
            reasons.append(f"{100 * row['buried']:.0f} % of the surface lies in other grains")
        if peak:
            reasons.append(f"the scan differs from it by {row['peak']:.2f} of the contrast")
        if moved:
            reasons.append("its surface still moved in the last sweep")
        score = max(buried, overlap, peak, moved)
        found[label] = Suspect(label, score, kind, neighbour, ", ".join(reasons))
    return found


def more_suspicious(one: Suspect, other: Suspect | None) -> Suspect:
    """Return the one of two verdicts on a grain that is the more suspicious."""
    return one if other is None or one.score >= other.score else other


def _score(value: float, limit: float) -> float:
    """Return 0 up to a limit, the borderline at it, and ever nearer to 1 beyond."""
    return 1.0 - (1.0 - BORDERLINE) * limit / value if value > limit else 0.0


def _contacts_of(contacts: pd.DataFrame, label: int, voxel: float) -> tuple[float, int, int]:
    """Return how deep (voxels) a grain lies in another, in which, and with which its contact is largest.

    Numbers are 0 where there is none.
    """
    mine = contacts[(contacts["a"] == label) | (contacts["b"] == label)]
    mine = mine[mine["gap"] <= TOUCHING * voxel]
    if not len(mine):
        return 0.0, 0, 0
    others = mine["a"].where(mine["a"] != label, mine["b"])
    deep, large = mine["gap"].idxmin(), mine["area"].idxmax()
    return -float(mine["gap"][deep]) / voxel, int(others[deep]), int(others[large])
