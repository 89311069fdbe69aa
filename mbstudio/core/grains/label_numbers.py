"""What the numbers of a label image are: grains one by one, classes of material, or a mask."""

from __future__ import annotations

import warnings

import numpy as np
from jaxtyping import Bool, Int, Shaped

from mbstudio.core.errors import GrainWarning, SegmentationError
from mbstudio.core.grains.labelling import statistics, widened_box
from mbstudio.core.grains.pieces import label_pieces

# An image of so few numbers, of which so much does not hang together, holds classes of material.
_FEW_CLASSES = 10
_SCATTERED = 0.2
# A number that fills so much of an image without zeros, and reaches its faces, is the surroundings.
_SURROUNDINGS = 0.2
_HOW_TO_PART = (
    "export the numbers of single grains (in ilastik: Object Identities), or open the file as the scan "
    "itself, "
    "so that mbstudio finds the grains"
)


def whole_numbers(image: Shaped[np.ndarray, "..."], name: str) -> Int[np.ndarray, "Z Y X"]:
    """Return a label image as whole numbers, 0 where it holds no number.

    Raises
    ------
    SegmentationError
        If the image has not three axes, or holds fractions or negative numbers.
    """
    if image.ndim != 3 or 0 in image.shape:
        raise SegmentationError(
            f"{name} has shape {image.shape}: labels need three axes (z, y, x), none empty."
        )
    if image.dtype.kind == "f":
        unlabelled = np.isnan(image)
        if unlabelled.all():
            raise SegmentationError(f"{name} contains only NaN: give a label image.")
        if unlabelled.any():
            image = np.where(unlabelled, 0, image)
        if not np.isfinite(image).all() or not (image == np.rint(image)).all():
            raise SegmentationError(f"{name} contains values that are not whole numbers: give a label image.")
        if np.abs(image).max() >= 2.0 ** (24 if image.dtype.itemsize == 4 else 53):
            raise SegmentationError(
                f"{name} contains numbers too large for its type {image.dtype}, in which neighbouring "
                "numbers become one: export the labels as 32-bit whole numbers."
            )
        image = image.astype(np.int64)
    elif image.dtype.kind == "b":
        image = image.astype(np.uint8)
    elif image.dtype.kind not in "ui":
        raise SegmentationError(f"{name} has type {image.dtype}: labels are whole numbers.")
    if image.dtype.kind == "i" and image.min() < 0:
        raise SegmentationError(
            f"{name} contains negative numbers: labels start at 1, and 0 is outside all grains."
        )
    return image


def consecutive(labels: Int[np.ndarray, "Z Y X"], name: str) -> tuple[Int[np.ndarray, "Z Y X"], int]:
    """Return labels renumbered 1..N in their order, and N; SegmentationError if there is no grain."""
    values = np.unique(labels)
    values = values[values > 0]
    if not len(values):
        raise SegmentationError(
            f"{name} contains no grain: every voxel is 0. Check that the right file was exported."
        )
    if len(values) >= 2**31:
        raise SegmentationError(f"{name} contains {len(values):,} different numbers: give a label image.")
    numbered = np.searchsorted(values, labels).astype(np.int32) + 1
    numbered[labels == 0] = 0
    return numbered, len(values)


def require_surroundings(numbered: Int[np.ndarray, "Z Y X"], name: str) -> None:
    """Refuse an image in which a number, and not 0, is the surroundings of the grains.

    Raises
    ------
    SegmentationError
        If a number reaches most of the box's faces and fills a good part of it, and 0 reaches
        none; or if there is one number and nothing else.
    """
    faces = [
        numbered[0],
        numbered[-1],
        numbered[:, 0],
        numbered[:, -1],
        numbered[:, :, 0],
        numbered[:, :, -1],
    ]
    if any(bool((face == 0).any()) for face in faces):
        return
    counts = np.bincount(numbered.ravel())[1:]
    largest = int(counts.argmax()) + 1
    reached = sum(bool((face == largest).any()) for face in faces)
    if reached < 5 or counts[largest - 1] <= _SURROUNDINGS * numbered.size:
        return
    what = (
        "classes of material, such as ilastik's Simple Segmentation, not single grains"
        if len(counts) <= _FEW_CLASSES
        else "grains whose surroundings have a number, too"
    )
    raise SegmentationError(
        f"{name} contains no 0 around its grains: one of its {len(counts)} numbers fills "
        f"{counts[largest - 1] / numbered.size:.0%} of it and surrounds the others, so these are {what}. "
        f"Set the surroundings to 0, or {_HOW_TO_PART}."
    )


def keep_largest_pieces(numbered: Int[np.ndarray, "Z Y X"], count: int, name: str) -> None:
    """Keep the largest 26-connected piece of each label, in place; warn of what is dropped.

    Raises
    ------
    SegmentationError
        If there are few labels and much of them hangs together with nothing: they are classes.
    """
    labelled = int(np.count_nonzero(numbered))
    _, boxes, _, _ = statistics(numbered)
    broken, dropped = 0, 0
    fragments: list[tuple[tuple[slice, slice, slice], Bool[np.ndarray, "z y x"]]] = []
    for label, row in enumerate(boxes, start=1):
        box = widened_box(row)
        inside = numbered[box] == label
        pieces, sizes = label_pieces(inside)
        if len(sizes) > 1:
            fragments.append((box, inside & (pieces != 1 + int(sizes.argmax()))))
            broken += 1
            dropped += int(sizes.sum() - sizes.max())
    if not broken:
        return
    if count <= _FEW_CLASSES and dropped > _SCATTERED * labelled:
        raise SegmentationError(
            f"{name} contains {count} numbers whose voxels lie in many pieces ({dropped / labelled:.0%} of "
            "them apart "
            f"from the largest): these are classes of material, not single grains; {_HOW_TO_PART}."
        )
    for box, fragment in fragments:
        numbered[box][fragment] = 0
    warnings.warn(
        f"{name}: {broken} labels were in several pieces; the largest piece of each was kept and "
        f"{dropped:,} voxels dropped.",
        GrainWarning,
        stacklevel=3,
    )
