"""Opening a scan of any family, and recognising it again by its voxels."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from mbstudio.core.errors import MbstudioError, ScanError, ScanWarning, UnitError
from mbstudio.core.scan.excerpt import Bin, Crop
from mbstudio.core.scan.readers import Reading, ReadOptions, family_of, split_dataset
from mbstudio.core.scan.readers.family import memory_refusal, require_file
from mbstudio.core.scan.scan import Scan
from mbstudio.core.scan.voxel_blocks import in_memory_bytes, is_mapped
from mbstudio.core.units import METRES_PER_UNIT, VoxelSize, conversion_factor

# Lengths of a voxel's edge in metres that a scan may have without being asked about.
_SMALLEST_VOXEL, _LARGEST_VOXEL = 1e-8, 1e-2
# A part of a scan up to this size is read at once; a larger one is read when it is needed.
_READ_AT_ONCE_BYTES = 4 << 30
_STATE_IT = "state the voxel size with voxel_size or --voxel-size, for example '14 um'."


def open_scan(
    path: str | Path,
    voxel_size: str | float | Sequence[float] | VoxelSize | None = None,
    *,
    unit: str | None = None,
    shape: tuple[int, int, int] | None = None,
    dtype: str | np.dtype[Any] | type | None = None,
    header_bytes: int = 0,
    big_endian: bool = False,
    crop: Crop | None = None,
    binning: Bin | None = None,
) -> Scan:
    """Open a scan, or a region of it, without reading more of it than needed.

    Parameters
    ----------
    path : str or Path
        A multi-page TIFF, a folder of slices (TIFF, PNG, BMP or JPEG, in the order of their
        numbers), RAW, NPY, NRRD, MetaImage (MHD, MHA), NIfTI or HDF5 file, a folder of DICOM or OME-Zarr,
        or a volume of a scanner (VGI, XTEKCT, PCR, TXM) or of Avizo (AM).
        One of several arrays is named behind a colon: ``scan.h5:/entry/data``, ``scan.zarr:c=1``.
    voxel_size : str, float, sequence of float or VoxelSize, optional
        ``"14 um"``, ``"20 x 14 x 14 um"`` (z, y, x) or numbers with `unit`. It overrides what
        the file says; it must be given where the file says nothing. The origin is then zero.
    unit : str, optional
        Unit of `voxel_size` if that is numbers; without `voxel_size`, the unit in which the
        file's own spacing is to be read (overriding the file's).
    shape, dtype, header_bytes, big_endian
        What a RAW file holds: number of voxels (z, y, x), type, bytes to skip, byte order.
    crop : str, slice or sequence of slice, optional
        Region in voxels of the file, as in :meth:`Scan.cropped`. Voxel size and origin follow.
    binning : int, str or sequence of int, optional
        Voxels of the region that become one, as in :meth:`Scan.binned`.

    Returns
    -------
    Scan
        With memory-mapped or lazy voxels where the file allows it. Of a part, no more than that is
        kept in memory.

    Raises
    ------
    ScanError
        If the file is missing, damaged, cut off, or no grey volume, or the region or the bin does
        not fit it.
    UnitError
        If neither the file nor the caller gives the voxel size and its unit, or the file's
        cannot be meant.

    Warns
    -----
    ScanWarning
        If something about the file was taken for granted, or images in a folder were left out.
    """
    path = Path(path)
    in_part = crop is not None or binning is not None
    options = ReadOptions(shape, _dtype(dtype), header_bytes, big_endian, in_part=in_part)
    reading = read_file(path, options)
    size, origin, notes = place(reading, voxel_size, unit, path)
    notes = tuple(f"{path} {note}" for note in (*reading.notes, *notes))
    metadata = MappingProxyType(dict(reading.metadata))
    scan = Scan(reading.voxels, size, origin, path, metadata, reading.grid, notes)
    del reading
    if in_part:
        scan = _taken_out(scan, crop, binning)
    for note in scan.notes:
        warnings.warn(note, ScanWarning, stacklevel=2)
    return scan


def _taken_out(scan: Scan, crop: Crop | None, binning: Bin | None) -> Scan:
    """Return a part of a scan that keeps nothing else in memory."""
    part = scan.cropped(crop) if crop is not None else scan
    part = part.binned(binning) if binning is not None else part
    voxels = part.voxels
    if part is scan or is_mapped(voxels) or in_memory_bytes(part.shape, voxels.dtype) > _READ_AT_ONCE_BYTES:
        return part
    # A view would keep all the voxels that it was cut from.
    return replace(part, voxels=np.array(voxels))


def source_exists(path: str | Path) -> bool:
    """Return whether there is a file or folder that `open_scan` could open under this name."""
    file, _ = split_dataset(Path(path))
    return file.exists()


def read_file(path: Path, options: ReadOptions) -> Reading:
    """Read what a file or folder holds, whatever it says about the size of its voxels.

    Raises
    ------
    ScanError
        If it is missing, damaged, cut off, or no volume.
    """
    file, dataset = split_dataset(path)
    if not file.exists():
        raise ScanError(f"{file} does not exist: check the name and the folder.")
    if not file.is_dir():
        require_file(file)
    if dataset is not None:
        options = replace(options, dataset=dataset)
    family = family_of(file, options)
    try:
        return family.read(file, options)
    except MbstudioError:
        raise
    except MemoryError as error:
        raise memory_refusal(file) from error
    except OSError as error:
        raise ScanError(f"{file} cannot be read ({error}): check that you may read it.") from error
    except Exception as error:  # a file may be wrong in ways that its reader has not thought of
        raise ScanError(
            f"{file} cannot be read as {family.name} ({type(error).__name__}: {error}): "
            "export it again, or in another format."
        ) from error


def _dtype(name: str | np.dtype[Any] | type | None) -> np.dtype[Any] | None:
    if name is None:
        return None
    try:
        return np.dtype(name)
    except TypeError as error:
        raise ScanError(
            f"'{name}' is not a voxel type: give for example uint8, uint16 or float32."
        ) from error


def place(
    reading: Reading,
    voxel_size: str | float | Sequence[float] | VoxelSize | None,
    unit: str | None,
    path: Path,
) -> tuple[VoxelSize, tuple[float, float, float], tuple[str, ...]]:
    """Return voxel size, origin and notes, the caller's word before the file's.

    Raises
    ------
    UnitError
        If neither says the voxel size, or what the file says cannot be meant.
    """
    if voxel_size is not None:
        size = VoxelSize.parse(voxel_size, unit)
        return size, (0.0, 0.0, 0.0), _unusual(size)
    if reading.spacing is None and reading.doubt is not None:
        raise UnitError(f"{path} {reading.doubt}: {_STATE_IT}")
    if reading.spacing is None:
        if reading.unit_word is not None:
            raise UnitError(
                f"{path} gives its voxel size in '{reading.unit_word}', which is not a length unit "
                f"that mbstudio knows: {_STATE_IT}"
            )
        raise UnitError(f"{path} does not contain the voxel size: give voxel_size, for example '14 um'.")
    file_unit = unit or reading.unit
    edges = " x ".join(f"{edge:g}" for edge in reading.spacing)
    if file_unit is None:
        said = (
            f"in '{reading.unit_word}', which is not a length unit that mbstudio knows"
            if reading.unit_word is not None
            else "without a unit"
        )
        raise UnitError(
            f"{path} gives a voxel size of {edges} (z, y, x) {said}: "
            "give unit, for example 'um', or voxel_size."
        )
    if reading.doubt is not None and unit is None:
        raise UnitError(f"{path} {reading.doubt}: {_STATE_IT}")
    try:
        size = VoxelSize(*reading.spacing, unit=file_unit)
    except UnitError as error:
        raise UnitError(f"{path}: {error}") from error
    if unit is not None:
        return *_readable(size, reading.origin), (*reading.size_notes, *_unusual(size))
    if _is_unusual(size):
        raise UnitError(
            f"{path} gives a voxel size of {size}, outside the range of scans (10 nm to 10 mm): {_STATE_IT}"
        )
    return *_readable(size, reading.origin), reading.size_notes


def _is_unusual(size: VoxelSize) -> bool:
    """Whether voxels are smaller or larger than those of any scan of grains."""
    metres = [edge * METRES_PER_UNIT[size.unit] for edge in size.zyx]
    return min(metres) < 0.999 * _SMALLEST_VOXEL or max(metres) > 1.001 * _LARGEST_VOXEL


def _unusual(size: VoxelSize) -> tuple[str, ...]:
    """Return the note on a stated voxel size that no scan has."""
    if not _is_unusual(size):
        return ()
    return (f"is opened with voxels of {size}, outside the range of scans (10 nm to 10 mm): check the unit.",)


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
