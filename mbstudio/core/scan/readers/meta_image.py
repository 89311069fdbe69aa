"""MetaImage (MHD, MHA): memory-mapped where it is one uncompressed block, else read by SimpleITK."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError, UnitError
from mbstudio.core.scan.grid import Grid
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
from mbstudio.core.units import names_no_length

_DTYPES = {
    "MET_UCHAR": "u1", "MET_CHAR": "i1", "MET_USHORT": "u2", "MET_SHORT": "i2", "MET_UINT": "u4",
    "MET_INT": "i4", "MET_FLOAT": "f4", "MET_DOUBLE": "f8", "MET_ULONG_LONG": "u8", "MET_LONG_LONG": "i8",
}  # fmt: skip
_BYTES = {"MET_LONG": 8, "MET_ULONG": 8}
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
        If the file is damaged, cut off, or no grey volume.
    """
    fields, data_start = _header(path)
    spacing_text = fields.get("ElementSpacing", fields.get("ElementSize"))
    shape = _shape(fields, path)
    channels = int(_first(fields, "1", "ElementNumberOfChannels"))
    try:
        steps, origin = _steps(fields, spacing_text)
        int(fields.get("HeaderSize", "0"))
    except ValueError as error:
        raise ScanError(
            f"The header of {path} holds what is no number ({error}): correct it or export it again."
        ) from error
    try:
        raw = _mapped(path, fields, data_start, shape, channels)
        if raw is None:
            raw = _by_itk(path, fields, shape, channels)
    except (ScanError, MemoryError):
        raise
    except (RuntimeError, ValueError, OSError, KeyError) as error:
        reason = str(error).strip().splitlines()[-1] if str(error).strip() else type(error).__name__
        raise ScanError(
            f"{path} cannot be read as MetaImage ({reason}): "
            "it or its data file is damaged, missing or cut off; copy or export it again."
        ) from error
    voxels: VoxelArray = decode(raw, PixelMeaning(samples=channels), path, numbers=options.numbers)
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
            "as large as programs write where they know none or mean micrometres"
        )
    return Reading(
        voxels,
        spacing,
        unit,
        unit_word,
        corner,
        fields,
        grid=None if grid.says_nothing else grid,
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


def _shape(fields: dict[str, str], path: Path) -> tuple[int, int, int]:
    """Return the number of voxels (z, y, x); further axes of one voxel are dropped."""
    try:
        counts = [int(float(count)) for count in fields["DimSize"].split()]
        axes = int(fields.get("NDims", len(counts)))
    except (KeyError, ValueError) as error:
        raise ScanError(
            f"{path} does not say how many voxels it holds (DimSize): export it again."
        ) from error
    while len(counts) > 3 and counts[-1] == 1:
        counts.pop()
    if axes == 2 and len(counts) == 2:
        counts.append(1)
    channels = fields.get("ElementNumberOfChannels", "1")
    if len(counts) != 3 or not channels.isdigit():
        raise ScanError(
            f"{path} has {fields.get('NDims', len(counts))} axes with {channels} channels: "
            "a scan has three axes (z, y, x) and one grey value per voxel."
        )
    if min(counts) < 1:
        raise ScanError(f"{path} contains no voxels (DimSize = {fields['DimSize']}): export the scan again.")
    x, y, z = counts
    return z, y, x


def _true(text: str) -> bool:
    return text.strip().lower() in ("true", "t", "1", "yes")


def _mapped(
    path: Path, fields: dict[str, str], data_start: int, shape: tuple[int, int, int], channels: int
) -> np.ndarray | None:
    """Map the voxels where they are one uncompressed block of known type."""
    file_name, header_size = fields["ElementDataFile"], int(fields.get("HeaderSize", "0"))
    is_local = file_name.upper() == "LOCAL"
    if file_name.upper().split()[:1] == ["LIST"] or "%" in file_name or len(file_name.split()) == 4:
        raise ScanError(
            f"{path} spreads its data over several files ({file_name}): save it as one file, "
            "or open the folder of slices."
        )
    file, start = (path, data_start) if is_local else (side_car(path, file_name), 0)
    if not file.is_file():
        raise ScanError(f"{path} names the data file {file.name}, which is missing: put it beside.")
    if _true(fields.get("CompressedData", "False")) or not _true(fields.get("BinaryData", "True")):
        return None
    kind = fields.get("ElementType", "")
    if kind not in _DTYPES:
        return None
    big = _true(_first(fields, "False", "BinaryDataByteOrderMSB", "ElementByteOrderMSB"))
    dtype = np.dtype(_DTYPES[kind]).newbyteorder(">" if big else "<")
    full = shape if channels == 1 else (*shape, channels)
    needed, there = math.prod(full) * dtype.itemsize, file.stat().st_size
    start = there - needed if header_size < 0 else start + header_size
    if start < 0 or start + needed > there:
        raise ScanError(
            f"{path} states {' x '.join(map(str, shape))} voxels (z, y, x) of {dtype.name}, {needed:,} "
            "bytes, "
            f"but {file.name} holds {there:,}: it is cut off, or the header is wrong."
        )
    return np.memmap(file, dtype, "r", start, full)


def _by_itk(path: Path, fields: dict[str, str], shape: tuple[int, int, int], channels: int) -> np.ndarray:
    """Read what is compressed, or written out as text."""
    import SimpleITK as sitk

    kind = fields.get("ElementType", "")
    itemsize = np.dtype(_DTYPES[kind]).itemsize if kind in _DTYPES else _BYTES.get(kind, 1)
    name = fields["ElementDataFile"]
    file = path if name.upper() == "LOCAL" else side_car(path, name)
    packed = _true(fields.get("CompressedData", "False"))
    require_memory(shape, itemsize * channels, path, file.stat().st_size if packed else None)
    voxels: np.ndarray = sitk.GetArrayFromImage(sitk.ReadImage(str(path)))
    return voxels


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
    spacing = np.array(values[:3])
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
