"""Opening a scan of any family, and recognising it again by its voxels."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError, UnitError
from mbstudio.core.scan.readers import Reading, ReadOptions, family_of
from mbstudio.core.scan.scan import Scan
from mbstudio.core.units import VoxelSize, conversion_factor


def open_scan(
    path: str | Path,
    voxel_size: str | float | Sequence[float] | VoxelSize | None = None,
    *,
    unit: str | None = None,
    shape: tuple[int, int, int] | None = None,
    dtype: str | np.dtype[Any] | type | None = None,
    header_bytes: int = 0,
    big_endian: bool = False,
) -> Scan:
    """Open a scan without reading more of it than needed.

    Parameters
    ----------
    path : str or Path
        A multi-page TIFF, a folder of slices (TIFF or PNG, natural order), RAW, NPY, NRRD or
        MetaImage (MHD, MHA) file.
    voxel_size : str, float, sequence of float or VoxelSize, optional
        ``"14 um"``, ``"20 x 14 x 14 um"`` (z, y, x) or numbers with `unit`. It overrides what
        the file says; it must be given where the file says nothing. The origin is then zero.
    unit : str, optional
        Unit of `voxel_size` if that is numbers; without `voxel_size`, the unit in which the
        file's own spacing is to be read (overriding the file's).
    shape, dtype, header_bytes, big_endian
        What a RAW file holds: number of voxels (z, y, x), type, bytes to skip, byte order.

    Returns
    -------
    Scan
        With memory-mapped or lazy voxels where the file allows it.

    Raises
    ------
    ScanError
        If the file is missing, damaged, cut off, or no grey volume.
    UnitError
        If neither the file nor the caller gives the voxel size and its unit.
    """
    path = Path(path)
    if not path.exists():
        raise ScanError(f"{path} does not exist: check the name and the folder.")
    options = ReadOptions(shape, _dtype(dtype), header_bytes, big_endian)
    try:
        reading = family_of(path, options).read(path, options)
    except OSError as error:
        raise ScanError(f"{path} cannot be read ({error}): check that you may read it.") from error
    size, origin = _place(reading, voxel_size, unit, path)
    return Scan(reading.voxels, size, origin, path, MappingProxyType(dict(reading.metadata)))


def _dtype(name: str | np.dtype[Any] | type | None) -> np.dtype[Any] | None:
    if name is None:
        return None
    try:
        return np.dtype(name)
    except TypeError as error:
        raise ScanError(
            f"'{name}' is not a voxel type: give for example uint8, uint16 or float32."
        ) from error


def _place(
    reading: Reading,
    voxel_size: str | float | Sequence[float] | VoxelSize | None,
    unit: str | None,
    path: Path,
) -> tuple[VoxelSize, tuple[float, float, float]]:
    """Return voxel size and origin, the caller's word before the file's."""
    if voxel_size is not None:
        return VoxelSize.parse(voxel_size, unit), (0.0, 0.0, 0.0)
    if reading.spacing is None:
        raise UnitError(f"{path} does not contain the voxel size: give voxel_size, for example '14 um'.")
    file_unit = unit or reading.unit
    if file_unit is None:
        edges = " x ".join(f"{edge:g}" for edge in reading.spacing)
        raise UnitError(
            f"{path} gives a voxel size of {edges} (z, y, x) without a unit: "
            "give unit, for example 'um', or voxel_size."
        )
    try:
        size = VoxelSize(*reading.spacing, unit=file_unit)
    except UnitError as error:
        raise UnitError(f"{path}: {error}") from error
    return _readable(size, reading.origin)


def _readable(
    size: VoxelSize, origin: tuple[float, float, float]
) -> tuple[VoxelSize, tuple[float, float, float]]:
    """Express centimetres of a TIFF resolution tag in the unit that suits the voxel."""
    if size.unit != "cm":
        return size, origin
    target = "um" if size.to("um").x < 1000 else "mm"
    factor = conversion_factor("cm", target)
    x, y, z = (coordinate * factor for coordinate in origin)
    return size.to(target), (x, y, z)


def voxel_digest(scan: Scan) -> str:
    """Return the SHA-256 of the voxels as they lie in memory order (z, y, x), slice by slice.

    The voxels are hashed in little-endian order, so that the digest depends on neither file
    format nor machine.
    """
    digest = hashlib.sha256()
    dtype = np.dtype(scan.voxels.dtype).newbyteorder("<")
    for index in range(scan.shape[0]):
        digest.update(np.ascontiguousarray(scan.voxels[index], dtype=dtype).data)
    return digest.hexdigest()
