"""How much of a scan its twin fills, as a whole and slice by slice."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from mbstudio.core.twin.body import render
from mbstudio.core.twin.sweeps import Sweeps


class Porosity(NamedTuple):
    """Pores over all voxels that were seen.

    Attributes
    ----------
    whole : float
    along_x, along_y, along_z : float array
        Of each slice across an axis; NaN where nothing was seen.
    """

    whole: float
    along_x: Float64[np.ndarray, "X"]
    along_y: Float64[np.ndarray, "Y"]
    along_z: Float64[np.ndarray, "Z"]


def porosity_of(run: Sweeps) -> Porosity:
    """Return the porosity of a twin; whatever has no avatar counts as pore.

    Where bodies overlap, or a voxel is shared, no more than the voxel is filled.
    """
    filled = np.zeros(run.model.shape, np.float32)
    for body in run.bodies:
        found = render(body, run.frame.spacing, body.blur)
        share = np.zeros(int(np.prod(body.shape)), np.float32)
        share[found.feet.places] = found.share
        share[found.feet.core] = 1.0
        filled[body.box] += share.reshape(body.shape)
    np.clip(filled, 0.0, 1.0, out=filled)
    filled[~run.seen] = 0.0
    profiles = []
    for axis in (2, 1, 0):
        others = tuple(other for other in range(3) if other != axis)
        solid, seen = filled.sum(axis=others, dtype=np.float64), run.seen.sum(axis=others)
        profiles.append(np.where(seen > 0, 1.0 - solid / np.maximum(seen, 1), np.nan))
    seen_voxels = max(int(np.count_nonzero(run.seen)), 1)
    whole = 1.0 - float(filled.sum(dtype=np.float64)) / seen_voxels
    return Porosity(whole, profiles[0], profiles[1], profiles[2])
