"""MetaImage (MHD, MHA): memory-mapped where it is one uncompressed block, else read by SimpleITK."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError, UnitError
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions, require_grey_volume
from mbstudio.core.scan.readers.orientation import along_axes
from mbstudio.core.scan.scan import VoxelArray
from mbstudio.core.units import parse_unit

_DTYPES = {
    "MET_UCHAR": "u1", "MET_CHAR": "i1", "MET_USHORT": "u2", "MET_SHORT": "i2", "MET_UINT": "u4",
    "MET_INT": "i4", "MET_FLOAT": "f4", "MET_DOUBLE": "f8",
}  # fmt: skip


def read(path: Path, options: ReadOptions) -> Reading:
    """Read an MHA file, or an MHD header with its data file.

    MetaImage gives lengths in millimetres by ITK's convention, and ``DistanceUnits`` where a
    file departs from it; a caller who knows better passes `voxel_size` or `unit` to `open_scan`.
    A file without ``ElementSpacing`` (or ``ElementSize``) has no voxel size: ITK's silent
    default of 1 mm is not believed.

    Raises
    ------
    ScanError
        If the file is damaged, cut off, or no grey volume.
    """
    fields, data_start = _header(path)
    spacing_text = fields.get("ElementSpacing", fields.get("ElementSize"))
    if fields.get("NDims", "3") != "3" or fields.get("ElementNumberOfChannels", "1") != "1":
        raise ScanError(
            f"{path} has {fields.get('NDims')} axes with {fields.get('ElementNumberOfChannels', '1')} "
            "channels: a scan has three axes (z, y, x) and one grey value per voxel."
        )
    try:
        voxels: VoxelArray | None = _mapped(path, fields, data_start)
        if voxels is None:
            import SimpleITK as sitk

            voxels = sitk.GetArrayFromImage(sitk.ReadImage(str(path)))
        steps, origin = _steps(fields, spacing_text)
    except (RuntimeError, ValueError, OSError, KeyError) as error:
        reason = str(error).strip().splitlines()[-1] if str(error).strip() else type(error).__name__
        raise ScanError(
            f"{path} cannot be read as MetaImage ({reason}): "
            "it or its data file is damaged, missing or cut off; copy or export it again."
        ) from error
    require_grey_volume(voxels.shape, voxels.dtype, path)
    if spacing_text is None:
        return Reading(voxels, metadata=fields)
    voxels, spacing, corner = along_axes(voxels, steps, origin, path)
    return Reading(voxels, spacing, _unit(fields), corner, fields)


def _header(path: Path) -> tuple[dict[str, str], int]:
    """Return the ``key = value`` lines up to ElementDataFile, and the byte after them."""
    fields: dict[str, str] = {}
    with path.open("rb") as stream:
        for _ in range(200):
            line = stream.readline(4096)
            key, equals, value = line.decode("latin-1").partition("=")
            if not equals:
                break
            fields[key.strip()] = value.strip()
            if key.strip() == "ElementDataFile":
                return fields, stream.tell()
    raise ScanError(f"{path} is not a MetaImage header (no ElementDataFile): copy or export it again.")


def _mapped(path: Path, fields: dict[str, str], data_start: int) -> np.ndarray | None:
    """Map the voxels where they are one uncompressed block of known type."""
    file_name, header_size = fields["ElementDataFile"], int(fields.get("HeaderSize", "0"))
    compressed = fields.get("CompressedData", "False").lower() == "true"
    ascii_data = fields.get("BinaryData", "True").lower() == "false"
    if compressed or ascii_data or header_size or file_name.startswith("LIST") or "%" in file_name:
        return None
    if fields["ElementType"] not in _DTYPES:
        return None
    big = fields.get("BinaryDataByteOrderMSB", fields.get("ElementByteOrderMSB", "False")).lower() == "true"
    dtype = np.dtype(_DTYPES[fields["ElementType"]]).newbyteorder(">" if big else "<")
    shape = tuple(int(count) for count in fields["DimSize"].split())[::-1]
    file, start = (path, data_start) if file_name == "LOCAL" else (path.parent / file_name, 0)
    return np.memmap(file, dtype, "r", start, shape)


def _steps(fields: dict[str, str], spacing_text: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the steps along x, y, z and the position of the first voxel."""
    origin_text = fields.get("Offset", fields.get("Position", fields.get("Origin", "0 0 0")))
    origin = np.array([float(value) for value in origin_text.split()])
    turn_text = fields.get(
        "TransformMatrix", fields.get("Rotation", fields.get("Orientation", "1 0 0 0 1 0 0 0 1"))
    )
    directions = np.array([float(value) for value in turn_text.split()]).reshape(3, 3)
    spacing = np.array([float(value) for value in (spacing_text or "1 1 1").split()])
    return directions * spacing[:, None], origin


def _unit(fields: dict[str, str]) -> str:
    """Return the file's DistanceUnits, millimetres where it has none."""
    try:
        return parse_unit(fields.get("DistanceUnits", "mm"))
    except UnitError:
        return "mm"


FAMILY = Family("MetaImage volume", (".mha", ".mhd"), read)
