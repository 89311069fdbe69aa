"""A finished twin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from jaxtyping import Float32

from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.twin.levels import Levels
from mbstudio.core.twin.residuals import residual_volume
from mbstudio.core.twin.sweeps import Sweeps


@dataclass(frozen=True, eq=False)
class TwinResult:
    """All avatars of a scan, fitted together to its grey values.

    Attributes
    ----------
    avatars : mapping of int to Avatar
        By label, in the unit of the scan and over it; border grains among them.
    blur : float
        Standard deviation of point spread and voxel together, in the unit of the scan.
    levels : Levels
        Void level, tones, noise, and which models of void and tone the scan called for.
    residuals : pandas.DataFrame
        A row a grain; see :func:`~mbstudio.core.twin.residuals.residual_table`.
    contacts : pandas.DataFrame
        A row a pair of grains that touch or nearly do; see
        :func:`~mbstudio.core.twin.contacts.contact_table`.
    misfit_before, misfit : float
        Root mean square of scan less model near the surfaces, in contrasts: with the avatars as they
        started, and as they are.
    unit : str
    seed : int
    """

    avatars: Mapping[int, Avatar]
    blur: float
    levels: Levels
    residuals: pd.DataFrame
    contacts: pd.DataFrame
    misfit_before: float
    misfit: float
    unit: str
    seed: int
    _run: Sweeps = field(repr=False)

    def residual_volume(self) -> Float32[np.ndarray, "Z Y X"]:
        """Return scan less model in contrasts, voxel by voxel; 0 outside the field of view."""
        return residual_volume(self._run)
