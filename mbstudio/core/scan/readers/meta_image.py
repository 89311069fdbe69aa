"""MetaImage (MHD, MHA): memory-mapped where it is one uncompressed block."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError, UnitError
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
from mbstudio.core.scan.readers.pixels import PixelMeaning, decode
from mbstudio.core.scan.readers.text import plain_text
from mbstudio.core.scan.readers.tiff_lengths import length_unit
from mbstudio.core.scan.scan import VoxelArray
from mbstudio.core.scan.slice_stack import SliceStack
from mbstudio.core.units import names_no_length

# MetaIO's own sizes; those of MET_LONG are 4 bytes, or 8 where the file is so long.
_DTYPES = {
    "MET_UCHAR": "u1", "MET_CHAR": "i1", "MET_USHORT": "u2", "MET_SHORT": "i2", "MET_UINT": "u4",
    "MET_INT": "i4", "MET_FLOAT": "f4", "MET_DOUBLE": "f8", "MET_ULONG_LONG": "u8", "MET_LONG_LONG": "i8",
    "MET_LONG": "i4", "MET_ULONG": "u4",
}  # fmt: skip
# The format's millimetres are believed below this; a scan in micrometres mostly states more.
_PLAIN_MILLIMETRES = 1.0


def read(path: Path, options: ReadOptions) -> Reading:
    """Read an MHA file, or an MHD header with its data file.

    MetaImage gives lengths in millimetres by ITK's convention, and ``DistanceUnits`` where a
    file departs from it; a caller who knows better passes `voxel_size` or `unit` to `open_scan`.
    A file without ``ElementSpacing`` (or ``ElementSize``) has no voxel size: ITK's silent
    default of 1 mm is not believed, and voxels of a millimetre and more are asked about.

    Raises
    ------
    ScanError
        If the file is damaged, cut off, or no grey volume; or names files in another folder.
    """
    fields, data_start = _header(path)
    spacing_text = fields.get("ElementSpacing", fields.get("ElementSize"))
    shape = _shape(fields, path)
    channels = _whole(fields, "ElementNumberOfChannels", 1, path)
    try:
        steps, origin = _steps(fields, spacing_text)
    except ValueError as error:
        raise ScanError(
            f"The header of {path} contains an invalid number ({error}): correct it or export it again."
        ) from error
    raw = _voxels(path, fields, data_start, shape, channels)
    voxels: VoxelArray = raw
    if isinstance(raw, np.ndarray):
        voxels = decode(raw, PixelMeaning(samples=channels), path, numbers=options.numbers)
    require_grey_volume(voxels.shape, voxels.dtype, path)
    if spacing_text is None:
        return Reading(voxels, metadata=fields)
    wrong = impossible(steps)
    if wrong is not None:
        return Reading(voxels, metadata=fields, doubt=wrong)
    scale, unit, unit_word = _unit(fields)
    voxels, spacing, corner, flipped = along_axes(voxels, steps * scale, origin * scale, path)
    grid = Grid(steps * scale, origin * scale, unit, flipped)
    doubt = None
    if "DistanceUnits" not in fields and max(spacing) >= _PLAIN_MILLIMETRES:
        doubt = (
            f"gives a voxel size of {_edges(spacing)} (z, y, x), which MetaImage means in millimetres, "
            "which programs also write for an unknown size or for micrometres"
        )
    return Reading(
        voxels,
        spacing,
        unit,
        unit_word,
        corner,
        fields,
        grid=None if grid.is_placeholder else grid,
        doubt=doubt,
    )


def name_of_data(path: Path) -> str:
    """Return which file a header says to hold its voxels."""
    return _header(path)[0]["ElementDataFile"].removeprefix("./")


def _edges(spacing: tuple[float, float, float]) -> str:
    return " x ".join(f"{edge:g}" for edge in spacing)


def _first(fields: dict[str, str], default: str, *names: str) -> str:
    """Return the value of the first name that is there."""
    return next((fields[name] for name in names if name in fields), default)


def _header(path: Path) -> tuple[dict[str, str], int]:
    """Return the ``key = value`` lines up to ElementDataFile, and the byte after them."""
    fields: dict[str, str] = {}
    with path.open("rb") as stream:
        for number in range(400):
            content = stream.readline(65536)
            if not content:
                break
            line = plain_text(content).strip().strip("\ufeff")
            if not line or line.startswith(("#", "%", "//")):
                continue
            key, sign, value = line.partition("=")
            if not sign:
                key, sign, value = line.partition(":")
            if not sign:
                if number == 0 or "\0" in line:
                    break
                continue
            fields[key.strip()] = value.strip()
            if key.strip() == "ElementDataFile":
                return fields, stream.tell()
    raise ScanError(f"{path} is not a MetaImage header (no ElementDataFile): copy or export it again.")


def _whole(fields: dict[str, str], name: str, default: int, path: Path) -> int:
    """Return a whole number of the header, `default` where it says nothing."""
    text = fields.get(name, str(default)).strip()
    if not re.fullmatch(r"-?[0-9]{1,18}", text):
        raise ScanError(
            f"The header of {path} gives {name} as '{text[:60]}', which is not a whole number: correct it or "
            f"export "
            "it again."
        )
    return int(text)


def _shape(fields: dict[str, str], path: Path) -> tuple[int, int, int]:
    """Return the number of voxels (z, y, x); further axes of one voxel are dropped."""
    words = fields.get("DimSize", "").split()
    if not words or not all(re.fullmatch(r"-?[0-9]{1,12}(\.0*)?", word) for word in words):
        raise ScanError(f"{path} does not say how many voxels it holds (DimSize): export it again.")
    counts = [int(word.partition(".")[0]) for word in words]
    axes = _whole(fields, "NDims", len(counts), path)
    if axes != len(counts):
        raise ScanError(
            f"{path} states {axes} axes (NDims), but {len(counts)} numbers of voxels (DimSize): correct it."
        )
    while len(counts) > 3 and counts[-1] == 1:
        counts.pop()
    if axes == 2 and len(counts) == 2:
        counts.append(1)
    channels = fields.get("ElementNumberOfChannels", "1").strip()
    if len(counts) != 3 or not 1 <= _whole(fields, "ElementNumberOfChannels", 1, path) <= 1000:
        raise ScanError(
            f"{path} has {axes} axes with {channels} channels: "
            "a scan has three axes (z, y, x) and one grey value per voxel."
        )
    if min(counts) < 1:
        raise ScanError(f"{path} contains no voxels (DimSize = {fields['DimSize']}): export the scan again.")
    x, y, z = counts
    return z, y, x


def _is_true(text: str) -> bool:
    return text.strip().lower() in ("true", "t", "1", "yes")


def _voxels(
    path: Path, fields: dict[str, str], data_start: int, shape: tuple[int, int, int], channels: int
) -> np.ndarray | SliceStack:
    """Return the voxels: mapped, unpacked, or slice by slice where they are in several files."""
    named = fields["ElementDataFile"]
    full = shape if channels == 1 else (*shape, channels)
    if named.upper() == "LOCAL":
        return read_part(path, full, _storage(path, fields, path, full, data_start), path)
    if named.upper().split()[:1] == ["LIST"]:
        names = _listed(path, data_start)
    elif "%" in named:
        names = numbered_names(path, named)
    else:
        file = side_car(path, named)
        return read_part(file, full, _storage(path, fields, file, full, 0), path)
    files = named_files(path, names, shape[0])
    deep = shape[0] // len(files)
    part = (deep, *full[1:])
    how = _storage(path, fields, files[0], part, 0)
    for file in files:
        if how.packing == "raw":
            read_part(file, part, how, path)  # its length is checked, and no more
    if channels > 1:
        require_memory(full, how.dtype.itemsize, path)
        return np.concatenate([read_part(file, part, how, path) for file in files])

    def read_slice(index: int) -> np.ndarray:
        return np.array(read_part(files[index // deep], part, how, path)[index % deep])

    return SliceStack(read_slice, shape, how.dtype)


def _listed(path: Path, data_start: int) -> list[str]:
    """Return the names in the lines behind ``ElementDataFile = LIST``."""
    with path.open("rb") as stream:
        stream.seek(data_start)
        content = stream.read(2**24)
    return [line.strip() for line in plain_text(content).splitlines() if line.strip()]


def _storage(
    path: Path, fields: dict[str, str], file: Path, shape: tuple[int, ...], data_start: int
) -> Storage:
    """Return how voxels lie in a file, as the header says."""
    kind = fields.get("ElementType", "").strip().upper().removesuffix("_ARRAY")
    if kind not in _DTYPES:
        raise ScanError(
            f"{path} holds values of type {kind or 'unknown'} (ElementType): export grey values as whole or "
            "real numbers."
        )
    big = _is_true(_first(fields, "False", "BinaryDataByteOrderMSB", "ElementByteOrderMSB"))
    dtype: np.dtype[Any] = np.dtype((">" if big else "<") + _DTYPES[kind])
    header_size = _whole(fields, "HeaderSize", 0, path)
    if header_size < -1:
        raise ScanError(
            f"The header of {path} gives HeaderSize as {header_size}: correct it or export it again."
        )
    start = -1 if header_size < 0 else data_start + header_size
    if _is_true(fields.get("CompressedData", "False")):
        if "LONG" in kind and "LONG_LONG" not in kind:
            raise ScanError(f"{path} holds packed {kind}, whose length is not told: export it as MET_INT.")
        length = None
        if "CompressedDataSize" in fields:
            length = max(0, _whole(fields, "CompressedDataSize", 0, path))
        return Storage("zlib or gzip", dtype, start, length=length or None)
    if not _is_true(fields.get("BinaryData", "True")):
        return Storage("text", dtype, max(start, 0))
    is_long = kind in ("MET_LONG", "MET_ULONG") and file.is_file() and start >= 0
    if is_long and file.stat().st_size - start == 8 * math.prod(shape):
        dtype = np.dtype(dtype.str[:2] + "8")
    return Storage("raw", dtype, start)


def _steps(fields: dict[str, str], spacing_text: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the steps along x, y, z and the position of the first voxel."""
    origin_text = _first(fields, "0 0 0", "Offset", "Position", "Origin")
    turn_text = _first(fields, "", "TransformMatrix", "Rotation", "Orientation")
    origin = np.array([float(value) for value in origin_text.split()] + [0.0, 0.0, 0.0])[:3]
    turn = np.array([float(value) for value in turn_text.split()])
    if turn.size == 9:
        directions = turn.reshape(3, 3)
    elif turn.size == 16:
        directions = turn.reshape(4, 4)[:3, :3]
    elif turn.size in (0, 4):
        directions = np.eye(3)
    else:
        raise ValueError(f"TransformMatrix has {turn.size} numbers")
    values = [float(value) for value in (spacing_text or "1 1 1").split()]
    if len(values) == 2:
        values.append(values[-1])
    if len(values) < 3:
        raise ValueError(f"ElementSpacing has {len(values)} numbers")
    spacing = np.array(values[:3])
    # What is infinite, or none, is refused with the voxel size.
    with np.errstate(over="ignore", invalid="ignore"):
        return directions * spacing[:, None], origin


def _unit(fields: dict[str, str]) -> tuple[float, str | None, str | None]:
    """Return the file's DistanceUnits, millimetres where it has none, and the word if it is no length."""
    word = fields.get("DistanceUnits", "mm")
    if names_no_length(word):
        return 1.0, "mm", None
    try:
        scale, unit = length_unit(word)
    except UnitError:
        return 1.0, None, word
    return scale, unit, None


FAMILY = Family("MetaImage volume", (".mha", ".mhd"), read)
