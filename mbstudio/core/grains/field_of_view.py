"""The field of view: where a scan has seen something, in a box padded with one value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int, Shaped
from scipy import ndimage

from mbstudio.core.errors import ScanError

# An unseen margin below this share of a cross-section is no field of view but chance.
_LEAST_OUTSIDE = 0.01
# How convex the seen cross-section must be: a disk on the pixel grid is above 0.98, the grains of
# an image whose pores are all zero are far below.
_LEAST_SOLIDITY = 0.95
# Share of the voxels within a field of view that may have the value of the padding by chance.
_MOST_PADDING = 0.05

# Mean thickness of the ring of voxels that border on the outside of a disk, corners included.
_RIM_THICKNESS = 4 / np.pi
# How deep, in voxels, a rim may cut into a grain that counts as whole.
_GRAZE_DEPTH = 0.5


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
    is_marked : bool
        Whether the file itself marks what was not seen, as no number: then the outermost seen
        voxels are measured ones, as good as any other.
    """

    axis: int
    footprint: Bool[np.ndarray, "a b"]
    shape: tuple[int, int, int]
    is_marked: bool = False

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

    def rim_cutting(self, labels: Int[np.ndarray, "Z Y X"]) -> Bool[np.ndarray, "Z Y X"]:
        """Return the rim without the voxels of grains that only graze it.

        Where the unseen is marked, a grain that shows no more voxels on the rim than a ball of its
        size of which it cuts off half a voxel's depth counts as whole: what it has lost is within
        the accuracy of its surface.
        """
        rim = self.rim
        if not self.is_marked or self.is_whole_box:
            return rim
        voxels = np.bincount(labels.ravel())
        contact = np.bincount(labels[rim], minlength=len(voxels))
        at_faces = np.zeros(len(voxels), bool)
        for axis in range(3):
            for end in (0, -1):
                at_faces[np.unique(labels.take(end, axis))] = True
        radius = np.cbrt(3 * voxels / (4 * np.pi))
        around = np.sqrt(np.count_nonzero(self.footprint) / np.pi)
        # A cylinder that curves as the ball does lies on it longer than a plane would.
        touch = 2 * np.pi * radius * (_RIM_THICKNESS + _GRAZE_DEPTH) / np.maximum(1 - radius / around, 0.5)
        grazing = (contact > 0) & (contact <= touch) & ~at_faces
        grazing[0] = False
        if grazing.any():
            rim &= ~grazing[labels]
        return rim


def find_field_of_view(voxels: Shaped[np.ndarray, "Z Y X"]) -> FieldOfView:
    """Find the field of view of a scan; the whole box where there is none.

    Unseen are the columns along an axis that hold nothing but the value in the box's corner,
    as far as they hang together with the box's edge. They are believed if what is left is one
    convex cross-section that the value in the corner hardly occurs in: neither an image whose pores
    happen to be zero passes, nor a particle cut out of its surroundings, whose shadow is no field of
    view. Where the corner is no finite number, all that are none count as unseen.
    """
    nz, ny, nx = voxels.shape
    padding = voxels[0, 0, 0]
    has_gaps = voxels.dtype.kind == "f" and not np.isfinite(padding)
    along_z = np.ones((ny, nx), dtype=bool)
    along_y = np.ones((nz, nx), dtype=bool)
    along_x = np.ones((nz, ny), dtype=bool)
    for z in range(nz):
        part = np.asarray(voxels[z])
        unseen = ~np.isfinite(part) if has_gaps else part == padding
        along_z &= unseen
        along_y[z] = unseen.all(axis=0)
        along_x[z] = unseen.all(axis=1)
    # A cylinder lies in a box seen from the side, too: the axis along which most is unseen is its own.
    best = FieldOfView(0, np.ones((ny, nx), dtype=bool), (nz, ny, nx))
    for axis, unseen in enumerate((along_z, along_y, along_x)):
        footprint = _find_cross_section(unseen)
        if footprint is not None and footprint.mean() < best.footprint.mean():
            candidate = FieldOfView(axis, footprint, (nz, ny, nx), has_gaps)
            if _is_filled(voxels, candidate, padding):
                best = candidate
    return best


def _is_filled(voxels: Shaped[np.ndarray, "Z Y X"], view: FieldOfView, padding: np.generic) -> bool:
    """Return whether little of what pads the box is within a field of view."""
    seen = view.mask
    padded = sum(
        int(np.count_nonzero((part == padding) & row)) for part, row in zip(voxels, seen, strict=True)
    )
    return padded <= _MOST_PADDING * int(np.count_nonzero(view.footprint)) * view.shape[view.axis]


def with_numbers_only(
    voxels: Shaped[np.ndarray, "Z Y X"], view: FieldOfView, name: object
) -> Shaped[np.ndarray, "Z Y X"]:
    """Return voxels whose unseen ones that are no finite numbers have the smallest grey value instead.

    Parameters
    ----------
    voxels : array, shape (Z, Y, X)
        Returned as it is where all of its voxels are finite.
    view : FieldOfView
    name : object
        What to call the scan in messages.

    Raises
    ------
    ScanError
        If voxels inside the field of view are no finite numbers; it says where.
    """
    if voxels.dtype.kind != "f":
        return voxels
    low, has_gaps = np.inf, False
    for part, seen in zip(voxels, view.mask, strict=True):
        finite = np.isfinite(part)
        if finite.all():
            low = min(low, float(part.min()))
            continue
        has_gaps = True
        if (seen & ~finite).any():
            raise ScanError(_where_no_numbers(voxels, view, name))
        low = min(low, float(part.min(where=finite, initial=np.inf)))
    if not has_gaps:
        return voxels
    return np.where(np.isfinite(voxels), voxels, voxels.dtype.type(low))


def _where_no_numbers(voxels: Shaped[np.ndarray, "Z Y X"], view: FieldOfView, name: object) -> str:
    """Return the message on voxels of the field of view that are no finite numbers."""
    count, empty = 0, []
    low, high = np.array(voxels.shape), np.zeros(3, int)
    for z, (part, seen) in enumerate(zip(voxels, view.mask, strict=True)):
        gaps = seen & ~np.isfinite(part)
        if not gaps.any():
            continue
        count += int(np.count_nonzero(gaps))
        if not np.isfinite(part).any():
            empty.append(z)
        places = np.argwhere(gaps)
        low = np.minimum(low, [z, *places.min(axis=0)])
        high = np.maximum(high, [z, *places.max(axis=0)])
    box = ", ".join(f"{axis} {first} to {last}" for axis, first, last in zip("zyx", low, high, strict=True))
    where = f"{name} holds voxels that are not finite numbers inside what was scanned ({count:,}, {box})"
    if empty:
        told = ", ".join(map(str, empty[:5])) + (", ..." if len(empty) > 5 else "")
        return (
            f"{where}, among them whole slices (z = {told}): leave those slices out, and open the scan again."
        )
    return f"{where}: replace them, for example by the grey value of the void, and open the scan again."


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
