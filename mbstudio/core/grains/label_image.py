"""Label images made elsewhere (ilastik, Avizo, Dragonfly, ...), taken over as grains."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import cc3d
import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import GrainWarning, SegmentationError
from mbstudio.core.grains.field_of_view import find_field_of_view
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.grains.labelling import build_grain_set, statistics, widened_box
from mbstudio.core.grains.pieces import label_pieces
from mbstudio.core.scan.opening import open_scan
from mbstudio.core.scan.scan import Scan
from mbstudio.core.units import VoxelSize

if TYPE_CHECKING:
    from mbstudio.core.grains.field_of_view import FieldOfView


def load_labels(
    source: str | Path | np.ndarray,
    scan: Scan | None = None,
    voxel_size: str | float | Sequence[float] | VoxelSize | None = None,
    *,
    unit: str | None = None,
) -> GrainSet:
    """Take over a label image made elsewhere.

    Parameters
    ----------
    source : str, Path or array, shape (Z, Y, X)
        Whole numbers, 0 outside all grains; any file that `open_scan` reads.
    scan : Scan, optional
        The scan that the labels belong to: it must have their shape, and gives voxel size,
        origin and field of view.
    voxel_size : str, float, sequence of float or VoxelSize, optional
        Needed without `scan`, unless the file says it.

    Returns
    -------
    GrainSet
        Labels renumbered 1..N in the order of the original numbers. An image of two values
        holds no single grains but a mask: its 26-connected pieces become the grains. Where
        one number names several pieces, the largest is kept and the rest dropped, with a
        `GrainWarning`.

    Raises
    ------
    SegmentationError
        If the image holds no whole numbers, negative ones, no grain, or does not fit the scan.
    UnitError
        If the voxel size is not known.
    """
    image, size, origin, name = _read_image(source, scan, voxel_size, unit)
    labels = _whole_numbers(image, name)
    if scan is not None and labels.shape != scan.shape:
        raise SegmentationError(
            f"{name} has shape {labels.shape}, but the scan has {scan.shape} (z, y, x): "
            "labels must cover the same voxels."
        )
    if scan is not None:
        size, origin = scan.voxel_size, scan.origin
    assert size is not None
    values = np.unique(labels)
    values = values[values > 0]
    if not len(values):
        raise SegmentationError(
            f"{name} contains no grain: every voxel is 0. Check that the right file was exported."
        )
    numbered = np.searchsorted(values, labels).astype(np.int32) + 1
    numbered[labels == 0] = 0
    if len(values) == 1:
        numbered = cc3d.connected_components(numbered, connectivity=26, out_dtype=np.uint32).astype(np.int32)
    _keep_largest_pieces(numbered, name)
    view: FieldOfView | None = find_field_of_view(scan.load()) if scan is not None else None
    return build_grain_set(numbered, size, origin, view.rim if view is not None else None)


def _read_image(
    source: str | Path | np.ndarray,
    scan: Scan | None,
    voxel_size: str | float | Sequence[float] | VoxelSize | None,
    unit: str | None,
) -> tuple[np.ndarray, VoxelSize | None, tuple[float, float, float], str]:
    """Return the image, its voxel size and origin, and what to call it in messages."""
    if voxel_size is None and scan is not None:
        voxel_size = scan.voxel_size
    if isinstance(source, str | Path):
        opened = open_scan(source, voxel_size, unit=unit)
        return np.asarray(opened.voxels), opened.voxel_size, opened.origin, str(source)
    if voxel_size is None:
        raise SegmentationError(
            "The labels have no voxel size: give scan or voxel_size, for example '14 um'."
        )
    return np.asarray(source), VoxelSize.parse(voxel_size, unit), (0.0, 0.0, 0.0), "The label image"


def _whole_numbers(image: np.ndarray, name: str) -> Int[np.ndarray, "Z Y X"]:
    """Return the image as whole numbers."""
    if image.ndim != 3 or 0 in image.shape:
        raise SegmentationError(
            f"{name} has shape {image.shape}: labels need three axes (z, y, x), none empty."
        )
    if image.dtype.kind == "f":
        if not np.isfinite(image).all() or not (image == np.rint(image)).all():
            raise SegmentationError(f"{name} holds values that are not whole numbers: give a label image.")
        image = image.astype(np.int64)
    elif image.dtype.kind == "b":
        image = image.astype(np.uint8)
    elif image.dtype.kind not in "ui":
        raise SegmentationError(f"{name} holds {image.dtype}: labels are whole numbers.")
    if image.dtype.kind == "i" and image.min() < 0:
        raise SegmentationError(
            f"{name} holds negative numbers: labels start at 1, with 0 outside all grains."
        )
    return image


def _keep_largest_pieces(labels: Int[np.ndarray, "Z Y X"], name: str) -> None:
    """Keep the largest 26-connected piece of each label, in place; warn of what is dropped."""
    _, boxes, _, _ = statistics(labels)
    broken, dropped = 0, 0
    for label, row in enumerate(boxes, start=1):
        part = labels[widened_box(row)]
        inside = part == label
        pieces, sizes = label_pieces(inside)
        if len(sizes) > 1:
            part[inside & (pieces != 1 + int(sizes.argmax()))] = 0
            broken += 1
            dropped += int(sizes.sum() - sizes.max())
    if broken:
        warnings.warn(
            f"{name}: {broken} labels were in several pieces; the largest of each was kept and "
            f"{dropped:,} voxels dropped.",
            GrainWarning,
            stacklevel=3,
        )
