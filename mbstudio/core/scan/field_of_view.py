"""The field of view: where a scan has seen something, in a box padded with one value."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy import ndimage

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.voxel_array import VoxelArray

Voxels = Shaped[np.ndarray, "Z Y X"] | VoxelArray

# An unseen margin below this share of a cross-section is no field of view but chance: columns of one
# value are chance only where they are short.
_LEAST_OUTSIDE = 0.01
_LEAST_OUTSIDE_OF_LONG, _LONG = 0.0005, 16
# So few voxels of one value are chance in any box.
_LEAST_VOXELS_OUTSIDE = 8
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
    padding : numpy scalar or None
        The value of what was not seen; None for the whole box.
    """

    axis: int
    footprint: Bool[np.ndarray, "a b"]
    shape: tuple[int, int, int]
    is_marked: bool = False
    padding: np.generic | None = None

    @property
    def is_whole_box(self) -> bool:
        return bool(self.footprint.all())

    @property
    def described(self) -> str:
        """What was seen, in words."""
        if self.is_whole_box:
            return "the whole box"
        share = float(self.footprint.mean())
        return f"a prism along {'zyx'[self.axis]} over {100 * share:.0f} % of the cross-section"

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
        rim = self.over_volume(self._edge).copy()
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
        grazing = (contact > 0) & (contact <= self._grazing_contact(voxels)) & ~at_faces
        grazing[0] = False
        if grazing.any():
            rim &= ~grazing[labels]
        return rim

    def cuts(self, mask: Bool[np.ndarray, "z y x"], box: tuple[slice, slice, slice]) -> bool:
        """Return whether a grain is cut off, as :meth:`rim_cutting` tells it of all at once.

        Parameters
        ----------
        mask : bool array
            The grain in a box that holds all of it.
        box : tuple of slice
            Where in the volume that is, both ends given.
        """
        for axis, (part, count) in enumerate(zip(box, self.shape, strict=True)):
            if part.start == 0 and mask.take(0, axis).any():
                return True
            if part.stop == count and mask.take(-1, axis).any():
                return True
        if self.is_whole_box:
            return False
        across = tuple(part for axis, part in enumerate(box) if axis != self.axis)
        contact = int(np.count_nonzero(mask & np.expand_dims(self._edge[across], self.axis)))
        if not self.is_marked:
            return contact > 0
        return contact > float(self._grazing_contact(np.array(np.count_nonzero(mask))))

    @cached_property
    def _edge(self) -> Bool[np.ndarray, "a b"]:
        """The outermost ring of the footprint."""
        inner = ndimage.binary_erosion(self.footprint, np.ones((3, 3)), border_value=0)
        edge: np.ndarray = self.footprint & ~inner
        return edge

    def _grazing_contact(self, voxels: Int[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Return how many voxels on the rim a grain of so many voxels shows that only grazes it."""
        radius = np.cbrt(3 * voxels / (4 * np.pi))
        around = np.sqrt(np.count_nonzero(self.footprint) / np.pi)
        # A cylinder that curves as the ball does lies on it longer than a plane would.
        contact: np.ndarray = (
            2 * np.pi * radius * (_RIM_THICKNESS + _GRAZE_DEPTH) / np.maximum(1 - radius / around, 0.5)
        )
        return contact


def find_field_of_view(voxels: Voxels) -> FieldOfView:
    """Find the field of view of a scan, or of a region of one; the whole box where there is none.

    Unseen are the columns along an axis that hold nothing but the value in one of the box's corners,
    as far as they hang together with the box's edge. They are believed if what is left is one
    convex cross-section that this value hardly occurs in: neither an image whose pores
    happen to be zero passes, nor a particle cut out of its surroundings, whose shadow is no field of
    view. Where a corner is no finite number, all that are none count as unseen.

    Parameters
    ----------
    voxels : array or VoxelArray, shape (Z, Y, X)
    """
    nz, ny, nx = voxels.shape
    best = FieldOfView(0, np.ones((ny, nx), dtype=bool), (nz, ny, nx))
    for padding in _possible_paddings(voxels):
        best = _narrower(voxels, padding, best)
    return best


def _possible_paddings(voxels: Voxels) -> list[np.generic]:
    """Return the values of corners that could pad a box: of the first one, and what fills an edge of it.

    A box cut out of a padded one may begin within the field of view; but wherever it reaches
    outside, one of its corners does, with all of an edge.
    """
    nz = voxels.shape[0]
    first, last = np.asarray(voxels[0]), np.asarray(voxels[nz - 1])
    columns = np.stack([np.asarray(voxels[z])[[0, 0, -1, -1], [0, -1, 0, -1]] for z in range(nz)])
    edges = list(columns.T)
    for image in (first, last):
        edges += [image[0], image[-1], image[:, 0], image[:, -1]]
    found = [first[0, 0]]
    for edge in edges:
        value = edge[0]
        alike = (edge == value) if np.isfinite(value) else ~np.isfinite(edge)
        if alike.all() and not any(_is_same(value, other) for other in found):
            found.append(value)
    return found


def _is_same(value: np.generic, other: np.generic) -> bool:
    """Whether two values pad alike: equal, or both no finite numbers."""
    return bool(value == other) or not (np.isfinite(value) or np.isfinite(other))


def _narrower(voxels: Voxels, padding: np.generic, best: FieldOfView) -> FieldOfView:
    """Return the field of view that a value pads, if it is believed and sees less than the best so far."""
    nz, ny, nx = voxels.shape
    has_gaps = not np.isfinite(padding)
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
    for axis, unseen in enumerate((along_z, along_y, along_x)):
        footprint = _find_cross_section(unseen, _least_outside(voxels.shape, axis, has_gaps))
        if footprint is not None and footprint.mean() < best.footprint.mean():
            candidate = FieldOfView(axis, footprint, (nz, ny, nx), has_gaps, padding)
            if _is_filled(voxels, candidate, padding):
                best = candidate
    return best


def _least_outside(shape: tuple[int, ...], axis: int, has_gaps: bool) -> float:
    """Return the share of a cross-section that must be unseen for a field of view."""
    if has_gaps:
        return 0.0
    share = _LEAST_OUTSIDE_OF_LONG if shape[axis] >= _LONG else _LEAST_OUTSIDE
    return max(share, _LEAST_VOXELS_OUTSIDE / math.prod(shape))


def _is_filled(voxels: Voxels, view: FieldOfView, padding: np.generic) -> bool:
    """Return whether little of what pads the box is within a field of view."""
    seen = view.mask
    padded = sum(
        int(np.count_nonzero((np.asarray(voxels[z]) == padding) & seen[z])) for z in range(view.shape[0])
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
            raise ScanError(_describe_gaps(voxels, view, name))
        low = min(low, float(part.min(where=finite, initial=np.inf)))
    if not has_gaps:
        return voxels
    return np.where(np.isfinite(voxels), voxels, voxels.dtype.type(low))


def _describe_gaps(voxels: Shaped[np.ndarray, "Z Y X"], view: FieldOfView, name: object) -> str:
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
    where = f"{name} contains voxels that are not finite numbers inside what was scanned ({count:,}, {box})"
    if empty:
        told = ", ".join(map(str, empty[:5])) + (", ..." if len(empty) > 5 else "")
        return (
            f"{where}, among them whole slices (z = {told}): leave those slices out, and open the scan again."
        )
    return f"{where}: replace them, for example by the grey value of the void, and open the scan again."


def _find_cross_section(unseen: Bool[np.ndarray, "a b"], least: float) -> Bool[np.ndarray, "a b"] | None:
    """Return the cross-section that is seen, None if it makes no field of view.

    `least` is the share of the cross-section below which what is unseen does not count.
    """
    from skimage.morphology import convex_hull_image

    if not unseen.any():
        return None
    pieces, _ = ndimage.label(unseen)
    edge = np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]])
    outside = np.isin(pieces, np.unique(edge[edge > 0]))
    seen = ~outside
    if outside.mean() < least or not seen.any():
        return None
    if seen.sum() < _LEAST_SOLIDITY * convex_hull_image(seen).sum():
        return None
    return seen
