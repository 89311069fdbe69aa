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
from mbstudio.core.metrics.factor_table import FACTORS, Factor
from mbstudio.core.metrics.measuring import AxisConvention, measure
from mbstudio.core.metrics.perturbation import (
    GreyField,
    blur_grain,
    make_grey_field,
    make_mask_field,
    move_threshold,
    shift_grain,
)
from mbstudio.core.metrics.shape_factors import DetailedFactors, ShapeFactors
from mbstudio.core.metrics.voxel_surface import is_coarsely_sampled

_SPREADS = 2.0
"""Standard deviations of the shifted copies on either side."""
_UNDONE = 2.0
"""How often the loss that smoothing once more brings is undone, where the smoothed surface is measured."""
_INERTIA = 0.05
"""What copies of one mask cannot show of factors of the ellipsoid of equal inertia, as `Factor.left_open`."""


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
        Lower and upper end of each factor whose intervals were tried on known bodies, in the same units; the
        value lies between them.
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
    loss undone that smoothing and sampling it again brought. For area and sphericity of a grain of long
    voxels, or less than six of its longest edges thick, it also spans what the other surface gives. It is
    wider on both sides by two standard deviations of the shifted copies, joined with a share of a voxel. The
    latter was set on real aggregates so that 95 % of their factors were held; docs/shape-factors.md shows
    how often those of others are.

    Raises
    ------
    MeasureError
        As `measure`; if the grain vanishes under a change of a fraction of a voxel; or if grey values and
        threshold do not fit the mask.
    """
    if (grey is None) != (threshold is None):
        raise MeasureError("Give the grey values and their threshold, or neither.")
    surface = surface or default_surface(grain)
    found = measure(grain, unit=unit, axes=axes, surface=surface)
    extra = measure_detail(grain, unit=unit) if detail else None
    if grey is None or threshold is None:
        field = make_mask_field(grain, step)
    else:
        field = make_grey_field(grain, grey, float(threshold), step)

    def numbers(copy: Grain) -> dict[str, float]:
        return _collect_factors(
            measure(copy, unit=unit, axes=axes, surface=surface),
            measure_detail(copy, unit=unit) if detail else None,
        )

    others: dict[str, float] = {}
    if is_coarsely_sampled(grain):
        other = measure(
            grain, unit=unit, axes=axes, surface="crofton" if surface == "smoothed" else "smoothed"
        )
        others = {name: float(getattr(other, name)) for name in ("area", "sphericity")}
    copies = _Copies(numbers, field, surface, axes, others)
    voxel = max(grain.voxel_size.zyx) / grain.nominal_diameter
    intervals = {
        name: copies.interval(FACTORS[name], value, voxel)
        for name, value in _collect_factors(found, extra).items()
        if FACTORS[name].left_open is not None
    }
    return FactorIntervals(found, extra, MappingProxyType(intervals), "mask" if grey is None else "grey")


class _Copies:
    """The numbers of all perturbed copies of one grain."""

    def __init__(
        self,
        numbers: Callable[[Grain], dict[str, float]],
        field: GreyField,
        surface: VoxelSurface,
        axes: AxisConvention,
        others: Mapping[str, float],
    ) -> None:
        self._surface, self._axes, self._others = surface, axes, others
        self.shifted = [numbers(copy) for copy in shift_grain(field)]
        self.thresholds = [numbers(copy) for copy in move_threshold(field)]
        self.blurred = numbers(blur_grain(field))

    def interval(self, factor: Factor, value: float, voxel: float) -> tuple[float, float]:
        """Return the interval of one factor (see `factor_intervals`); `voxel` is an edge over D_n."""
        name = factor.name
        shifted = np.array([copy[name] for copy in self.shifted])
        by_inertia = self._axes == "inertia" and factor.axes == "chosen"
        candidates = [value, 2.0 * value - self.blurred[name], *(copy[name] for copy in self.thresholds)]
        if self._surface not in factor.voxels_only and not by_inertia:
            candidates.append(value - _UNDONE * float(shifted.mean() - value))
        if name in self._others:
            candidates.append(self._others[name])
        floor = voxel * _left_open(factor, self._axes) * (value if factor.power else 1.0)
        half = float(np.hypot(_SPREADS * shifted.std(ddof=1), floor))
        low, high = float(min(candidates)) - half, float(max(candidates)) + half
        # Cut off at what the factor cannot be below or above; the value stays in it.
        return min(value, max(low, 0.0)), max(value, min(high, factor.highest))


def _left_open(factor: Factor, axes: AxisConvention) -> float:
    if isinstance(factor.left_open, Mapping):
        return factor.left_open.get(axes, _INERTIA)
    assert factor.left_open is not None
    return factor.left_open


def _collect_factors(core: ShapeFactors, detailed: DetailedFactors | None) -> dict[str, float]:
    """Return the factors of one grain by name, without the bands."""
    known = vars(core) if detailed is None else vars(detailed) | vars(core)
    names = FACTORS.core if detailed is None else (*FACTORS.core, *FACTORS.detail)
    return {name: float(FACTORS.value(name, known)) for name in names}
