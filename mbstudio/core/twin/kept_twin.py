"""What a project keeps of a twin: all avatars where they lie in the scan, their contacts, and the fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
import pandas as pd
from jaxtyping import Float64

from mbstudio.core.errors import TwinError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.twin.contacts import COLUMNS
from mbstudio.core.twin.fabric import LEAST_PROBABILITY, Fabric, fabric_tensor, measure_fabric
from mbstudio.core.twin.middles import longest_axis, middle_of_volume
from mbstudio.core.twin.porosity import Porosity
from mbstudio.core.units import conversion_factor

_LENGTHS = ("x", "y", "z", "gap", "gap_deviation", "branch_x", "branch_y", "branch_z")


@dataclass(frozen=True, eq=False)
class KeptTwin:
    """A twin without its scan.

    Attributes
    ----------
    avatars : mapping of int to Avatar
        By label, over the scan; those of grains that the border cuts among them.
    contacts : pandas.DataFrame
        A row a pair of grains that touch or nearly do; see
        :func:`~mbstudio.core.twin.contacts.contact_table`.
    residuals : pandas.DataFrame
        A row a grain; see :func:`~mbstudio.core.twin.residuals.residual_table`.
    unit : str
        Of all lengths but those of `residuals`, which are voxels.
    voxel : float
        Edge of a cube of a voxel's volume.
    blur : float
        Standard deviation of point spread and voxel together.
    noise : float
        Standard deviation in the grains, in contrasts.
    tone_model, void_model : str
        What the scan called for: 'constant' or 'linear', 'constant' or 'quadratic'.
    misfits : tuple of float
        Root mean square residual near a grain's surface at the start and after each sweep, median of the
        grains, in contrasts.
    porosity : Porosity
        What has no avatar counts as pore.
    notes : tuple of str
        What is to be minded about the scan.
    seed : int
    """

    avatars: Mapping[int, Avatar]
    contacts: pd.DataFrame
    residuals: pd.DataFrame
    unit: str
    voxel: float
    blur: float
    noise: float
    tone_model: str
    void_model: str
    misfits: tuple[float, ...]
    porosity: Porosity
    notes: tuple[str, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        missing = [name for name in COLUMNS if name not in self.contacts]
        if missing:
            raise TwinError(f"A table of contacts has no column {missing[0]}.")
        known = set(self.avatars)
        if set(self.residuals["label"].tolist()) != known:
            raise TwinError("The residuals of a twin are not those of its avatars.")
        if not set(self.contacts["a"].tolist()) | set(self.contacts["b"].tolist()) <= known:
            raise TwinError("The contacts of a twin name grains without an avatar.")

    @property
    def touching(self) -> pd.DataFrame:
        """The pairs that are contacts most probably."""
        return self.contacts[self.contacts["probability"] >= LEAST_PROBABILITY]

    @property
    def cut(self) -> frozenset[int]:
        """Labels of the grains that the border cuts."""
        return frozenset(self.residuals.loc[self.residuals["touches_border"], "label"].tolist())

    @cached_property
    def middles(self) -> Mapping[int, Float64[np.ndarray, "3"]]:
        """The middle of each avatar's volume (x, y, z) in the scan's unit, by label."""
        return MappingProxyType(
            {label: middle_of_volume(avatar.control) for label, avatar in self.avatars.items()}
        )

    @cached_property
    def long_axes(self) -> Mapping[int, Float64[np.ndarray, "3"]]:
        """The direction in which each grain is longest, by label; those that the border cuts left out."""
        cut = self.cut
        return MappingProxyType(
            {label: longest_axis(one.control) for label, one in self.avatars.items() if label not in cut}
        )

    def fabric(self, seed: int = 0) -> Fabric:
        """Return coordination numbers and fabric tensors of the contacts.

        Raises
        ------
        TwinError
            If no pair of grains is a contact.
        """
        found = measure_fabric(self.contacts, list(self.avatars), self.cut, seed=seed)
        axes = self.long_axes
        return replace(found, long_axis=fabric_tensor(np.array(list(axes.values())), seed) if axes else None)

    def scaled(self, unit: str, factor: float) -> KeptTwin:
        """Return the twin of the same scan with another voxel size.

        Parameters
        ----------
        unit : str
            Of that size.
        factor : float
            By which lengths are multiplied, taken in one unit.
        """
        scale = factor * conversion_factor(self.unit, unit)
        contacts = self.contacts.copy()
        contacts[list(_LENGTHS)] *= scale
        contacts["area"] *= scale**2
        avatars = {
            label: replace(
                avatar, centers=avatar.centers * scale, weights=avatar.weights * scale**2, unit=unit
            )
            for label, avatar in self.avatars.items()
        }
        return replace(
            self, avatars=MappingProxyType(avatars), contacts=contacts, unit=unit, voxel=self.voxel * scale,
            blur=self.blur * scale,
        )  # fmt: skip
