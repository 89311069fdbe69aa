"""How the grains of a specimen touch as a whole: coordination numbers and fabric tensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Float64

from mbstudio.core.errors import TwinError
from mbstudio.core.fabric import anisotropy

LEAST_PROBABILITY = 0.5
_DRAWS = 400


@dataclass(frozen=True, eq=False)
class FabricTensor:
    """The mean of n n^T over directions.

    Attributes
    ----------
    tensor : float array, shape (3, 3)
        Symmetric (x, y, z), of trace 1.
    values : float array, shape (3,)
        Principal values, descending.
    directions : float array, shape (3, 3)
        Principal directions, one a row.
    anisotropy : float
        ``sqrt(3/2 D:D)`` of ``D = 15/2 (F - I/3)``: 0 where no direction is preferred.
    anisotropy_interval : tuple of float
        Within which it lies with 95 %, by drawing the directions again and again.
    half_width : float array, shape (3, 3)
        Half of the interval in which each number of the tensor lies with 95 %, likewise.
    count : int
        Directions.
    """

    tensor: Float64[np.ndarray, "3 3"]
    values: Float64[np.ndarray, "3"]
    directions: Float64[np.ndarray, "3 3"]
    anisotropy: float
    anisotropy_interval: tuple[float, float]
    count: int
    half_width: Float64[np.ndarray, "3 3"]


@dataclass(frozen=True, eq=False)
class Fabric:
    """Coordination numbers and fabric tensors of a table of contacts.

    Attributes
    ----------
    coordination : mapping of int to int
        Contacts of each grain, by label; of grains at the border only those that are seen.
    mean_coordination : float
        Of the grains that the border does not cut; NaN where there is none.
    normal, branch : FabricTensor
        Of the contacts' normals, and of the directions of the branch vectors.
    contacts : int
    long_axis : FabricTensor or None
        Of the grains' longest axes, where they are known.
    """

    coordination: dict[int, int]
    mean_coordination: float
    normal: FabricTensor
    branch: FabricTensor
    contacts: int
    long_axis: FabricTensor | None = None


def fabric_tensor(directions: Float64[np.ndarray, "m 3"], seed: int = 0) -> FabricTensor:
    """Return the fabric tensor of directions of any length.

    Raises
    ------
    TwinError
        If there is none.
    """
    if not len(directions):
        raise TwinError("There is no contact: a fabric needs one or more.")
    unit = directions / np.linalg.norm(directions, axis=1)[:, None]
    dyads = unit[:, :, None] * unit[:, None, :]
    tensor = dyads.mean(axis=0)
    values, vectors = np.linalg.eigh(tensor)
    drawn = np.random.default_rng(seed).integers(len(unit), size=(_DRAWS, len(unit)))
    again = np.array([dyads[rows].mean(axis=0) for rows in drawn])
    low, high = np.percentile(anisotropy(again), (2.5, 97.5))
    ends = np.percentile(again, (2.5, 97.5), axis=0)
    return FabricTensor(
        tensor, values[::-1].copy(), vectors.T[::-1].copy(), float(anisotropy(tensor)),
        (float(low), float(high)), len(unit), 0.5 * (ends[1] - ends[0]),
    )  # fmt: skip


def measure_fabric(
    contacts: pd.DataFrame,
    labels: list[int],
    cut: frozenset[int] = frozenset(),
    *,
    least_probability: float = LEAST_PROBABILITY,
    seed: int = 0,
) -> Fabric:
    """Return coordination numbers and fabric tensors.

    Parameters
    ----------
    contacts : pandas.DataFrame
        As a twin or :func:`~mbstudio.core.twin.label_contacts.contacts_of_labels` has it.
    labels : list of int
        All grains, also those without a contact.
    cut : frozenset of int
        Those that the border cuts: they have contacts that are not seen.
    least_probability : float
        From which a pair counts as a contact.
    seed : int
        Of the draws for the intervals.

    Raises
    ------
    TwinError
        If no pair is a contact.
    """
    touching = contacts[contacts["probability"] >= least_probability]
    coordination = dict.fromkeys(labels, 0)
    for column in ("a", "b"):
        for label in touching[column].tolist():
            coordination[label] += 1
    whole = [number for label, number in coordination.items() if label not in cut]
    return Fabric(
        coordination, float(np.mean(whole)) if whole else float("nan"),
        fabric_tensor(touching[["nx", "ny", "nz"]].to_numpy(float), seed),
        fabric_tensor(touching[["branch_x", "branch_y", "branch_z"]].to_numpy(float), seed), len(touching),
    )  # fmt: skip
