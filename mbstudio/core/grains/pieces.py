"""Connected pieces and cavities of masks; 26-connected grains, so 6-connected background."""

from __future__ import annotations

import cc3d
import fill_voids
import numpy as np
from jaxtyping import Bool, Int


def label_pieces(mask: Bool[np.ndarray, "Z Y X"]) -> tuple[Int[np.ndarray, "Z Y X"], Int[np.ndarray, "n"]]:
    """Return the 26-connected pieces, numbered from 1, and their numbers of voxels."""
    solid = np.ascontiguousarray(mask)
    if 1 in solid.shape:
        # cc3d's way for truth values expects too few pieces of a row of voxels, and gives up.
        solid = solid.astype(np.uint8)
    pieces, count = cc3d.connected_components(solid, connectivity=26, return_N=True)
    return pieces, np.bincount(pieces.ravel(), minlength=count + 1)[1:]


def largest_piece(mask: Bool[np.ndarray, "Z Y X"]) -> Bool[np.ndarray, "Z Y X"]:
    """Return the largest 26-connected piece of a mask that is not empty."""
    pieces, sizes = label_pieces(mask)
    return mask if len(sizes) == 1 else pieces == 1 + int(sizes.argmax())


def without_cavities(mask: Bool[np.ndarray, "Z Y X"]) -> Bool[np.ndarray, "Z Y X"]:
    """Return the mask with its enclosed cavities filled."""
    filled: np.ndarray = fill_voids.fill(np.asfortranarray(mask)).astype(bool)
    return filled


def bounding_box(mask: Bool[np.ndarray, "Z Y X"]) -> tuple[slice, slice, slice]:
    """Return the smallest box that holds a mask that is not empty."""
    box = []
    for axis in range(3):
        others = tuple(other for other in range(3) if other != axis)
        filled = np.flatnonzero(mask.any(axis=others))
        box.append(slice(int(filled[0]), int(filled[-1]) + 1))
    return box[0], box[1], box[2]
