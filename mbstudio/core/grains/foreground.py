"""Which voxels of a scan are grain: field of view, noise, phases, threshold."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy import ndimage

from mbstudio.core.errors import SegmentationError, SegmentationWarning
from mbstudio.core.grains.flooding import map_distances, split_by_necks
from mbstudio.core.grains.interfaces import Interfaces, count_unexplained, find_interfaces
from mbstudio.core.grains.judging import median_solidity
from mbstudio.core.grains.phases import LEAST_INTERFACES, Phases, find_phases
from mbstudio.core.grains.thresholding import LocalThreshold, brighter_than, threshold_of
from mbstudio.core.scan.field_of_view import FieldOfView
from mbstudio.core.scan.scan import Scan
from mbstudio.core.units import VoxelSize

# Grey values beyond these quantiles are clipped: a few heavy-mineral grains and their streaks
# would otherwise draw Otsu's threshold, and the blur, towards them.
_CLIPPED = (0.002, 0.99)
_BINS = 1024
_TRIED_EDGE = 160  # voxels: edge of the box in which touching grains are parted on trial
_TRIED_SPLITTING, _TRIED_DEPTH, _TRIED_VOXELS, _TRIED_GRAINS = 0.75, 0.5, 100, 50
_DOUBTFUL_DARK, _DOUBTFUL_BRIGHT = 0.2, 0.08  # 1 / voxel: curvatures that pores in fine packings can have too
_WITHIN = 0.06  # share of inner borders that lie within what would be one grain; films of water 0.13 and more


@dataclass(frozen=True, eq=False)
class Foreground:
    """Which voxels are grain, and by what.

    Attributes
    ----------
    mask : bool array, shape (Z, Y, X)
    words : str
        What parts grains from the rest.
    interfaces : Interfaces or None
        Where the scan's phases meet; None where the grey values of grains were stated.
    phases : Phases or None
    border : bool array, shape (Z, Y, X), or None
        Voxels of the mask that lie between two grains, where a classifier tells these.
    """

    mask: Bool[np.ndarray, "Z Y X"]
    words: str
    interfaces: Interfaces | None = None
    phases: Phases | None = None
    border: Bool[np.ndarray, "Z Y X"] | None = None


def find_foreground(
    scan: Scan,
    voxels: Shaped[np.ndarray, "Z Y X"],
    view: FieldOfView,
    *,
    threshold: float | None = None,
    ranges: tuple[float, ...] = (),
    dark: bool | None = None,
    denoise_sigma: float = 0.5,
) -> Foreground:
    """Return which voxels are grain.

    Parameters
    ----------
    scan : Scan
    voxels : array, shape (Z, Y, X)
        Its grey values.
    view : FieldOfView
    threshold, ranges, dark, denoise_sigma
        As in :class:`~mbstudio.core.grains.segmentation.SegmentationSettings`.

    Warns
    -----
    SegmentationWarning
        If grains are found to be dark, or wetted by a third phase.

    Raises
    ------
    SegmentationError
        If nothing stands out from the noise.
    """
    if ranges or threshold is not None:
        return _select_ranges(scan, voxels, view, threshold, ranges, bool(dark), denoise_sigma)
    interfaces = find_interfaces(_clipped(voxels, -math.inf, math.inf), view.mask)
    phases = find_phases(interfaces, dark)
    if phases is None:
        raise SegmentationError(
            f"Nothing in {scan.path or 'the scan'} stands out from the noise, so there are no grains: "
            "check that it is the right file, or state a threshold."
        )
    mask, found = _select_phases(scan, voxels, view, phases, denoise_sigma)
    if dark is None and phases.curvature < (_DOUBTFUL_DARK if phases.dark else _DOUBTFUL_BRIGHT):
        rest = view.mask & ~mask
        if _solidity_of_trial(rest) > _solidity_of_trial(mask):
            turned = find_phases(interfaces, not phases.dark)
            if turned is not None:
                phases = turned
                mask, found = _select_phases(scan, voxels, view, phases, denoise_sigma)
        del rest
    if phases.liquid is not None:
        toned = find_phases(interfaces, phases.dark, wet=False)
        if toned is not None and len(toned.tones) > 1:
            solid, toned_found = _select_phases(scan, voxels, view, toned, denoise_sigma)
            if _grains_explain(interfaces, solid, phases):
                mask, found, phases = solid, toned_found, toned
    _warn_about(phases, judged_dark=phases.dark and dark is None)
    sign = -1.0 if phases.dark else 1.0
    side = "darker" if phases.dark else "brighter"
    words = f"Grains are {side} than a threshold that follows their surfaces, about {sign * phases.middle:g}"
    if isinstance(found, float):
        words = f"Grains are {side} than {sign * found:g}"
    return Foreground(mask, words, interfaces, phases)


def _select_phases(
    scan: Scan,
    voxels: Shaped[np.ndarray, "Z Y X"],
    view: FieldOfView,
    phases: Phases,
    denoise_sigma: float,
) -> tuple[Bool[np.ndarray, "Z Y X"], float | LocalThreshold]:
    """Return which voxels are grain, and the threshold (its sign turned where grains are dark)."""
    grey = _clipped(voxels, *believed_range(voxels, view))
    _denoise(grey, view, scan.voxel_size, denoise_sigma)
    sign = -1.0 if phases.dark else 1.0
    otsu = sign * _otsu(grey, view.mask)
    found = threshold_of(phases, otsu, view.shape)
    if found != otsu:
        # What is clipped for Otsu's threshold may be the grains themselves.
        reach = 2.0 * phases.contrast
        ends = (sign * (phases.void - reach), sign * (phases.tones[-1] + reach))
        grey = _clipped(voxels, min(ends), max(ends))
        _denoise(grey, view, scan.voxel_size, denoise_sigma)
    if phases.dark:
        np.negative(grey, out=grey)
    mask = brighter_than(grey, found)
    mask &= view.mask
    return mask, found


def _trial(solid: Bool[np.ndarray, "Z Y X"]) -> tuple[Int[np.ndarray, "z y x"], tuple[slice, ...]]:
    """Return the grains of a box in the middle, touching ones parted by their shape alone, and the box."""
    box = tuple(slice(max(0, (n - _TRIED_EDGE) // 2), (n + _TRIED_EDGE) // 2) for n in solid.shape)
    labels, _ = split_by_necks(map_distances(solid[box]), _TRIED_SPLITTING, _TRIED_DEPTH)
    return labels, box


def _solidity_of_trial(solid: Bool[np.ndarray, "Z Y X"]) -> float:
    """Return how convex grains would be: what is left between grains is not."""
    found = median_solidity(_trial(solid)[0], _TRIED_VOXELS, _TRIED_GRAINS)
    return found if math.isfinite(found) else 0.0


def _grains_explain(interfaces: Interfaces, solid: Bool[np.ndarray, "Z Y X"], wet: Phases) -> bool:
    """Return whether a level between void and grain is that of fainter grains, rather than a liquid.

    Where it is, the borders between it and the brighter grains lie where touching grains are parted by their
    shape alone; those between a liquid's film and its grain lie within what would be one grain.
    """
    assert wet.liquid is not None
    labels, box = _trial(solid)
    lows = -interfaces.highs if wet.dark else interfaces.lows
    places = interfaces.places - np.array([edge.start for edge in box])
    inner = ((places >= 0) & (places < labels.shape)).all(axis=1)
    inner &= np.abs(lows - wet.liquid) < 0.5 * (wet.liquid - wet.void)
    inner &= interfaces.contrasts > 0.5 * wet.contrast
    if np.count_nonzero(inner) < LEAST_INTERFACES:
        return False
    within, _ = count_unexplained(labels, places[inner].astype(np.int64))
    return bool(within < _WITHIN * np.count_nonzero(inner))


def _select_ranges(
    scan: Scan,
    voxels: Shaped[np.ndarray, "Z Y X"],
    view: FieldOfView,
    threshold: float | None,
    ranges: tuple[float, ...],
    dark: bool,
    denoise_sigma: float,
) -> Foreground:
    """Return which voxels lie in ranges of grey values that were stated."""
    ranges = stated_ranges(threshold, ranges, dark)
    if threshold is not None:
        words = f"Grains are {'darker' if dark else 'brighter'} than {threshold:g}"
    else:
        between = [f"between {a:g} and {b:g}" for a, b in zip(ranges[::2], ranges[1::2], strict=True)]
        words = "Grains lie " + " or ".join(between)
    low, high = ends_of_clip(believed_range(voxels, view), ranges, threshold is not None, dark)
    grey = _clipped(voxels, low, high)
    _denoise(grey, view, scan.voxel_size, denoise_sigma)
    mask = np.zeros(grey.shape, np.bool_)
    for start, end in zip(ranges[::2], ranges[1::2], strict=True):
        mask |= (grey > start) & (grey <= end)
    mask &= view.mask
    return Foreground(mask, words)


def stated_ranges(threshold: float | None, ranges: tuple[float, ...], dark: bool) -> tuple[float, ...]:
    """Return the ranges of grey values, in pairs, that are grain by a threshold or by ranges."""
    if threshold is None:
        return ranges
    return (-math.inf, threshold) if dark else (threshold, math.inf)


def ends_of_clip(
    believed: tuple[float, float], ranges: tuple[float, ...], is_threshold: bool, dark: bool
) -> tuple[float, float]:
    """Return the grey values at which voxels are clipped before they are smoothed, beyond all stated ends."""
    low, high = believed
    ends = [end for end in ranges if math.isfinite(end)]
    span = high - low
    low = min(low, min(ends) - span) if dark or not is_threshold else low
    return low, max(high, max(ends) + span)


def _clipped(voxels: Shaped[np.ndarray, "Z Y X"], low: float, high: float) -> Float[np.ndarray, "Z Y X"]:
    """Return the grey values in single precision, those beyond a range at its ends."""
    grey = np.empty(voxels.shape, np.float32)
    for part, target in zip(voxels, grey, strict=True):
        target[:] = np.clip(part, low, high)
    return grey


def _warn_about(phases: Phases, *, judged_dark: bool) -> None:
    """Warn of what a person would want to know before believing the grains."""
    sign = -1.0 if phases.dark else 1.0
    if judged_dark:
        warnings.warn(
            "The grains appear darker than what lies between them, judged by the convex side of their "
            "surfaces: state that they are bright if that is wrong.",
            SegmentationWarning,
            stacklevel=4,
        )
    if phases.liquid is not None:
        warnings.warn(
            f"There are three phases: void ({sign * phases.void:g}), a liquid that wets the grains "
            f"({sign * phases.liquid:g}) and grains ({sign * phases.tones[0]:g}). Only the last are grain: "
            "state a threshold if that is wrong.",
            SegmentationWarning,
            stacklevel=4,
        )


def believed_range(voxels: Shaped[np.ndarray, "Z Y X"], view: FieldOfView) -> tuple[float, float]:
    """Return the grey values between which voxels are believed; all of them where nearly all are alike."""
    low, high = _quantiles(voxels, view.mask)
    if low == high:  # the few others are what there is to see
        return float(voxels.min()), float(voxels.max())
    return low, high


def _quantiles(voxels: Shaped[np.ndarray, "Z Y X"], seen: Bool[np.ndarray, "Z Y X"]) -> tuple[float, float]:
    """Return the grey values between which voxels are believed (of some ten million of them)."""
    step = max(1, round((voxels.size / 1e7) ** (1 / 2)))
    sample = voxels[:, ::step, ::step][seen[:, ::step, ::step]]
    low, high = np.quantile(sample, _CLIPPED)
    return float(low), float(high)


def _denoise(
    grey: Float[np.ndarray, "Z Y X"], view: FieldOfView, voxel_size: VoxelSize, sigma: float
) -> None:
    """Blur in place, with nothing flowing in from outside the field of view."""
    if sigma == 0:
        return
    shortest = min(voxel_size.zyx)
    sigmas = [sigma * shortest / edge for edge in voxel_size.zyx]
    if not view.is_whole_box:
        grey *= view.mask
    ndimage.gaussian_filter(grey, sigmas, output=grey, mode="nearest")
    if not view.is_whole_box:
        across = [sigma for axis, sigma in enumerate(sigmas) if axis != view.axis]
        weight = ndimage.gaussian_filter(view.footprint.astype(np.float32), across, mode="nearest")
        grey /= view.over_volume(np.maximum(weight, 1e-3))


def _otsu(grey: Float[np.ndarray, "Z Y X"], seen: Bool[np.ndarray, "Z Y X"]) -> float:
    """Return Otsu's threshold of the seen voxels."""
    from skimage.filters import threshold_otsu

    low, high = float(grey.min(where=seen, initial=math.inf)), float(grey.max(where=seen, initial=-math.inf))
    edges = np.linspace(low, high, _BINS + 1)
    counts = np.zeros(_BINS, np.int64)
    for part, part_seen in zip(grey, seen, strict=True):
        counts += np.histogram(part[part_seen], bins=edges)[0]
    return float(threshold_otsu(hist=(counts, (edges[:-1] + edges[1:]) / 2)))
