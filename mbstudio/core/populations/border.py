"""Grains that the border cuts are left out, and large ones are cut more often: the correction for that.

A grain whose box measures f_x, f_y, f_z lies wholly within a field of W_x, W_y, W_z with a probability in
proportion to (W_x - f_x) (W_y - f_y) (W_z - f_z). Each grain inside counts with the inverse (Miles 1974,
Lantuejoul 1980), so that large grains are not under-represented. In a round field of view the places are
counted at which the grain's box fits into it: a box fits less often than the grain itself, which overstates
the weights of large grains a little.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains.grain_set import GrainSet


def border_weights(grains: GrainSet, labels: Sequence[int]) -> Float[np.ndarray, " labels"]:
    """Return how many grains each of these stands for: 1 or more.

    Parameters
    ----------
    grains : GrainSet
        Of a scan: the field is what the scan has seen, its box or a cylinder in it.
    labels : sequence of int
        Grains that the border does not cut.

    Raises
    ------
    MeasureError
        If the grains are bodies of mesh files, a label is not there or cut by the border, or a grain
        fills the field along an axis.

    References
    ----------
    Miles (1974), On the elimination of edge effects in planar sampling, in Stochastic Geometry, Wiley,
    228-247.
    Lantuejoul (1980), On the estimation of mean values in individual analysis of particles, Microscopica
    Acta, Suppl. 4, 266-273.
    """
    if grains.is_of_meshes:
        raise MeasureError("No border cuts bodies of mesh files: their sizes need no correction.")
    table = grains.table.set_index("label")
    missing = [label for label in labels if label not in table.index]
    if missing:
        raise MeasureError(f"There is no grain {missing[0]}.")
    rows = table.loc[list(labels)]
    cut = rows.index[rows["touches_border"].to_numpy(dtype=bool)].tolist()
    if cut:
        raise MeasureError(
            f"The border cuts grain {cut[0]}: the correction is for grains that lie wholly inside. "
            "Leave out those that touch the border."
        )
    extents = np.stack([(rows[f"{axis}1"] - rows[f"{axis}0"]).to_numpy(dtype=int) for axis in "zyx"], axis=1)
    field, axis = _field_of(grains)
    # What does not touch the border keeps one voxel away from it.
    across = [place for place in range(3) if place != axis]
    length = grains.label_volume.shape[axis] - 2
    room = length - extents[:, axis] + 1
    places = _Places(field)
    fitting = np.array([places.count(a, b) for a, b in extents[:, across].tolist()])
    if ((room <= 0) | (fitting == 0)).any():
        label = int(rows.index[int(np.argmax((room <= 0) | (fitting == 0)))])
        raise MeasureError(
            f"Grain {label} fills the scan, so one cannot tell how many such are cut: scan a larger field."
        )
    weights: np.ndarray = (length / room) * (places.count(1, 1) / fitting)
    return weights


def _field_of(grains: GrainSet) -> tuple[Bool[np.ndarray, "a b"], int]:
    """Return the cross-section in which grains lie that the border does not touch, and the axis along it."""
    if grains.view is None:
        footprint, axis = np.ones(grains.label_volume.shape[1:], dtype=bool), 0
    else:
        footprint, axis = np.asarray(grains.view.footprint, dtype=bool), grains.view.axis
    inner = np.zeros_like(footprint)
    middle = footprint[1:-1, 1:-1]
    inner[1:-1, 1:-1] = (
        middle & footprint[:-2, 1:-1] & footprint[2:, 1:-1] & footprint[1:-1, :-2] & footprint[1:-1, 2:]
    )
    return inner, axis


class _Places:
    """Counts the places at which boxes fit into a cross-section."""

    def __init__(self, field: Bool[np.ndarray, "a b"]) -> None:
        self._sums = np.pad(field, ((1, 0), (1, 0))).astype(np.int64).cumsum(axis=0).cumsum(axis=1)
        self._known: dict[tuple[int, int], int] = {}

    def count(self, a: int, b: int) -> int:
        """Return at how many places a box of so many voxels fits."""
        if (a, b) not in self._known:
            sums = self._sums
            if a >= len(sums) or b >= len(sums[0]):
                return 0
            inside = sums[a:, b:] - sums[:-a, b:] - sums[a:, :-b] + sums[:-a, :-b]
            self._known[a, b] = int(np.count_nonzero(inside == a * b))
        return self._known[a, b]
