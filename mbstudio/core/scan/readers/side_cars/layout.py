"""What a side-car says about the voxels beside it, and how they are opened by that."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError, UnitError
from mbstudio.core.scan.readers.family import Reading, ReadOptions, require_file, require_grey_volume
from mbstudio.core.scan.readers.pixels import plain_numbers
from mbstudio.core.scan.readers.tiff_lengths import Spacing, length_unit
from mbstudio.core.units import names_no_length


@dataclass(frozen=True)
class RawLayout:
    """How voxels lie in a file.

    Attributes
    ----------
    data : Path
        The file of voxels.
    source : str
        The side-car's name, or what else says so; the beginning of a sentence.
    shape : tuple of int
        Number of voxels along z, y, x.
    dtype : numpy dtype or None
        None where the length of the file must tell.
    header_bytes : int
    spacing, unit, unit_word, origin, metadata, notes, doubt
        As in `Reading`.
    """

    data: Path
    source: str
    shape: tuple[int, int, int]
    dtype: np.dtype[Any] | None
    header_bytes: int = 0
    spacing: Spacing | None = None
    unit: str | None = None
    unit_word: str | None = None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    metadata: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    notes: tuple[str, ...] = ()
    doubt: str | None = None


def open_layout(layout: RawLayout, options: ReadOptions) -> Reading:
    """Map voxels into memory as a side-car describes them; what the caller states goes before.

    Raises
    ------
    ScanError
        If the file is missing, no grey volume, or not of the length that its voxels have.
    """
    data = layout.data
    require_file(data)
    present, header = data.stat().st_size, options.header_bytes or layout.header_bytes
    notes, shape = layout.notes, options.shape or layout.shape
    dtype = options.dtype or layout.dtype
    if dtype is None:
        dtype, told = dtype_by_length(shape, present - header, layout.source)
        notes = (*notes, told)
    if options.big_endian and dtype.itemsize > 1:
        dtype = dtype.newbyteorder(">")
    require_grey_volume(shape, dtype, data)
    needed = header + math.prod(shape) * dtype.itemsize
    if present != needed:
        off = f"{needed - present:,} fewer" if present < needed else f"{present - needed:,} more"
        why = (
            "it is cut off, or described wrongly"
            if present < needed
            else "another file is described, or this one wrongly"
        )
        raise ScanError(
            f"{layout.source} states {' x '.join(map(str, shape))} voxels (z, y, x) of {dtype.name}"
            f"{f' behind {header} bytes' if header else ''}, {needed:,} bytes, but {data.name} contains "
            f"{present:,}, {off}: {why}; copy or export both again, or state shape and dtype."
        )
    voxels = plain_numbers(np.memmap(data, dtype, "r", header, shape))
    return Reading(
        voxels, layout.spacing, layout.unit, layout.unit_word, layout.origin, layout.metadata,
        notes=notes, doubt=layout.doubt,
    )  # fmt: skip


def dtype_by_length(shape: tuple[int, int, int], held: int, source: str) -> tuple[np.dtype[Any], str]:
    """Return the type of voxels of which only the number is known, and the note that says so.

    Raises
    ------
    ScanError
        If no type has that length, or several have.
    """
    count = math.prod(shape)
    usual = {1: "uint8", 2: "uint16", 4: "float32"}
    size = held // count if held % count == 0 else 0
    if size not in usual:
        raise ScanError(
            f"{source} states {' x '.join(map(str, shape))} voxels (z, y, x), but not of which type, and "
            f"none "
            f"has {held:,} bytes for them: state shape and dtype."
        )
    name = usual[size]
    return np.dtype(name), (
        f"is described without the type of its voxels; its length gives {8 * size} bits to each, taken as "
        f"{name}. State dtype where that is wrong."
    )


def in_unit(edges: Spacing, word: str) -> tuple[Spacing, str | None, str | None]:
    """Return edges in a unit of mbstudio's, that unit, and the word where it is no length."""
    if names_no_length(word):
        return edges, None, None
    try:
        factor, unit = length_unit(word)
    except UnitError:
        return edges, None, word
    z, y, x = edges
    return (z * factor, y * factor, x * factor), unit, None


def base_name(name: str) -> str:
    """Return the last part of a path as Windows or Unix write it, without quotes."""
    return name.strip().strip('"').strip().replace("\\", "/").rpartition("/")[2]
