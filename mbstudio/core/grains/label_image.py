"""Label images made elsewhere (ilastik, Avizo, Dragonfly, ...), taken over as grains."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from mbstudio.core.errors import GrainWarning, SegmentationError, UnitError
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.grains.judging import judge_labels
from mbstudio.core.grains.label_numbers import (
    consecutive,
    keep_largest_pieces,
    require_surroundings,
    whole_numbers,
)
from mbstudio.core.grains.label_placement import differs_in_size, lay_on_scan, require_no_better_order
from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.grains.pieces import label_pieces
from mbstudio.core.grains.segmentation import part_mask
from mbstudio.core.grains.verdict import SegmentationVerdict
from mbstudio.core.scan.field_of_view import FieldOfView, find_field_of_view, with_numbers_only
from mbstudio.core.scan.grid import Grid
from mbstudio.core.scan.opening import place, read_file
from mbstudio.core.scan.readers import ReadOptions
from mbstudio.core.scan.scan import Scan
from mbstudio.core.units import VoxelSize

# How readily touching grains are parted to see whether a mask holds such.
_USUAL_SPLITTING = 0.75


def load_labels(
    source: str | Path | np.ndarray,
    scan: Scan | None = None,
    voxel_size: str | float | Sequence[float] | VoxelSize | None = None,
    *,
    unit: str | None = None,
    splitting: float | None = None,
) -> GrainSet:
    """Take over a label image made elsewhere.

    Parameters
    ----------
    source : str, Path or array, shape (Z, Y, X)
        Whole numbers, 0 (or NaN) outside all grains; any file that `open_scan` reads.
    scan : Scan, optional
        The scan that the labels belong to: it gives voxel size, origin and field of view. Labels
        whose file says that they lie turned, flipped or on a part of the scan are brought onto it.
    voxel_size : str, float, sequence of float or VoxelSize, optional
        Needed without `scan`, unless the file says it.
    splitting : float, optional
        How readily touching grains of a mask (an image of one number) are parted, 0 to 1, as in
        `SegmentationSettings`; without it they stay together.

    Returns
    -------
    GrainSet
        Labels renumbered 1..N in the order of the original numbers. An image of two values
        holds no single grains but a mask: its 26-connected pieces become the grains, with a
        `GrainWarning` if some of these seem to be grains that touch. Where one number names
        several pieces, the largest is kept and the rest dropped, with a `GrainWarning`.

    Raises
    ------
    SegmentationError
        If the image holds no whole numbers, negative ones, no grain, classes of material instead
        of grains, or does not fit the scan.
    UnitError
        If the voxel size is not known.
    """
    image = _read_image(source, scan, voxel_size, unit)
    name = image.name
    labels = whole_numbers(image.stored, name)
    if image.white_is_zero:
        labels = _black_is_zero(labels, name)
    size, origin = image.size, image.origin
    if scan is not None:
        if isinstance(source, np.ndarray) and labels.shape == scan.shape:
            notes: tuple[str, ...] = ()  # made of the scan's own array, in its order
            require_no_better_order(labels, scan, name)
        else:
            labels, notes = lay_on_scan(labels, image.grid, scan, name)
        if size is not None and differs_in_size(size, scan.voxel_size):
            _warn(
                f"{name} says that its voxels are {size}, the scan's are {scan.voxel_size}: the scan's "
                "are taken."
            )
        for note in notes:
            _warn(f"{name} {note}")
        size, origin = scan.voxel_size, scan.origin
    elif image.grid is not None:
        labels = image.grid.as_read(labels)
    assert size is not None
    numbered, count = consecutive(labels, name)
    require_surroundings(numbered, name)
    if count == 1:
        numbered = _grains_of_mask(numbered > 0, size, splitting, name)
    else:
        keep_largest_pieces(numbered, count, name)
    if scan is None:
        return build_grain_set(numbered, size, origin)
    view = find_field_of_view(scan.load())
    verdict = _judged(numbered, scan, view)
    grains = build_grain_set(numbered, size, origin, view.rim_cutting(numbered))
    return replace(grains, verdict=verdict, view=view)


def _judged(labels: Int[np.ndarray, "Z Y X"], scan: Scan, view: FieldOfView) -> SegmentationVerdict | None:
    """Return the verdict of the scan on labels; None where the scan holds no number in its field of view."""
    voxels = scan.load()
    if voxels.dtype.kind == "f":
        for part, seen in zip(voxels, view.mask, strict=True):
            if not np.isfinite(part[seen]).all():
                return None
    return judge_labels(with_numbers_only(voxels, view, scan.path or "The scan"), labels, view)


@dataclass(frozen=True, eq=False)
class _LabelImage:
    """A label image as its file stores it, and what that says about the voxels."""

    stored: np.ndarray
    size: VoxelSize | None
    origin: tuple[float, float, float]
    grid: Grid | None
    name: str
    white_is_zero: bool = False


def _warn(message: str) -> None:
    warnings.warn(message, GrainWarning, stacklevel=3)


def _read_image(
    source: str | Path | np.ndarray,
    scan: Scan | None,
    voxel_size: str | float | Sequence[float] | VoxelSize | None,
    unit: str | None,
) -> _LabelImage:
    """Return the image, in the order in which it is stored; its size may be unknown if there is a scan."""
    nowhere = (0.0, 0.0, 0.0)
    if not isinstance(source, str | Path):
        if voxel_size is None and scan is None:
            raise SegmentationError(
                "The labels have no voxel size: give scan or voxel_size, for example '14 um'."
            )
        size = VoxelSize.parse(voxel_size, unit) if voxel_size is not None else None
        return _LabelImage(np.asarray(source), size, nowhere, None, "The label image")
    path = Path(source)
    reading = read_file(path, ReadOptions(numbers=True))
    for note in reading.notes:
        _warn(f"{path} {note}")
    stated: VoxelSize | None
    try:
        stated, origin, notes = place(reading, voxel_size, unit, path)
    except UnitError:
        if scan is None:
            raise
        stated, origin, notes = None, nowhere, ()
    if scan is None:
        for note in notes:
            _warn(f"{path} {note}")
    voxels = np.asarray(reading.voxels)
    stored = reading.grid.as_stored(voxels) if reading.grid is not None else voxels
    return _LabelImage(stored, stated, origin, reading.grid, str(source), reading.white_is_zero)


def _black_is_zero(labels: Int[np.ndarray, "Z Y X"], name: str) -> Int[np.ndarray, "Z Y X"]:
    """Return the numbers of an image that shows 0 as white: as they are, or turned round.

    Some programs leave the numbers as they are and only note how to show them, others turn them.
    What is 0 outside all grains tells which; a mask is taken as it is shown, white grains on black.
    """
    kind = labels.dtype
    other = np.asarray(np.iinfo(kind).max - labels) if kind.kind == "u" else ~labels
    values = np.unique(labels)
    if len(values) == 2 and values[0] == 0:
        return np.asarray(labels == 0, dtype=np.uint8)
    as_it_is, turned = bool((labels == 0).any()), bool((other == 0).any())
    if as_it_is and turned:
        raise SegmentationError(
            f"{name} shows 0 as white and contains both 0 and {np.iinfo(kind).max}, so that either could be "
            "outside all grains: in ImageJ, use Edit > Invert or Image > Lookup Tables > Grays and save it."
        )
    return np.asarray(other if turned else labels)


def _grains_of_mask(
    mask: Bool[np.ndarray, "Z Y X"], size: VoxelSize, splitting: float | None, name: str
) -> Int[np.ndarray, "Z Y X"]:
    """Return the grains of a mask: its pieces, or its parts where splitting is asked for."""
    if splitting is not None:
        return part_mask(mask, size, splitting)
    pieces, sizes = label_pieces(mask)
    pieces, count = pieces.astype(np.uint32), len(sizes)
    parted = int(part_mask(mask, size, _USUAL_SPLITTING).max(initial=0))
    if parted > count:
        found = "one connected piece" if count == 1 else f"{count:,} connected pieces"
        _warn(
            f"{name} contains only one number, so it is a mask: its {found} were taken as the grains, but "
            f"some seem to touch. To separate them, into about {parted:,}, state a splitting: "
            f"splitting={_USUAL_SPLITTING}, or --splitting {_USUAL_SPLITTING}."
        )
    return np.asarray(pieces, dtype=np.int32)
