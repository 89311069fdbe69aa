"""DICOM: a folder of slices, one of its files, or a file of many frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.scan.grid import Grid
from mbstudio.core.scan.readers.dicom.frames import (
    decoded,
    frame_reader,
    is_bare,
    meaning_of,
    require_readable,
)
from mbstudio.core.scan.readers.dicom.headers import Header, is_dicom
from mbstudio.core.scan.readers.dicom.series import (
    SUFFIXES,
    Series,
    headers_like,
    headers_of_folder,
    holds_dicom,
    in_order,
)
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions, require_grey_volume
from mbstudio.core.scan.readers.orientation import along_axes, impossible
from mbstudio.core.scan.readers.pixels import plain_numbers
from mbstudio.core.scan.scan import VoxelArray
from mbstudio.core.scan.slice_stack import SliceStack


def read(path: Path, options: ReadOptions) -> Reading:
    """Read a series of slices lazily, or the frames of a file.

    Of a folder its one series is read, of a file its frames, or the slices of its series in its
    folder. Slices lie where their positions say, in mm and in the axes of ITK.

    Raises
    ------
    ScanError
        If files are damaged or packed in a way that is not read, slices are missing or doubled, or
        do not belong together.
    """
    if path.is_dir():
        headers, notes = headers_of_folder(path)
    else:
        headers, notes = headers_like(path), ()
    for header in headers:
        require_readable(header)
    series = in_order(headers, path)
    notes = (*notes, *series.notes)
    first = series.slices[0].header
    shape = (len(series.slices), first.rows, first.columns)
    kind = _kind(series, options.numbers)
    require_grey_volume(shape, kind, path)
    steps, doubt = series.steps, series.doubt
    wrong = None if steps is None else impossible(steps)
    if wrong is not None:
        steps, doubt = None, wrong
    flipped, spacing, corner = (False, False, False), None, (0.0, 0.0, 0.0)
    grid = None
    if steps is not None:
        # What would be turned round is found out with an array that takes no memory.
        nothing = np.broadcast_to(np.zeros(1, kind), shape)
        _, spacing, corner, flipped = along_axes(nothing, steps, series.origin, path)
        grid = Grid(steps, series.origin, "mm", flipped) if series.is_placed else None
    return Reading(
        _voxels(series, shape, kind, flipped, options.numbers),
        spacing,
        None if spacing is None else "mm",
        None,
        corner,
        first.metadata,
        grid=None if grid is None or grid.is_placeholder else grid,
        notes=notes,
        size_notes=series.size_notes,
        doubt=doubt,
        white_is_zero=first.white_is_zero,
    )


def _kind(series: Series, numbers: bool) -> np.dtype[Any]:
    """Return the type of all values: that of each scale of the series, or one that holds them all."""
    kinds = set()
    for one in series.slices:
        meaning = replace(meaning_of(one.header, one.index), samples=1)
        kinds.add(
            (one.header.dtype, one.header.bits, meaning.slope, meaning.intercept, one.header, one.index)
        )
    found = {}
    for dtype, bits, slope, intercept, header, index in kinds:
        key = (dtype, bits, slope, intercept)
        if key not in found:
            single = replace(header, samples=1)
            found[key] = decoded(single, index, np.zeros((1, 1), dtype), numbers).dtype
    return np.dtype(np.result_type(*found.values()))


def _voxels(
    series: Series,
    shape: tuple[int, int, int],
    kind: np.dtype[Any],
    flipped: tuple[bool, bool, bool],
    numbers: bool,
) -> VoxelArray:
    """Return the voxels: mapped where they are one bare block in order, else slice by slice."""
    mapped = _mapped(series, shape)
    turn = tuple(slice(None, None, -1 if back else 1) for back in flipped)
    if mapped is not None:
        return mapped[turn]
    readers: dict[Header, Callable[[int], np.ndarray]] = {}
    for one in series.slices:
        if one.header not in readers:
            readers[one.header] = frame_reader(one.header)

    def read_slice(index: int) -> np.ndarray:
        one = series.slices[shape[0] - 1 - index if flipped[0] else index]
        stored = readers[one.header](one.index)
        image = decoded(one.header, one.index, stored, numbers)
        return np.ascontiguousarray(image[turn[1:]], dtype=kind)

    return SliceStack(read_slice, shape, kind)


def _mapped(series: Series, shape: tuple[int, int, int]) -> np.ndarray | None:
    """Map the frames of one file that are the values as they stand, in their order."""
    header = series.slices[0].header
    in_file = [one.index for one in series.slices] == list(range(len(header.frames)))
    is_one = all(one.header is header for one in series.slices) and len(header.frames) > 1 and in_file
    is_plain = all(meaning_of(header, index).is_plain for index in range(len(header.frames)))
    if not is_one or not is_plain or not is_bare(header) or header.bits != 8 * header.dtype.itemsize:
        return None
    return plain_numbers(np.memmap(header.path, header.dtype, "r", header.offset, shape))  # type: ignore[no-any-return]


FAMILY = Family(
    "DICOM series",
    SUFFIXES,
    read,
    reads_folders=True,
    recognises=lambda path: holds_dicom(path) if path.is_dir() else is_dicom(path),
)
