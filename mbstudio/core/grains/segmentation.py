"""Segmentation: from grey voxels to single grains.

Field of view, denoising, threshold, small holes, distance map, watershed with a neck rule,
fragments, cavities, table. Every length is in voxels (of the smallest edge, where voxels are
not cubes), every grey value in the scan's own.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cc3d
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy import ndimage

from mbstudio.core.errors import ScanError, SegmentationError, SegmentationWarning
from mbstudio.core.grains.classifying.learned_foreground import classify_foreground, grow_into_borders
from mbstudio.core.grains.classifying.voxel_classifier import VoxelClassifier
from mbstudio.core.grains.flooding import map_distances, split_by_necks
from mbstudio.core.grains.foreground import Foreground, find_foreground
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.grains.judging import compare_splittings, judge_labels
from mbstudio.core.grains.labelling import (
    build_grain_set,
    fill_label_cavities,
    renumber_kept,
    statistics,
    widened_box,
)
from mbstudio.core.scan.field_of_view import FieldOfView, find_field_of_view, with_numbers_only
from mbstudio.core.scan.impulses import without_impulses
from mbstudio.core.scan.scan import Scan
from mbstudio.core.units import VoxelSize

Progress = Callable[[float, str], None]

# Peaks of the distance map that stand out less than this (in voxels) come from the voxel grid.
_LEAST_DEPTH = 0.5
# Enclosed gaps in the solid up to this size are noise.
_PINHOLE_VOXELS = 27


@dataclass(frozen=True)
class SegmentationSettings:
    """How grains are found.

    Attributes
    ----------
    denoise_sigma : float
        Standard deviation of the Gaussian blur before the threshold, in voxels; 0 for none.
    threshold : float or None
        Grey value from which a voxel is grain; None to find it from the surfaces between the phases.
    ranges : tuple of float
        Lower and upper ends of ranges of grey values, in pairs, instead of a threshold: grains are what
        lies in one of them.
    splitting : float
        How readily touching grains are parted, 0 to 1: two are parted where the neck between
        them is narrower than this share of the smaller one's inscribed ball. 0 parts nothing.
    smallest_voxels : int
        Pieces of fewer voxels are no grains: they go to the grain that they touch most, or away.
    dark : bool or None
        Whether grains are darker than what lies between them; None to find it out: they are the side whose
        surface is mostly convex.
    drop_border : bool
        Leave out grains that the box or the field of view cuts off.
    by_classifier : bool
        Whether a classifier that was learned from strokes says which voxels are grain, in place of smoothing
        and threshold.

    Raises
    ------
    SegmentationError
        If a value is out of its range.
    """

    denoise_sigma: float = 0.5
    threshold: float | None = None
    ranges: tuple[float, ...] = ()
    splitting: float = 0.75
    smallest_voxels: int = 300
    drop_border: bool = False
    dark: bool | None = None
    by_classifier: bool = False

    def __post_init__(self) -> None:
        if not (math.isfinite(self.denoise_sigma) and 0 <= self.denoise_sigma <= 20):
            raise SegmentationError(f"denoise_sigma={self.denoise_sigma} is impossible: give 0 to 20 voxels.")
        if self.threshold is not None and not math.isfinite(self.threshold):
            raise SegmentationError(f"threshold={self.threshold} is impossible: give a grey value or None.")
        object.__setattr__(self, "ranges", tuple(float(end) for end in self.ranges))
        self._check_ranges()
        if not 0 <= self.splitting <= 1:
            raise SegmentationError(
                f"splitting={self.splitting} is impossible: give 0 (never) to 1 (at every neck)."
            )
        if not self.smallest_voxels >= 1:
            raise SegmentationError(f"smallest_voxels={self.smallest_voxels} is impossible: give 1 or more.")

    def _check_ranges(self) -> None:
        pairs = list(zip(self.ranges[::2], self.ranges[1::2], strict=False))
        if len(self.ranges) % 2 or not all(low < high for low, high in pairs):
            raise SegmentationError(
                f"ranges={self.ranges} is impossible: give pairs of a lower and a higher grey value."
            )
        if self.ranges and self.threshold is not None:
            raise SegmentationError("Give either a threshold or ranges, not both.")
        for name in ("threshold", "ranges", "dark"):
            if self.by_classifier and getattr(self, name) not in (None, ()):
                raise SegmentationError(
                    f"A classifier says which voxels are grain, and so does {name}: give one of them."
                )


def segment(
    scan: Scan,
    settings: SegmentationSettings | None = None,
    *,
    classifier: VoxelClassifier | None = None,
    progress: Progress | None = None,
    **overrides: Any,
) -> GrainSet:
    """Find the grains of a scan.

    Parameters
    ----------
    scan : Scan
    settings : SegmentationSettings, optional
    classifier : VoxelClassifier, optional
        Learned from strokes: it says which voxels are grain, in place of smoothing and threshold.
    progress : callable, optional
        ``progress(fraction, message)``, called between the stages; what it raises ends the work.
    **overrides
        Single settings by name, for example ``splitting=0.7``.

    Returns
    -------
    GrainSet
        Labels 1..N, each one 26-connected piece without cavities, with a verdict.

    Raises
    ------
    ScanError
        If voxels inside the field of view are not numbers, or all are alike.
    SegmentationError
        If a setting is unknown or impossible, no grains are found, or the classifier does not fit the scan.

    Warns
    -----
    SegmentationWarning
        If grains are found to be dark or wetted by a third phase, impulses were replaced, or the classifier
        was learned at another voxel size.
    """
    settings = _with_overrides(settings or SegmentationSettings(), overrides, classifier)
    tell = progress or (lambda fraction, message: None)
    voxels, view = _read(scan, tell)
    foreground = _find_foreground(scan, voxels, view, settings, classifier, tell)
    tell(0.40, foreground.words)
    border = _take_out_borders(foreground, view)
    tell(0.50, "Measuring distances")
    landscape = _distance_map(foreground.mask, view, scan.voxel_size)
    words, interfaces, phases = foreground.words, foreground.interfaces, foreground.phases
    del foreground
    tell(0.58, "Separating touching grains")
    labels, count = split_by_necks(landscape, settings.splitting, _LEAST_DEPTH)
    tell(0.75, "Parting them otherwise")
    agreements = _compare(landscape, labels, settings, scan.voxel_size) if count else {}
    del landscape
    if border is not None:
        grow_into_borders(labels, border)
        del border
    tell(0.82, f"Sorting {count:,} pieces")
    count = _settle_fragments(labels, settings.smallest_voxels)
    tell(0.88, "Filling cavities")
    fill_label_cavities(labels)
    verdict = None
    if count:
        tell(0.92, "Judging the grains by the scan")
        verdict = judge_labels(voxels, labels, view, interfaces, phases=phases, agreements=agreements)
    if settings.drop_border:
        _, _, _, cut = statistics(labels, view.rim_cutting(labels))
        count = renumber_kept(labels, ~cut)
    if not count:
        raise SegmentationError(_nothing_found(scan, words))
    tell(0.97, "Making the table")
    grains = replace(
        build_grain_set(labels, scan.voxel_size, scan.origin, view.rim_cutting(labels)),
        verdict=verdict,
        view=view,
    )
    tell(1.0, f"{len(grains):,} grains")
    return grains


def _read(scan: Scan, tell: Progress) -> tuple[Shaped[np.ndarray, "Z Y X"], FieldOfView]:
    """Return the voxels, none of which is an impulse or no number, and the field of view."""
    tell(0.0, "Reading the voxels")
    voxels = scan.load()
    tell(0.08, "Finding the field of view")
    view = find_field_of_view(voxels)
    voxels = with_numbers_only(voxels, view, scan.path or "The scan")
    _require_contrast(voxels, scan)
    return _without_impulses(voxels, view), view


def _take_out_borders(foreground: Foreground, view: FieldOfView) -> Bool[np.ndarray, "Z Y X"] | None:
    """Fill pinholes of the solid in place, take borders between grains out of it, and return these."""
    _fill_pinholes(foreground.mask, view)
    if foreground.border is not None:
        foreground.mask[foreground.border] = False
    return foreground.border


def _nothing_found(scan: Scan, words: str) -> str:
    return (
        f"No grains were found in {scan.path or 'the scan'}. {words}: "
        "check the threshold, the smallest grain, and whether grains at the border are dropped."
    )


def _find_foreground(
    scan: Scan,
    voxels: Shaped[np.ndarray, "Z Y X"],
    view: FieldOfView,
    settings: SegmentationSettings,
    classifier: VoxelClassifier | None,
    tell: Progress,
) -> Foreground:
    """Return which voxels are grain, by grey values or by a classifier."""
    if classifier is None:
        tell(0.14, "Denoising")
        return find_foreground(
            scan, voxels, view, threshold=settings.threshold, ranges=settings.ranges, dark=settings.dark,
            denoise_sigma=settings.denoise_sigma,
        )  # fmt: skip
    tell(0.14, "Classifying voxels")
    solid, border = classify_foreground(
        classifier, scan, voxels, view, lambda share, words: tell(0.14 + 0.26 * share, words)
    )
    return Foreground(solid, "Grains are what the classifier takes for them", border=border)


def _compare(
    landscape: Float[np.ndarray, "Z Y X"],
    labels: Int[np.ndarray, "Z Y X"],
    settings: SegmentationSettings,
    voxel_size: VoxelSize,
) -> dict[str, float]:
    """Return how well the pieces agree with those that come of other partings."""
    shortest = min(voxel_size.zyx)
    z, y, x = (edge / shortest for edge in voxel_size.zyx)
    return compare_splittings(
        landscape, labels, settings.splitting, _LEAST_DEPTH, settings.smallest_voxels, (z, y, x)
    )


def _with_overrides(
    settings: SegmentationSettings, overrides: dict[str, Any], classifier: VoxelClassifier | None
) -> SegmentationSettings:
    known = SegmentationSettings.__dataclass_fields__
    for name in overrides:
        if name not in known:
            raise SegmentationError(
                f"'{name}' is not a setting of the segmentation: use one of {', '.join(known)}."
            )
    settings = replace(settings, **overrides)
    if classifier is not None:
        return replace(settings, by_classifier=True)
    if settings.by_classifier:
        raise SegmentationError("The grains are to be found by a classifier: give it, or state a threshold.")
    return settings


def _without_impulses(voxels: Shaped[np.ndarray, "Z Y X"], view: FieldOfView) -> Shaped[np.ndarray, "Z Y X"]:
    """Return the voxels with impulses replaced, where there are many; tell it."""
    mended, share = without_impulses(voxels, view.mask)
    if mended is not voxels:
        warnings.warn(
            f"{100 * share:.2g} % of the voxels are impulses, far brighter or darker than all around them: "
            "each was given the median of its neighbours. Look whether the detector has dead pixels.",
            SegmentationWarning,
            stacklevel=4,
        )
    return mended


def _require_contrast(voxels: Shaped[np.ndarray, "Z Y X"], scan: Scan) -> None:
    """Raise ScanError if all voxels are alike."""
    name = scan.path or "The scan"
    low, high = math.inf, -math.inf
    for part in voxels:
        low, high = min(low, float(part.min())), max(high, float(part.max()))
    if low == high:
        raise ScanError(
            f"{name} is constant: every voxel is {low:g}. Check that the right file was exported."
        )


def part_scan(
    scan: Scan, settings: SegmentationSettings, classifier: VoxelClassifier | None = None
) -> Int[np.ndarray, "Z Y X"]:
    """Return labels 1..N of the grains of a scan, or of a region of one, as `segment` parts them.

    They are neither judged nor freed of cavities: this is quick enough to be looked at while settings change.

    Parameters
    ----------
    scan : Scan
    settings : SegmentationSettings
    classifier : VoxelClassifier, optional

    Raises
    ------
    ScanError, SegmentationError
        As :func:`segment` raises them; none where no grains are found.
    """
    voxels, view = _read(scan, lambda _share, _words: None)
    foreground = _find_foreground(scan, voxels, view, settings, classifier, lambda _share, _words: None)
    _take_out_borders(foreground, view)
    landscape = _distance_map(foreground.mask, view, scan.voxel_size)
    labels, count = split_by_necks(landscape, settings.splitting, _LEAST_DEPTH)
    if foreground.border is not None:
        grow_into_borders(labels, foreground.border)
    if count:
        _settle_fragments(labels, settings.smallest_voxels)
    return labels


def part_mask(
    mask: Bool[np.ndarray, "Z Y X"], voxel_size: VoxelSize, splitting: float, smallest_voxels: int = 1
) -> Int[np.ndarray, "Z Y X"]:
    """Return the grains of a mask made elsewhere as labels 1..N, touching ones parted at their necks.

    Parameters
    ----------
    mask : bool array, shape (Z, Y, X)
    voxel_size : VoxelSize
    splitting, smallest_voxels
        As in `SegmentationSettings`.
    """
    nz, ny, nx = mask.shape
    whole = FieldOfView(0, np.ones((ny, nx), dtype=bool), (nz, ny, nx))
    landscape = _distance_map(mask, whole, voxel_size)
    labels, _ = split_by_necks(landscape, splitting, _LEAST_DEPTH)
    _settle_fragments(labels, smallest_voxels)
    return labels


def _fill_pinholes(mask: Bool[np.ndarray, "Z Y X"], view: FieldOfView) -> None:
    """Fill, in place, the pinholes that noise makes in the solid.

    Larger cavities are filled later, grain by grain: here they may be pores that touching grains
    enclose.
    """
    gaps, count = cc3d.connected_components(~mask & view.mask, connectivity=6, return_N=True)
    small = np.bincount(gaps.ravel(), minlength=count + 1) <= _PINHOLE_VOXELS
    small[0] = False
    for part, gap in zip(mask, gaps, strict=True):
        part |= small[gap]


def _distance_map(
    mask: Bool[np.ndarray, "Z Y X"], view: FieldOfView, voxel_size: VoxelSize
) -> Float[np.ndarray, "Z Y X"]:
    """Return the distance to the surface, in the smallest voxel edge; 0 outside the grains.

    What the scan has not seen, beyond the box or the field of view, counts as solid: a grain that
    is cut off is not the narrower for it.
    """
    shortest = min(voxel_size.zyx)
    solid = mask if view.is_whole_box else mask | ~view.mask
    z, y, x = (edge / shortest for edge in voxel_size.zyx)
    distances = map_distances(solid, (z, y, x))
    distances *= mask
    return distances


def _settle_fragments(labels: Int[np.ndarray, "Z Y X"], smallest_voxels: int) -> int:
    """Give pieces that are too small to the neighbour they touch most, else drop them; return N."""
    voxels, boxes, _, _ = statistics(labels)
    small = voxels < smallest_voxels
    keep = np.ones(len(voxels), dtype=bool)
    cross = ndimage.generate_binary_structure(3, 3)
    for label in np.flatnonzero(small) + 1:
        part = labels[widened_box(boxes[label - 1], margin=1)]
        inside = part == label
        around = part[ndimage.binary_dilation(inside, cross) & ~inside]
        around = around[around > 0]
        around = around[~small[around - 1]]
        if len(around):
            part[inside] = np.bincount(around).argmax()
        keep[label - 1] = False
    return renumber_kept(labels, keep)
