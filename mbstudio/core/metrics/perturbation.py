"""The same grain as the scanner might as well have shown it: shifted, thresholded otherwise, blurred."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Shaped
from scipy import ndimage

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains.grain import Grain

SHIFTS = 4
_MARGIN = 3
_EDGE_WIDTH = 0.7
"""Standard deviation, in voxels, of the edge that a mask is taken to stem from."""
_BLUR = 0.5
_STEP = 0.01
"""One step of the threshold where none is given, of the contrast."""


@dataclass(frozen=True, eq=False)
class GreyField:
    """A grey picture of one grain and the level of its surface.

    Attributes
    ----------
    values : float array, shape (Z, Y, X)
        1 well inside, 0 well outside, with a margin around the grain.
    level : float
        Voxels above it belong to the grain.
    step : float
        By how much the level may be off.
    grain : Grain
        The grain that it shows.
    """

    values: Float[np.ndarray, "Z Y X"]
    level: float
    step: float
    grain: Grain


def make_mask_field(grain: Grain, step: float | None = None) -> GreyField:
    """Return the picture of a grain of which only the mask is known.

    It is the smoothed mask, at the level that keeps the volume.

    Parameters
    ----------
    step : float, optional
        Uncertainty of the level, of the contrast; 0.01 by default.
    """
    values = ndimage.gaussian_filter(np.pad(grain.mask, _MARGIN).astype(np.float32), _EDGE_WIDTH)
    place = values.size - grain.voxel_count
    level = float(np.partition(values, place, axis=None)[place - 1 : place + 1].mean())
    return GreyField(values, level, _STEP if step is None else float(step), grain)


def make_grey_field(
    grain: Grain, grey: Shaped[np.ndarray, "z y x"], threshold: float, step: float | None = None
) -> GreyField:
    """Return the picture of a grain from the scan's grey values around it.

    Parameters
    ----------
    grey : array, shape (Z + 2 m, Y + 2 m, X + 2 m)
        The scan about the grain's bounding box, with the same margin of m >= 2 voxels on all sides.
    threshold : float
        The grey value that parts grain from surroundings; the grain may be the darker side.
    step : float, optional
        Uncertainty of the threshold in grey values; 1 % of the contrast by default.

    Raises
    ------
    MeasureError
        If the shapes do not fit, a value is not finite, or the threshold does not lie between grain
        and surroundings.
    """
    mask, margin = _with_margin(grain, grey)
    values = np.asarray(grey, dtype=np.float64)
    if not np.isfinite(values).all():
        raise MeasureError(f"The grey values around '{grain.name}' are not all finite numbers.")
    deep = ndimage.binary_erosion(mask)
    inside = float(np.median(values[deep if deep.any() else mask]))
    shell = ndimage.binary_dilation(mask, iterations=2) & ~ndimage.binary_dilation(mask)
    outside = float(np.median(values[shell]))
    contrast = inside - outside
    if contrast == 0 or not 0 < (threshold - outside) / contrast < 1:
        raise MeasureError(
            f"The threshold {threshold:g} does not lie between the grey value of '{grain.name}' "
            f"({inside:g}) and that around it ({outside:g}): give the one that its mask was made with."
        )
    values = (values - outside) / contrast
    # What lies further away belongs to other grains.
    values[~ndimage.binary_dilation(mask, np.ones((3, 3, 3)), iterations=2)] = 0.0
    cut = margin - min(margin, _MARGIN)
    window = tuple(slice(cut, size - cut) for size in values.shape)
    offset = _STEP if step is None else abs(float(step) / contrast)
    return GreyField(values[window].astype(np.float32), (threshold - outside) / contrast, offset, grain)


def _with_margin(grain: Grain, grey: np.ndarray) -> tuple[Bool[np.ndarray, "z y x"], int]:
    """Return the mask on the grid of the grey values, and the margin's width."""
    margins = {(a - b) / 2 for a, b in zip(grey.shape, grain.mask.shape, strict=False)}
    if grey.ndim != 3 or len(margins) != 1 or (margin := margins.pop()) < 2 or margin != int(margin):
        raise MeasureError(
            f"Grey values of shape {grey.shape} do not fit the mask of '{grain.name}' {grain.mask.shape}: "
            "give its bounding box with the same margin of at least 2 voxels on all sides."
        )
    return np.pad(grain.mask, int(margin)), int(margin)


def shift_grain(field: GreyField) -> list[Grain]:
    """Return the grain sampled again at four sub-voxel shifts (the same in every run)."""
    golden = 1.2207440846057596
    offsets = (np.outer(np.arange(1, SHIFTS + 1), golden ** -np.arange(1.0, 4.0)) + 0.5) % 1.0 - 0.5
    return [
        _cut_grain(field, ndimage.shift(field.values, offset, order=1, mode="nearest"), field.level)
        for offset in offsets
    ]


def move_threshold(field: GreyField) -> list[Grain]:
    """Return the grain at a threshold one step lower and one step higher."""
    return [_cut_grain(field, field.values, field.level + sign * field.step) for sign in (-1, 1)]


def blur_grain(field: GreyField) -> Grain:
    """Return the grain as a scanner less sharp by half a voxel would show it."""
    return _cut_grain(field, ndimage.gaussian_filter(field.values, _BLUR), field.level)


def _cut_grain(field: GreyField, values: Float[np.ndarray, "Z Y X"], level: float) -> Grain:
    """Return the largest piece above the level, with cavities filled as in any grain."""
    import cc3d
    import fill_voids

    mask = cc3d.largest_k(values > level, k=1, connectivity=26).astype(bool)
    if not mask.any():
        raise MeasureError(
            f"'{field.grain.name}' disappears when its threshold or position changes by a fraction of a "
            "voxel: it is too small for an interval."
        )
    return Grain(fill_voids.fill(mask), field.grain.voxel_size, name=field.grain.name)
