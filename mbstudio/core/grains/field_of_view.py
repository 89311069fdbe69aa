"""The field of view: where a scan has seen something, in a box padded with one value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Shaped
from scipy import ndimage

# An unseen margin below this share of a cross-section is no field of view but chance.
_LEAST_OUTSIDE = 0.01
# How convex the seen cross-section must be: a disk on the pixel grid is above 0.98, the grains of
# an image whose pores are all zero are far below.
_LEAST_SOLIDITY = 0.95


@dataclass(frozen=True, eq=False)
class FieldOfView:
    """What a scanner has seen of its box: a prism, mostly a cylinder, along one axis.

    Attributes
    ----------
    axis : int
        Axis of the array along which it runs.
    footprint : bool array
        Its cross-section, over the two other axes.
    shape : tuple of int
        (Z, Y, X) of the scan.
    """

    axis: int
    footprint: Bool[np.ndarray, "a b"]
    shape: tuple[int, int, int]

    @property
    def is_whole_box(self) -> bool:
        return bool(self.footprint.all())

    @property
    def mask(self) -> Bool[np.ndarray, "Z Y X"]:
        """The field of view as a mask (a read-only view that takes no memory)."""
        return self.over_volume(self.footprint)

    def over_volume(self, image: Shaped[np.ndarray, "a b"]) -> Shaped[np.ndarray, "Z Y X"]:
        """Return an image over the cross-section as a read-only view of the volume's shape."""
        return np.broadcast_to(np.expand_dims(image, self.axis), self.shape)

    @property
    def rim(self) -> Bool[np.ndarray, "Z Y X"]:
        """Voxels where a grain is cut off: the box's faces, and what borders on the unseen."""
        inner = ndimage.binary_erosion(self.footprint, np.ones((3, 3)), border_value=0)
        rim = self.over_volume(self.footprint & ~inner).copy()
        for axis in range(3):
            for end in (0, -1):
                rim[(slice(None),) * axis + (end,)] = True
        return rim


def find_field_of_view(voxels: Shaped[np.ndarray, "Z Y X"]) -> FieldOfView:
    """Find the field of view of a scan; the whole box where there is none.

    Unseen are the columns along an axis that hold nothing but the value in the box's corner,
    as far as they hang together with the box's edge. They are believed if what is left is one
    convex cross-section: an image whose pores happen to be zero does not pass.
    """
    nz, ny, nx = voxels.shape
    padding = voxels[0, 0, 0]
    along_z = np.ones((ny, nx), dtype=bool)
    along_y = np.ones((nz, nx), dtype=bool)
    along_x = np.ones((nz, ny), dtype=bool)
    for z in range(nz):
        unseen = np.asarray(voxels[z]) == padding
        along_z &= unseen
        along_y[z] = unseen.all(axis=0)
        along_x[z] = unseen.all(axis=1)
    # A cylinder lies in a box seen from the side, too: the axis along which most is unseen is its own.
    best = FieldOfView(0, np.ones((ny, nx), dtype=bool), (nz, ny, nx))
    for axis, unseen in enumerate((along_z, along_y, along_x)):
        footprint = _find_cross_section(unseen)
        if footprint is not None and footprint.mean() < best.footprint.mean():
            best = FieldOfView(axis, footprint, (nz, ny, nx))
    return best


def _find_cross_section(unseen: Bool[np.ndarray, "a b"]) -> Bool[np.ndarray, "a b"] | None:
    """Return the cross-section that is seen, None if it makes no field of view."""
    from skimage.morphology import convex_hull_image

    if not unseen.any():
        return None
    pieces, _ = ndimage.label(unseen)
    edge = np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]])
    outside = np.isin(pieces, np.unique(edge[edge > 0]))
    seen = ~outside
    if outside.mean() < _LEAST_OUTSIDE or not seen.any():
        return None
    if seen.sum() < _LEAST_SOLIDITY * convex_hull_image(seen).sum():
        return None
    return seen
