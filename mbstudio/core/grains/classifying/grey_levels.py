"""Grey values of a scan on a scale of its own, and what lies about each place in the wide.

The scale runs from 0 (the dark end of what the scan shows) to 1 (the bright end), so that a classifier that
was learned in one scan can be used in another of another grey range.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float32, Shaped
from scipy import ndimage

from mbstudio.core.errors import ScanError
from mbstudio.core.grains.editing.label_volume import Box
from mbstudio.core.scan.field_of_view import FieldOfView, find_field_of_view
from mbstudio.core.scan.scan import Scan
from mbstudio.core.scan.voxel_array import VoxelArray

CELL = 4
"""Voxels to an edge of the grid on which the wide surroundings are kept."""
_ENDS = (0.01, 0.99)  # quantiles that become 0 and 1
_REACH = 2.0  # grey values further than this beyond the ends are taken for this far
_BOXES, _BOX_EDGE = 4, 24  # along each axis: boxes that are looked at for the ends, and their edge in voxels
_SMOOTHED = 1.0  # voxels: over which noise is averaged before ends and extremes are taken
_SLAB_CELLS = 8
_WIDE = 3  # cells to each side in which the darkest and the brightest are looked for


@dataclass(frozen=True, eq=False)
class GreyLevels:
    """The grey values of a scan from 0 to 1, and their surroundings.

    Attributes
    ----------
    voxels : VoxelArray, shape (Z, Y, X)
    view : FieldOfView
        Voxels outside it count as 0.
    edges : tuple of float
        Edges (z, y, x) of a voxel over its shortest.
    low, high : float
        The grey values that become 0 and 1.
    surroundings : float32 array, shape (3, a, b, c)
        On cells of `CELL` voxels: mean, darkest and brightest value in the wide.
    """

    voxels: VoxelArray
    view: FieldOfView
    edges: tuple[float, float, float]
    low: float
    high: float
    surroundings: Float32[np.ndarray, "3 a b c"] = field(repr=False)

    @classmethod
    def of(
        cls, scan: Scan, voxels: Shaped[np.ndarray, "Z Y X"] | None = None, view: FieldOfView | None = None
    ) -> GreyLevels:
        """Look a scan through, slab by slab.

        Parameters
        ----------
        scan : Scan
        voxels : array, shape (Z, Y, X), optional
            Its voxels, where they were mended.
        view : FieldOfView, optional
            Where it is known.

        Raises
        ------
        ScanError
            If the scan is constant.
        """
        source: VoxelArray = scan.voxels if voxels is None else voxels
        seen = find_field_of_view(source) if view is None else view
        shortest = min(scan.voxel_size.zyx)
        z, y, x = (edge / shortest for edge in scan.voxel_size.zyx)
        low, high = _find_ends(source, seen)
        if not high > low:
            raise ScanError(
                f"{scan.path or 'The scan'} is constant: every voxel is {low:g}. "
                "Check that the right file was exported."
            )
        edges = (z, y, x)
        empty = np.zeros((3, 1, 1, 1), np.float32)
        bare = cls(source, seen, edges, low, high, empty)
        return cls(source, seen, edges, low, high, _look_around(bare))

    @property
    def shape(self) -> tuple[int, int, int]:
        nz, ny, nx = self.voxels.shape
        return nz, ny, nx

    def read(self, box: Box, margin: tuple[int, int, int]) -> Float32[np.ndarray, "z y x"]:
        """Return a box with a margin about it; beyond the scan its outermost voxels go on.

        Parameters
        ----------
        box : tuple of slice
            Within the scan, both ends given.
        margin : tuple of int
            Voxels along z, y, x.
        """
        z, y, x = (
            slice(max(part.start - more, 0), min(part.stop + more, count))
            for part, more, count in zip(box, margin, self.shape, strict=True)
        )
        found = np.asarray(self.voxels[z, y, x], dtype=np.float32)
        grey = (found - np.float32(self.low)) / np.float32(self.high - self.low)
        np.nan_to_num(grey, copy=False, nan=0.0, posinf=_REACH, neginf=-_REACH)
        np.clip(grey, -_REACH, 1.0 + _REACH, out=grey)
        if not self.view.is_whole_box:
            grey *= self.view.mask[z, y, x]
        pads = [
            (max(0, more - part.start), max(0, part.stop + more - count))
            for part, more, count in zip(box, margin, self.shape, strict=True)
        ]
        if any(before or after for before, after in pads):
            grey = np.pad(grey, pads, mode="edge")
        return np.ascontiguousarray(grey)


def _find_ends(voxels: VoxelArray, view: FieldOfView) -> tuple[float, float]:
    """Return the grey values between which nearly all lies that is no noise."""
    kept = []
    for z in _starts(voxels.shape[0]):
        for y in _starts(voxels.shape[1]):
            for x in _starts(voxels.shape[2]):
                box = tuple(slice(start, start + _BOX_EDGE) for start in (z, y, x))
                part = np.asarray(voxels[box], dtype=np.float32)
                seen = view.mask[box] & np.isfinite(part)
                if not seen.any():
                    continue
                part = np.where(seen, part, part[seen].mean())
                kept.append(ndimage.gaussian_filter(part, _SMOOTHED, mode="nearest")[seen])
    if not kept:
        return 0.0, 0.0
    every = np.concatenate(kept)
    low, high = np.quantile(every, _ENDS)
    if low == high:  # the few others are what there is to see
        return float(every.min()), float(every.max())
    return float(low), float(high)


def _starts(count: int) -> list[int]:
    """Return where boxes begin along an axis, evenly spread."""
    last = max(0, count - _BOX_EDGE)
    return sorted({round(share * last) for share in np.linspace(0, 1, _BOXES)})


def _look_around(levels: GreyLevels) -> Float32[np.ndarray, "3 a b c"]:
    """Return mean, darkest and brightest value in the wide, on cells."""
    shape = tuple(-(-count // CELL) for count in levels.shape)
    cells = np.zeros((3, *shape), np.float32)
    reach = int(np.ceil(4 * _SMOOTHED)) + 1
    for first in range(0, shape[0], _SLAB_CELLS):
        last = min(first + _SLAB_CELLS, shape[0])
        box = (
            slice(first * CELL, min(last * CELL, levels.shape[0])),
            slice(0, levels.shape[1]),
            slice(0, levels.shape[2]),
        )
        grey = levels.read(box, (reach, 0, 0))
        grey = ndimage.gaussian_filter(grey, [_SMOOTHED / edge for edge in levels.edges], mode="nearest")
        grey = grey[reach : len(grey) - reach]
        padded = np.pad(grey, [(0, -count % CELL) for count in grey.shape], mode="edge")
        blocks = padded.reshape([n for count in padded.shape for n in (count // CELL, CELL)])
        cells[0, first:last] = blocks.mean(axis=(1, 3, 5))
        cells[1, first:last] = blocks.min(axis=(1, 3, 5))
        cells[2, first:last] = blocks.max(axis=(1, 3, 5))
    widths = [max(1, round(_WIDE / edge)) for edge in levels.edges]
    size = [2 * width + 1 for width in widths]
    cells[0] = ndimage.gaussian_filter(cells[0], [_WIDE / edge for edge in levels.edges], mode="nearest")
    for place, extreme in ((1, ndimage.minimum_filter), (2, ndimage.maximum_filter)):
        cells[place] = ndimage.gaussian_filter(
            extreme(cells[place], size=size, mode="nearest"), [_WIDE / 2 / edge for edge in levels.edges],
            mode="nearest",
        )  # fmt: skip
    return cells
