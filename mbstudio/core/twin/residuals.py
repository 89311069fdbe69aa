"""How well each body of a twin explains the scan: what tells wrong labels from right ones."""

from __future__ import annotations

import numpy as np
import pandas as pd
from jaxtyping import Float32
from scipy import ndimage

from mbstudio.core.twin.body import Body, render
from mbstudio.core.twin.sweeps import Sweeps

CONVERGED = 0.05
"""Voxels that a surface may still have moved in the last sweep, root mean square."""
_ON_SURFACE = 0.7  # voxels
_FILLED = 0.7  # of the tone, by other bodies


def residual_table(run: Sweeps) -> pd.DataFrame:
    """Return a row a grain.

    Parameters
    ----------
    run : Sweeps
        After its last step.

    Returns
    -------
    pandas.DataFrame
        Columns ``label``; ``n`` control points; ``rms`` of the residual near the surface, ``peak`` of the
        residual's means over 3 x 3 x 3 voxels (both in contrasts); ``buried`` share of the surface inside
        other bodies; ``moved`` in the last sweep and whether it has ``converged`` (in voxels); ``shift`` by
        which the surface lies off the labels' avatar, root mean square, in voxels; ``touches_border``;
        ``note``.
    """
    return pd.DataFrame([_row_of(run, body) for body in run.bodies])


def _row_of(run: Sweeps, body: Body) -> dict[str, object]:
    found = render(body, run.frame.spacing, body.blur)
    box, feet = body.box, found.feet
    rest = np.where(run.seen[box], run.grey[box] - run.model[box], 0.0)
    means = ndimage.uniform_filter(rest, 3, mode="nearest").ravel()
    mine = np.concatenate((feet.places, feet.core))
    others = run.model[box].ravel() - found.added
    near = np.abs(feet.distance) < _ON_SURFACE
    seen = run.seen[box].ravel()[feet.places]
    values = rest.ravel()[feet.places][seen]
    return {
        "label": body.label,
        "n": body.control.shape[1],
        "rms": float(np.sqrt(np.mean(values.astype(np.float64) ** 2))) if len(values) else 0.0,
        "peak": float(np.abs(means[mine]).max()) if len(mine) else 0.0,
        "buried": float(np.mean(others[feet.places[near]] > _FILLED)) if near.any() else 0.0,
        "moved": body.moved,
        "converged": body.moved <= CONVERGED,
        "shift": body.shift,
        "touches_border": body.touches_border,
        "note": body.note,
    }


def residual_volume(run: Sweeps) -> Float32[np.ndarray, "Z Y X"]:
    """Return scan less model in contrasts; 0 outside the field of view."""
    volume: np.ndarray = np.where(run.seen, run.grey - run.model, np.float32(0.0))
    return volume
