"""Which voxels of a slice are grain by a threshold, as a segmentation of the whole scan would have it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from mbstudio.core.grains.foreground import believed_range, ends_of_clip, stated_ranges
from mbstudio.core.grains.segmentation import SegmentationSettings
from mbstudio.core.scan.field_of_view import FieldOfView, find_field_of_view
from mbstudio.core.scan.scan import Scan

_TRUNCATED = 4.0  # standard deviations, as SciPy truncates


@dataclass(frozen=True, eq=False)
class SliceForeground:
    """Tells grain from void in slices of a scan.

    Attributes
    ----------
    scan : Scan
    view : FieldOfView
    believed : tuple of float
        Grey values between which voxels are believed.
    """

    scan: Scan
    view: FieldOfView
    believed: tuple[float, float]

    @classmethod
    def of(cls, scan: Scan) -> SliceForeground:
        """Look a scan through once."""
        view = find_field_of_view(scan.voxels)
        voxels = scan.load()
        return cls(scan, view, believed_range(voxels, view))

    def mask(self, axis: int, index: int, settings: SegmentationSettings) -> Bool[np.ndarray, "h w"]:
        """Return which voxels of a slice are grain.

        Parameters
        ----------
        axis : int
            Across which it is cut: 0, 1 or 2 for z, y or x.
        index : int
        settings : SegmentationSettings
            With a threshold or ranges; splitting and the smallest grain do not count here.
        """
        ranges = stated_ranges(settings.threshold, settings.ranges, bool(settings.dark))
        low, high = ends_of_clip(self.believed, ranges, settings.threshold is not None, bool(settings.dark))
        grey = self._smoothed(axis, index, settings.denoise_sigma, low, high)
        mask = np.zeros(grey.shape, bool)
        for start, end in zip(ranges[::2], ranges[1::2], strict=True):
            mask |= (grey > start) & (grey <= end)
        return np.asarray(mask & np.take(self.view.mask, index, axis))

    def _smoothed(
        self, axis: int, index: int, sigma: float, low: float, high: float
    ) -> Float[np.ndarray, "h w"]:
        """Return a slice of the smoothed scan: only the slices about it are looked at."""
        shortest = min(self.scan.voxel_size.zyx)
        sigmas = [sigma * shortest / edge for edge in self.scan.voxel_size.zyx]
        along, across = sigmas.pop(axis), sigmas
        reach = int(_TRUNCATED * along + 0.5)
        places = np.clip(np.arange(index - reach, index + reach + 1), 0, self.scan.shape[axis] - 1)
        weights = np.exp(-0.5 * np.square(np.arange(-reach, reach + 1) / max(along, 1e-9)))
        weights /= weights.sum()
        slab = [slice(None)] * 3
        slab[axis] = slice(int(places[0]), int(places[-1]) + 1)
        grey = np.clip(np.asarray(self.scan.voxels[tuple(slab)], np.float32), low, high)
        seen = np.asarray(self.view.mask[tuple(slab)])
        if self.view.is_whole_box:
            return _averaged(grey, axis, places, weights, across)
        grey *= seen
        weight = _averaged(seen.astype(np.float32), axis, places, weights, across)
        return np.asarray(_averaged(grey, axis, places, weights, across) / np.maximum(weight, 1e-3))


def _averaged(
    slab: Float[np.ndarray, "z y x"], axis: int, places: np.ndarray, weights: np.ndarray, across: list[float]
) -> Float[np.ndarray, "h w"]:
    """Return the weighted mean of slices, smoothed across."""
    summed: Float[np.ndarray, "h w"] | None = None
    for place, weight in zip(places - places[0], weights, strict=True):
        part = np.take(slab, int(place), axis) * np.float32(weight)
        summed = part if summed is None else summed + part
    assert summed is not None
    if max(across) == 0:
        return summed
    return np.asarray(ndimage.gaussian_filter(summed, across, mode="nearest"))


def grey_histogram(scan: Scan, bins: int = 128, slices: int = 15) -> tuple[np.ndarray, np.ndarray]:
    """Return counts of grey values and the edges of their bins, from some slices of a scan.

    Parameters
    ----------
    scan : Scan
    bins : int
    slices : int
        Evenly spread along z.
    """
    nz = scan.shape[0]
    chosen = np.unique(np.linspace(0, nz - 1, min(slices, nz)).round().astype(int))
    every = np.concatenate([np.asarray(scan.voxels[int(z)], np.float64).ravel() for z in chosen])
    every = every[np.isfinite(every)]
    inside = every[every != 0]
    every = (
        inside if 0 < inside.size < 0.95 * every.size else every
    )  # without the box about the field of view
    if not every.size:
        return np.zeros(bins, np.int64), np.linspace(0, 1, bins + 1)
    low, high = np.quantile(every, (0.001, 0.999))
    if not high > low:
        low, high = float(every.min()), float(every.max()) + math.ulp(1.0)
    return np.histogram(every, bins=bins, range=(low, max(high, low + 1e-12)))
