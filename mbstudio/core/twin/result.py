"""A finished twin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import pandas as pd
from jaxtyping import Float32, Float64

from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.twin.fabric import Fabric, measure_fabric
from mbstudio.core.twin.kept_fits import fit_of_twin, usual_limits
from mbstudio.core.twin.kept_twin import KeptTwin
from mbstudio.core.twin.levels import Levels
from mbstudio.core.twin.middles import middle_of_volume
from mbstudio.core.twin.porosity import porosity_of
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
        Scan less model near a grain's surface, root mean square in contrasts, and the median of that over
        the grains: with the avatars as they started, and as they are.
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
    _fits: Mapping[int, FitResult] = field(repr=False)

    def residual_volume(self) -> Float32[np.ndarray, "Z Y X"]:
        """Return scan less model in contrasts, voxel by voxel; 0 outside the field of view."""
        return residual_volume(self._run)

    def fabric(self, seed: int = 0) -> Fabric:
        """Return coordination numbers and fabric tensors of the contacts.

        Raises
        ------
        TwinError
            If no pair of grains is a contact.
        """
        cut = frozenset(self.residuals.loc[self.residuals["touches_border"], "label"].tolist())
        return measure_fabric(self.contacts, list(self.avatars), cut, seed=seed)

    def kept(self) -> KeptTwin:
        """Return what a project keeps of it."""
        levels, run = self.levels, self._run
        return KeptTwin(
            MappingProxyType(dict(self.avatars)), self.contacts, self.residuals, self.unit, run.frame.edge,
            self.blur, levels.grain_noise / abs(levels.contrast), levels.tone_model, levels.void_model,
            tuple(run.misfits), porosity_of(run), levels.notes, self.seed,
        )  # fmt: skip

    def middles(self) -> dict[int, Float64[np.ndarray, "3"]]:
        """Return the middle of each avatar's volume (x, y, z) in the unit of the scan."""
        frame = self._run.frame
        return {
            body.label: frame.points_of(middle_of_volume(body.control)[None])[0] for body in self._run.bodies
        }

    def fits(self, grains: GrainSet) -> dict[int, FitResult]:
        """Return the avatars as fits, as a project keeps them, by label; those at the border left out.

        Parameters
        ----------
        grains : GrainSet
            That the twin was made of.
        """
        residuals, limits = self.residuals.set_index("label"), usual_limits(self.residuals)
        known, edge = self._fits, self._run.frame.edge
        return {
            label: fit_of_twin(
                avatar, grains.grain(label), residuals.loc[label], limits, known.get(label), edge
            )
            for label, avatar in self.avatars.items()
            if not residuals.loc[label, "touches_border"]
        }
