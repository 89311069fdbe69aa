"""Intervals of the factors of a scanned grain: what its voxels leave open."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Shaped

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.metrics.bodies import VoxelSurface, default_surface
from mbstudio.core.metrics.detail import measure_detail
from mbstudio.core.metrics.measuring import AxisConvention, measure
from mbstudio.core.metrics.perturbation import (
    GreyField,
    blurred_grain,
    field_of_grey,
    field_of_mask,
    shifted_grains,
    threshold_grains,
)
from mbstudio.core.metrics.shape_factors import CORE_FACTORS, DETAILED_FACTORS, DetailedFactors, ShapeFactors

_SPREADS = 2.0
"""Standard deviations of the shifted copies on either side."""
_UNDONE = 2.0
"""How often the loss that smoothing once more brings is undone, where the smoothed surface is measured."""
_UNSMOOTHED = {"crofton": ("volume", "area", "dn", "sphericity"), "smoothed": ("volume", "dn")}
"""Found without the smoothed surface, by how the area is found."""
_SIZES = (
    "volume", "area", "dn", "ds", "shortest", "intermediate", "longest",
    "inscribed", "enclosing", "feret_min", "feret_mid", "feret_max",
)  # fmt: skip

# What copies of one mask cannot show, in voxel edges over D_n, of the value (sizes) or as such (ratios): set
# on every second of a set of real aggregates at 30, 60 and 120 voxels across, to hold 95 % of their factors.
_ANY_AXES = {
    "volume": 0.02, "area": 0.02, "dn": 0.02, "sphericity": 0.02,
    "circularity": 0.3, "ds": 0.2, "dns": 0.15,
}  # fmt: skip
_AXES = {
    "obb": {
        "shortest": 1.5, "intermediate": 1.2, "longest": 1.2, "csf": 1.1, "krumbein": 0.6,
        "sneed_folk": 0.75, "elongation": 0.9, "flatness": 1.05,
        "potticary_elongation": 0.55, "potticary_flatness": 0.8,
        "angelidakis_elongation": 0.55, "angelidakis_flatness": 0.8,
    },
    "feret": {
        "shortest": 1.2, "intermediate": 2.2, "longest": 0.75, "csf": 0.9, "krumbein": 0.45,
        "sneed_folk": 0.6, "elongation": 1.5, "flatness": 1.2,
        "potticary_elongation": 0.6, "potticary_flatness": 0.8,
        "angelidakis_elongation": 0.75, "angelidakis_flatness": 0.8,
    },
}  # fmt: skip
"""Half as much again as 95 % of the tuning grains needed: touching corners change from grain to grain."""
_INERTIA = 0.05
_DETAIL = {
    "convexity": 0.75, "inscribed": 1.0, "enclosing": 0.7, "sheppard": 0.8, "feret_min": 1.0,
    "feret_mid": 2.0, "feret_max": 0.6, "roundness": 0.1, "roughness": 0.1,
}  # fmt: skip


@dataclass(frozen=True)
class FactorIntervals:
    """Factors of a scanned grain with the interval in which the true body's lie.

    Attributes
    ----------
    factors : ShapeFactors
        As `measure` gives them.
    detailed : DetailedFactors or None
        As `measure_detail` gives them, if asked for.
    intervals : mapping of str to (float, float)
        Lower and upper end of each factor, in the same units; the value lies between them.
    source : str
        'mask' or 'grey': what the copies were made from.
    """

    factors: ShapeFactors
    detailed: DetailedFactors | None
    intervals: Mapping[str, tuple[float, float]]
    source: str


def factor_intervals(
    grain: Grain,
    *,
    unit: str | None = None,
    axes: AxisConvention = "obb",
    surface: VoxelSurface | None = None,
    grey: Shaped[np.ndarray, "z y x"] | None = None,
    threshold: float | None = None,
    step: float | None = None,
    detail: bool = False,
) -> FactorIntervals:
    """Return the factors of a scanned grain, each with an interval.

    Parameters
    ----------
    grain : Grain
    unit, axes, surface
        As in `measure`.
    grey : array, shape (Z + 2 m, Y + 2 m, X + 2 m), optional
        The scan's grey values about the grain's bounding box, with a margin of m >= 2 voxels. Without it
        the grain's picture is its mask, smoothed.
    threshold : float, optional
        The grey value that the mask was made with; needed with `grey`.
    step : float, optional
        Uncertainty of the threshold: in grey values with `grey`, else of the contrast; by
        default 1 % of the contrast.
    detail : bool
        The detailed factors too.

    Notes
    -----
    The grain is measured again at four sub-voxel shifts, at a threshold one step lower and higher, and
    blurred by half a voxel. The interval spans the value, the thresholds' values, the value with the blur's
    effect undone, and, for what is measured on the smoothed surface, the value with twice the
    loss undone that smoothing and sampling it again brought; it is wider on both sides by two standard
    deviations of the shifted copies, joined with a share of a voxel. The latter was set on real
    aggregates so that 95 % of their factors were held; docs/shape-factors.md shows how often those of others
    are.

    Raises
    ------
    MeasureError
        As `measure`; if the grain vanishes under a change of a fraction of a voxel; or if grey values and
        threshold do not fit the mask.
    """
    if (grey is None) != (threshold is None):
        raise MeasureError("Grey values and their threshold belong together: give both or none.")
    surface = surface or default_surface(grain)
    found = measure(grain, unit=unit, axes=axes, surface=surface)
    extra = measure_detail(grain, unit=unit) if detail else None
    if grey is None or threshold is None:
        field = field_of_mask(grain, step)
    else:
        field = field_of_grey(grain, grey, float(threshold), step)

    def numbers(copy: Grain) -> dict[str, float]:
        values = _named(measure(copy, unit=unit, axes=axes, surface=surface), CORE_FACTORS)
        return values | (_named(measure_detail(copy, unit=unit), DETAILED_FACTORS) if detail else {})

    copies = _Copies(numbers, field, _UNSMOOTHED[surface])
    values = _named(found, CORE_FACTORS) | ({} if extra is None else _named(extra, DETAILED_FACTORS))
    voxel = max(grain.voxel_size.zyx) / grain.nominal_diameter
    unsettled = _unsettled(axes)
    intervals = {
        name: copies.interval(name, value, voxel * unsettled[name] * (value if name in _SIZES else 1.0), axes)
        for name, value in values.items()
    }
    return FactorIntervals(found, extra, MappingProxyType(intervals), "mask" if grey is None else "grey")


class _Copies:
    """The numbers of all perturbed copies of one grain."""

    def __init__(
        self, numbers: Callable[[Grain], dict[str, float]], field: GreyField, unsmoothed: tuple[str, ...]
    ) -> None:
        self._unsmoothed = unsmoothed
        self.shifted = [numbers(copy) for copy in shifted_grains(field)]
        self.thresholds = [numbers(copy) for copy in threshold_grains(field)]
        self.blurred = numbers(blurred_grain(field))

    def interval(self, name: str, value: float, floor: float, axes: AxisConvention) -> tuple[float, float]:
        """Return the interval of one factor; see the notes of `factor_intervals`."""
        shifted = np.array([copy[name] for copy in self.shifted])
        smoothed = name not in self._unsmoothed and not (axes == "inertia" and name in _AXES["obb"])
        candidates = [value, 2.0 * value - self.blurred[name], *(copy[name] for copy in self.thresholds)]
        if smoothed:
            candidates.append(value - _UNDONE * float(shifted.mean() - value))
        half = float(np.hypot(_SPREADS * shifted.std(ddof=1), floor))
        return _within_bounds(name, float(min(candidates)) - half, float(max(candidates)) + half, value)


def _within_bounds(name: str, low: float, high: float, value: float) -> tuple[float, float]:
    """Cut an interval off at what the factor cannot be below or above; the value stays in it."""
    highest = np.inf if name in _SIZES or name in ("dns", "roughness") else 1.0
    return min(value, max(low, 0.0)), max(value, min(high, highest))


def _unsettled(axes: AxisConvention) -> dict[str, float]:
    by_axes = _AXES[axes] if axes in _AXES else dict.fromkeys(_AXES["obb"], _INERTIA)
    return _ANY_AXES | by_axes | _DETAIL


def _named(record: ShapeFactors | DetailedFactors, names: tuple[str, ...]) -> dict[str, float]:
    return {name: float(getattr(record, name)) for name in names}
