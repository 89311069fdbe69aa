"""NRRD: nearly raw raster data, memory-mapped where it is uncompressed."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.grid import Grid
from mbstudio.core.scan.readers.data_files import Storage, named_files, numbered_names, read_part
from mbstudio.core.scan.readers.family import (
    Family,
    Reading,
    ReadOptions,
    require_grey_volume,
    require_memory,
    side_car,
)
from mbstudio.core.scan.readers.orientation import along_axes, impossible
from mbstudio.core.scan.readers.pixels import PixelMeaning, decode, plain_numbers
from mbstudio.core.scan.readers.text import plain_text
from mbstudio.core.scan.readers.tiff_lengths import shared_unit
from mbstudio.core.scan.scan import VoxelArray

_LARGEST_HEADER = 2**20
_PACKINGS = {
    "raw": "raw", "gzip": "gzip", "gz": "gzip", "bzip2": "bzip2", "bz2": "bzip2", "ascii": "text",
    "text": "text", "txt": "text",
}  # fmt: skip
_LIST = re.compile(rb"data ?file:\s*LIST\b", re.IGNORECASE)
# Kinds of axes that run through space; of any other kind there may be only one sample.
_COLOURS = ("rgb-color", "rgba-color", "hsv-color", "xyz-color")


def read(path: Path, options: ReadOptions) -> Reading:
    """Read an NRRD file (.nrrd, or .nhdr with its data file).

    The spacing comes from ``space directions`` with ``space units``, else from ``spacings``
    with ``units``. A file without units has a spacing but no unit: the caller gives it.

    Raises
    ------
    ScanError
        If the file is damaged, cut off, or no grey volume.
    """
    import nrrd

    header, data_start = _header(path)
    try:
        sizes = tuple(int(count) for count in header["sizes"])
        dtype: np.dtype[Any] = nrrd.reader._determine_datatype(header)
    except Exception as error:  # as in _header
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise ScanError(f"The NRRD header of {path} is incomplete ({reason}): export it again.") from error
    if dtype.kind not in "buif":
        raise ScanError(f"{path} holds values of type {dtype}: export grey values as whole or real numbers.")
    raw = _voxels(path, header, sizes, dtype, data_start)
    metadata = {key: str(value) for key, value in header.items()}
    voxels, axes = _three_axes(raw, header, path, options.numbers)
    require_grey_volume(voxels.shape, voxels.dtype, path)
    steps, origin, unit, unit_word = _steps(header, axes)
    if steps is None:
        return Reading(voxels, metadata=metadata)
    wrong = impossible(steps)
    if wrong is not None:
        return Reading(voxels, metadata=metadata, doubt=wrong)
    # Bare spacings say nothing of where the axes run.
    grid = Grid(steps, origin, unit) if "space directions" in header else None
    if grid is not None and str(header.get("space", "")).lower() in ("right-anterior-superior", "ras"):
        grid = grid.turned_half_about_z()
    voxels, spacing, corner, flipped = along_axes(voxels, steps, origin, path)
    if grid is not None:
        grid = replace(grid, flipped=flipped)
    return Reading(voxels, spacing, unit, unit_word, corner, metadata, grid=grid)


def _header(path: Path) -> tuple[dict[str, Any], int]:
    """Return the fields of the header, whatever its encoding, and the byte behind it."""
    import nrrd

    with path.open("rb") as stream:
        if stream.read(4) != b"NRRD":
            raise ScanError(f"{path} is not an NRRD file, although its name ends so: export the scan again.")
        stream.seek(0)
        lines: list[bytes] = []
        while stream.tell() < _LARGEST_HEADER:
            line = stream.readline(_LARGEST_HEADER)
            if not line or not line.strip():
                break
            lines.append(line)
            if _LIST.match(line):  # the names of the files follow
                break
        start = stream.tell()
    # pynrrd drops what is not ASCII, and of "µm" that leaves metres: it is given text.
    text = plain_text(b"".join(lines)).splitlines()
    try:
        return dict(nrrd.read_header([*text, ""])), start
    except Exception as error:  # pynrrd raises errors of many unrelated types
        raise ScanError(f"The header of {path} cannot be read as NRRD ({error}): export it again.") from error


def _voxels(
    path: Path, header: dict[str, Any], sizes: tuple[int, ...], dtype: np.dtype[Any], data_start: int
) -> np.ndarray:
    """Return the voxels of the file, or of the files that it names, mapped where they are raw in one."""
    packing = _PACKINGS.get(str(header["encoding"]).strip().lower())
    if packing is None:
        raise ScanError(
            f"{path} is encoded as {header['encoding']}, which is not read: save it as raw or gzip."
        )
    skip = _skip(header, "byte skip", path)
    if skip < 0 and packing != "raw":
        raise ScanError(f"{path} counts from the end of packed voxels (byte skip: -1): save it as raw.")
    named = _detached(header)
    how = Storage(
        packing,
        dtype,
        -1 if skip < 0 else data_start if named is None else 0,
        max(skip, 0),
        max(_skip(header, "line skip", path), 0) if skip >= 0 else 0,
    )
    shape = sizes[::-1]
    if named is None:
        return read_part(path, shape, how, path)
    if named.upper().split()[:1] == ["LIST"]:
        names = _listed(path, data_start)
    elif "%" in named:
        names = numbered_names(path, named)
    else:
        return read_part(side_car(path, named), shape, how, path)
    files = named_files(path, names, shape[0])
    part = (shape[0] // len(files), *shape[1:])
    if packing == "raw":
        for file in files:
            read_part(file, part, how, path)  # the lengths are checked before memory is taken
    require_memory(shape, dtype.itemsize, path)
    return np.concatenate([read_part(file, part, how, path) for file in files])


def _listed(path: Path, data_start: int) -> list[str]:
    """Return the names in the lines behind ``data file: LIST``."""
    with path.open("rb") as stream:
        stream.seek(data_start)
        content = stream.read(_LARGEST_HEADER * 16)
    return [line.strip() for line in plain_text(content).splitlines() if line.strip()]


def _skip(header: dict[str, Any], name: str, path: Path) -> int:
    text = str(header.get(name, header.get(name.replace(" ", ""), 0))).strip()
    if not re.fullmatch(r"-1|[0-9]{1,18}", text):
        raise ScanError(
            f"The header of {path} gives {name} as '{text[:60]}', which is not a number: correct it."
        )
    return int(text)


def name_of_data(path: Path) -> str | None:
    """Return which file a header says to hold its voxels, None if they are its own."""
    name = _detached(_header(path)[0])
    return None if name is None else name.removeprefix("./")


def _detached(header: dict[str, Any]) -> str | None:
    name = header.get("data file", header.get("datafile"))
    return None if name is None else str(name)


def _three_axes(
    raw: np.ndarray, header: dict[str, Any], path: Path, numbers: bool
) -> tuple[VoxelArray, list[int]]:
    """Return (Z, Y, X) voxels, and which of the header's axes are x, y and z."""
    kinds = [str(kind).lower() for kind in header.get("kinds", ["domain"] * raw.ndim)]
    axes = list(range(raw.ndim))
    if kinds and kinds[0] in _COLOURS and raw.ndim == 4:
        meaning = PixelMeaning(samples=raw.shape[-1])
        return decode(raw, meaning, path, numbers=numbers), [1, 2, 3]
    single = [axis for axis in axes if raw.shape[::-1][axis] == 1]
    while len(axes) > 3 and single:
        axes.remove(single.pop())
    if len(axes) > 3:
        if numbers and raw.ndim == 4 and _is_segmentation(header):
            return _merged_layers(raw, path), [1, 2, 3]
        raise ScanError(
            f"{path} has {raw.ndim} axes (sizes {' '.join(map(str, raw.shape[::-1]))}, kinds "
            f"{' '.join(kinds)}), but a scan has three (z, y, x): save one channel and one time step "
            "as its own file."
        )
    # A view of a map would name the place of the map, not its own: dropped axes of one are the same data.
    return plain_numbers(raw.reshape([raw.shape[::-1][axis] for axis in axes][::-1])), axes


def _is_segmentation(header: dict[str, Any]) -> bool:
    return any(key.startswith("Segment") and key.endswith("_LabelValue") for key in header)


def _merged_layers(raw: np.ndarray, path: Path) -> np.ndarray:
    """Return the layers of a Slicer segmentation as one image of numbers."""
    merged = np.zeros(raw.shape[:3], np.int64)
    offset = 0
    for layer in range(raw.shape[3]):
        part = raw[..., layer].astype(np.int64)
        inside = part > 0
        if (merged[inside] > 0).any():
            raise ScanError(
                f"{path} contains segments that overlap: in Slicer, export them as a label map, "
                "in which each voxel belongs to one."
            )
        merged[inside] = part[inside] + offset
        offset = int(merged.max(initial=0))
    return merged


def _steps(
    header: dict[str, Any], axes: list[int]
) -> tuple[np.ndarray | None, np.ndarray, str | None, str | None]:
    """Return the steps along x, y, z, the first voxel's position, the unit, and the word if it is none."""
    origin = np.asarray(header.get("space origin", np.zeros(3)), dtype=float)
    if origin.shape != (3,) or not np.isfinite(origin).all():
        origin = np.zeros(3)
    if "space directions" in header:
        steps = np.array(
            [
                [np.nan] * 3 if row is None else np.asarray(row, dtype=float)
                for row in (header["space directions"][axis] for axis in axes)
            ]
        )
        words = [str(word) for word in header.get("space units", header.get("units", [])) or []]
        if len(words) != 3 and len(words) > max(axes):
            words = [words[axis] for axis in axes]
        factors, unit, odd = shared_unit(words)
        return steps * factors, origin * factors, unit, odd
    if "spacings" in header:
        spacings = np.asarray(header["spacings"], dtype=float)[axes]
        if np.isfinite(spacings).all():
            words = [str(word) for word in header.get("units", header.get("space units", [])) or []]
            if len(words) > 3:
                words = [words[axis] for axis in axes]
            factors, unit, odd = shared_unit(words)
            return np.diag(spacings * factors), origin, unit, odd
    return None, origin, None, None


FAMILY = Family("NRRD volume", (".nrrd", ".nhdr"), read)
