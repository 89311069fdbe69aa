"""VTK image data (.vti): one array of points or cells, and where it lies in space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import ScanError, SeveralArraysError
from mbstudio.core.scan.grid import Grid
from mbstudio.core.scan.readers.family import (
    Family,
    Reading,
    ReadOptions,
    require_grey_volume,
    require_memory,
)
from mbstudio.core.scan.readers.orientation import along_axes, impossible
from mbstudio.core.scan.readers.pixels import PixelMeaning, decode
from mbstudio.core.scan.readers.vtk_image.contents import numbers_of, type_of
from mbstudio.core.scan.readers.vtk_image.layout import Layout, StoredArray, read_layout
from mbstudio.core.scan.scan import VoxelArray

# LZMA packs blank blocks by so much at most, each with four bytes of its own in the header.
_MOST_COMPRESSION = 10_000
_ABSURD = 1e30


def read(path: Path, options: ReadOptions) -> Reading:
    """Read one array of an image: the one that the caller names, or the only one.

    The format tells spacing, origin and directions, but no unit: the caller gives it. Values of
    cells lie half a spacing beyond the corner of the image, those of points on it.

    Raises
    ------
    ScanError
        If the file is damaged, cut off, no grey volume, or several arrays could be meant.
    """
    layout = read_layout(path)
    first, counts = _extent(layout, path)
    array = _choose(layout, options.dataset, path)
    is_cells = array.place == "CellData"
    sizes = [max(count - 1, 1) if is_cells else count for count in counts]
    shape = (sizes[2], sizes[1], sizes[0])
    components = int(array.components) if array.components.isdigit() else 0
    if not 1 <= components <= 64:
        raise ScanError(
            f"{path} has {array.components[:20]} numbers a voxel in '{array.name}': save one of them."
        )
    dtype = type_of(layout, array, path)
    require_grey_volume(shape, dtype, path)
    packing = _MOST_COMPRESSION if layout.file.get("compressor") else 2
    require_memory(shape, dtype.itemsize * components, path, path.stat().st_size, packing)
    full = shape if components == 1 else (*shape, components)
    raw = numbers_of(layout, array, math.prod(full), path).reshape(full)
    meaning = PixelMeaning(bits=8 * dtype.itemsize, samples=components)
    voxels: VoxelArray = decode(raw, meaning, path, numbers=options.numbers)
    metadata = {"array": array.name, "of": array.place, **layout.image}
    bare = Reading(voxels, metadata=metadata)
    if "Spacing" not in layout.image:
        return bare
    shift = [first[axis] + (0.5 if is_cells and counts[axis] > 1 else 0.0) for axis in range(3)]
    steps, origin = _steps(layout, shift, path)
    wrong = impossible(steps)
    if wrong is not None:
        return replace(bare, doubt=wrong)
    voxels, spacing, corner, flipped = along_axes(voxels, steps, origin, path)
    grid = Grid(steps, origin, None, flipped)
    return replace(
        bare, voxels=voxels, spacing=spacing, origin=corner, grid=None if grid.is_placeholder else grid
    )


def _numbers(text: str, count: int, path: Path, name: str) -> list[float]:
    """Return so many numbers of an attribute."""
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(number) < _ABSURD for number in numbers):
        raise ScanError(
            f"{path} says '{text[:60]}' where {count} numbers should be ({name}): export it again."
        )
    return numbers


def _extent(layout: Layout, path: Path) -> tuple[list[int], list[int]]:
    """Return the first index and the number of points along x, y, z."""
    whole = layout.image.get("WholeExtent", "")
    numbers = _numbers(whole, 6, path, "WholeExtent")
    if any(number != int(number) for number in numbers):
        raise ScanError(f"{path} has an extent of parts of voxels ({whole[:60]}): export it again.")
    ends = [int(number) for number in numbers]
    if len(layout.pieces) > 1:
        raise ScanError(f"{path} holds its image in {len(layout.pieces)} pieces: save it as one.")
    if layout.pieces and [int(n) for n in _numbers(layout.pieces[0], 6, path, "Extent")] != ends:
        raise ScanError(
            f"{path} holds a piece ({layout.pieces[0]}) of an image ({whole}): save the whole image "
            "as one file."
        )
    first, counts = ends[::2], [last - start + 1 for start, last in zip(ends[::2], ends[1::2], strict=True)]
    if min(counts) < 1 or not layout.pieces:
        raise ScanError(f"{path} contains no voxels (extent {whole[:60]}): export the scan again.")
    return first, counts


def _choose(layout: Layout, name: str | None, path: Path) -> StoredArray:
    """Return the array that is meant."""
    found = list(layout.arrays)
    if name is not None:
        named = [array for array in found if name in (array.name, f"{array.place}/{array.name}")]
        if len(named) == 1:
            return named[0]
        if named:
            raise ScanError(
                f"{path} holds an array '{name}' of points and one of cells: name the one that is "
                "meant behind a "
                f"colon, as in '{path.name}:CellData/{name}'."
            )
        raise ScanError(f"{path} contains no array '{name}'{_listed(found)}.")
    if len(found) == 1:
        return found[0]
    if not found:
        raise ScanError(f"{path} holds no array of points or cells: a scan needs one.")
    names = [array.name for array in found]
    raise SeveralArraysError(
        f"{path} holds {len(found)} arrays that could be the scan{_listed(found)}. "
        f"Name the right one after a colon, as in '{path.name}:{found[0].name}'.",
        path,
        [one.name if names.count(one.name) == 1 else f"{one.place}/{one.name}" for one in found],
    )


def _listed(arrays: Sequence[StoredArray]) -> str:
    names = [f"{array.name} ({'cells' if array.place == 'CellData' else 'points'})" for array in arrays]
    return ": " + ", ".join(names[:8]) + (", ..." if len(names) > 8 else "") if names else ""


def _steps(
    layout: Layout, shift: Sequence[float], path: Path
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Return the steps along x, y, z and the place of the first voxel."""
    spacing = _numbers(layout.image["Spacing"], 3, path, "Spacing")
    origin = np.array(_numbers(layout.image.get("Origin", "0 0 0"), 3, path, "Origin"))
    turn = _numbers(layout.image.get("Direction", "1 0 0 0 1 0 0 0 1"), 9, path, "Direction")
    steps = np.reshape(turn, (3, 3)).T * np.array(spacing)[:, None]
    return steps, origin + np.asarray(shift) @ steps


FAMILY = Family("VTK image", (".vti",), read, holds_several=True)
