"""Zeiss (XRadia): reconstructed volumes `.txm`, an OLE container of one stream a slice."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.family import (
    Family,
    Reading,
    ReadOptions,
    memory_refusal,
    require_grey_volume,
    require_memory,
)
from mbstudio.core.scan.readers.pixels import plain_numbers
from mbstudio.core.scan.scan import VoxelArray
from mbstudio.core.scan.slice_stack import SliceStack

# Codes of ImageInfo/DataType. Those of 64 bits differ between programs and are not read.
_TYPES = {3: "<u1", 2: "<i1", 5: "<u2", 4: "<i2", 7: "<u4", 6: "<i4", 10: "<f4", 11: "<f8"}
_PROJECTIONS = (".txrm", ".xrm")
# A volume up to this size is read at once; of a larger one the slices that are asked for.
READ_AT_ONCE_BYTES = 2 << 30
# Slices are kept in storages of a hundred each.
_A_STORAGE = 100
_STREAM, _STORAGE = 2, 1


@dataclass(frozen=True)
class _Stream:
    """Where the bytes of a stream lie: runs of (first byte, length)."""

    runs: tuple[tuple[int, int], ...]

    def read(self, path: Path) -> bytes:
        with path.open("rb") as file:
            parts = []
            for start, length in self.runs:
                file.seek(start)
                parts.append(file.read(length))
        return b"".join(parts)


def read(path: Path, options: ReadOptions) -> Reading:
    """Read a reconstructed volume (.txm); its rows and slices are in the order in which they are stored.

    Raises
    ------
    ScanError
        If the file holds projections (.txrm, .xrm), is damaged, or does not hold all its slices.
    """
    import olefile

    if path.suffix.lower() in _PROJECTIONS:
        raise ScanError(
            f"{path} holds projections, the X-ray images that a volume is reconstructed from: "
            "open the reconstructed volume (.txm)."
        )
    if not _begins_as_ole(path):
        raise ScanError(f"{path} is not a file of XRadia's, although its name ends so: export it again.")
    try:
        with olefile.OleFileIO(path) as ole:
            said, streams = _contents(ole, path)
    except ScanError:
        raise
    except MemoryError as error:
        raise memory_refusal(path) from error
    except Exception as error:  # the parser raises errors of many unrelated types
        raise ScanError(
            f"{path} cannot be read as XRadia's ({str(error) or type(error).__name__}): "
            "it is damaged or cut off; copy or export it again."
        ) from error
    shape, dtype = said.shape, said.dtype
    require_grey_volume(shape, dtype, path)

    def read_slice(index: int) -> np.ndarray:
        content = streams[index].read(path)
        if len(content) != math.prod(shape[1:]) * dtype.itemsize:
            raise ScanError(f"{path} has changed since it was opened: open it again.")
        return np.asarray(plain_numbers(np.frombuffer(content, dtype).reshape(shape[1:])))

    voxels: VoxelArray = SliceStack(read_slice, shape, dtype)
    if math.prod(shape) * dtype.itemsize <= READ_AT_ONCE_BYTES and not options.in_part:
        require_memory(shape, dtype.itemsize, path)
        voxels = np.stack([read_slice(index) for index in range(shape[0])])
    spacing = (said.edge, said.edge, said.edge) if said.edge else None
    return Reading(voxels, spacing, "um" if spacing else None, metadata=said.metadata)


def _begins_as_ole(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(8) == b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"


@dataclass(frozen=True, eq=False)
class _Said:
    """What ImageInfo says: shape, type, edge of a voxel in micrometres (None if nothing)."""

    shape: tuple[int, int, int]
    dtype: np.dtype[Any]
    edge: float | None
    metadata: dict[str, Any]


def _contents(ole: Any, path: Path) -> tuple[_Said, Sequence[_Stream]]:
    """Return what the file says, and where the streams of its slices lie; all lengths are checked."""
    entries = dict(_entries(ole.root.kids, "", 0))
    said = _said(ole, entries, path)
    length = math.prod(said.shape[1:]) * said.dtype.itemsize
    _require_slices(entries, said, path)
    streams = []
    for number in range(1, said.shape[0] + 1):
        entry = entries[_name_of_slice(number)]
        if entry.size != length:
            raise ScanError(
                f"{path} holds {entry.size:,} bytes in slice {number}, where {said.shape[1]} x "
                f"{said.shape[2]} "
                f"voxels of {said.dtype.name} need {length:,}: it is damaged; copy or export it again."
            )
        streams.append(_Stream(_runs(ole, entry, path)))
    return said, streams


def _require_slices(entries: dict[str, Any], said: _Said, path: Path) -> None:
    """Refuse a file that does not hold all slices that it states, or is too short for them."""
    stated, held = said.shape[0], path.stat().st_size
    there = [
        number for number in range(1, min(stated, len(entries)) + 1) if _name_of_slice(number) in entries
    ]
    if len(there) < stated:
        first = next(number for number in range(1, stated + 1) if _name_of_slice(number) not in entries)
        raise ScanError(
            f"{path} states {stated:,} slices, but {stated - len(there):,} of them are missing, the first "
            f"of them "
            f"{first}: the reconstruction was stopped, or the file is cut off."
        )
    if math.prod(said.shape) * said.dtype.itemsize > held:
        raise ScanError(
            f"{path} states {' x '.join(map(str, said.shape))} voxels (z, y, x) of {said.dtype.name}, "
            f"more than its "
            f"{held:,} bytes hold: it is cut off, or damaged."
        )


def _name_of_slice(number: int) -> str:
    return f"imagedata{math.ceil(number / _A_STORAGE)}/image{number}"


def _entries(kids: Sequence[Any], above: str, depth: int) -> list[tuple[str, Any]]:
    """Return the streams of a storage and of those in it, by their names in small letters."""
    found = []
    for entry in kids:
        name = f"{above}{entry.name.lower()}"
        if entry.entry_type == _STREAM:
            found.append((name, entry))
        elif entry.entry_type == _STORAGE and depth < 8:
            found += _entries(entry.kids, f"{name}/", depth + 1)
    return found


def _said(ole: Any, entries: dict[str, Any], path: Path) -> _Said:
    counts = {}
    for key in ("ImageWidth", "ImageHeight", "NoOfImages", "DataType"):
        value = _number(ole, entries, key, "<I")
        if value is None:
            raise ScanError(f"{path} does not say its {key} (ImageInfo/{key}): export the volume again.")
        counts[key] = int(value)
    shape = (counts["NoOfImages"], counts["ImageHeight"], counts["ImageWidth"])
    code = counts["DataType"]
    if code not in _TYPES:
        raise ScanError(
            f"{path} holds voxels of data type {code}, which is not read: export 16 bits or float."
        )
    edge = _number(ole, entries, "PixelSize", "<f")
    usable = edge is not None and math.isfinite(edge) and edge > 0
    metadata = {f"ImageInfo/{key}": value for key, value in counts.items()}
    return _Said(
        shape, np.dtype(_TYPES[code]), edge if usable else None, {**metadata, "ImageInfo/PixelSize": edge}
    )


def _number(ole: Any, entries: dict[str, Any], key: str, kind: str) -> float | None:
    """Return the first number of a stream in ImageInfo."""
    entry = entries.get(f"imageinfo/{key.lower()}")
    size = struct.calcsize(kind)
    if entry is None or not size <= entry.size <= 2**20:
        return None
    content = ole.openstream(f"ImageInfo/{key}").read(size)
    return float(struct.unpack(kind, content)[0])


def _runs(ole: Any, entry: Any, path: Path) -> tuple[tuple[int, int], ...]:
    """Return where the bytes of a stream lie, joined where they follow each other."""
    if entry.size < ole.minisectorcutoff:
        return _small_runs(ole, entry, path)
    return _joined(ole.fat, entry.isectStart, entry.size, ole.sectorsize, ole.sectorsize, path)


def _small_runs(ole: Any, entry: Any, path: Path) -> tuple[tuple[int, int], ...]:
    """Return the same for a stream that lies in the stream of small streams."""
    ole.loadminifat() if not ole.minifat else None
    whole = _joined(ole.fat, ole.root.isectStart, ole.root.size, ole.sectorsize, ole.sectorsize, path)
    runs = []
    for start, length in _joined(ole.minifat, entry.isectStart, entry.size, ole.minisectorsize, 0, path):
        before = 0
        for place, held in whole:
            first, last = max(start, before), min(start + length, before + held)
            if first < last:
                runs.append((place + first - before, last - first))
            before += held
    return tuple(runs)


def _joined(
    chain: Sequence[int], sector: int, size: int, length: int, header: int, path: Path
) -> tuple[tuple[int, int], ...]:
    """Follow a chain of sectors for `size` bytes."""
    runs: list[tuple[int, int]] = []
    left = size
    while left > 0:
        if not 0 <= sector < len(chain):
            raise ScanError(
                f"{path} is damaged: the chain of a slice's sectors ends too early; copy it again."
            )
        start, part = header + sector * length, min(left, length)
        if runs and runs[-1][0] + runs[-1][1] == start:
            runs[-1] = (runs[-1][0], runs[-1][1] + part)
        else:
            runs.append((start, part))
        left -= part
        sector = chain[sector]
    return tuple(runs)


FAMILY = Family("Zeiss XRadia volume", (".txm", *_PROJECTIONS), read)
