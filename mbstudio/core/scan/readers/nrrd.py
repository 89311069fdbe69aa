"""NRRD: nearly raw raster data, memory-mapped where it is uncompressed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError, UnitError
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions, require_grey_volume
from mbstudio.core.scan.readers.orientation import along_axes
from mbstudio.core.scan.scan import VoxelArray
from mbstudio.core.units import parse_unit


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

    try:
        with path.open("rb") as stream:
            header: dict[str, Any] = dict(nrrd.read_header(stream))
            data_start = stream.tell()
        sizes = tuple(int(count) for count in header["sizes"])
        voxels: VoxelArray | None = _mapped(path, header, sizes, data_start)
        if voxels is None:
            voxels, _ = nrrd.read(str(path), index_order="C")
    except Exception as error:  # pynrrd raises errors of many unrelated types
        raise ScanError(
            f"{path} cannot be read as NRRD ({error}): it is damaged or cut off; copy or export it again."
        ) from error
    require_grey_volume(voxels.shape, voxels.dtype, path)
    steps, origin = _steps(header)
    metadata = {key: str(value) for key, value in header.items()}
    if steps is None:
        return Reading(voxels, metadata=metadata)
    voxels, spacing, corner = along_axes(voxels, steps, origin, path)
    return Reading(voxels, spacing, _unit(header, path), corner, metadata)


def _mapped(path: Path, header: dict[str, Any], sizes: tuple[int, ...], data_start: int) -> np.ndarray | None:
    """Map uncompressed voxels, None where the data must be decoded."""
    import nrrd

    skips = int(header.get("line skip", header.get("lineskip", 0))) or int(
        header.get("byte skip", header.get("byteskip", 0))
    )
    if header["encoding"] != "raw" or skips:
        return None
    file, start = path, data_start
    detached = header.get("data file", header.get("datafile"))
    if detached is not None:
        if not isinstance(detached, str) or detached.startswith("LIST") or "%" in detached:
            return None
        file, start = path.parent / detached, 0
    dtype = nrrd.reader._determine_datatype(header)
    return np.memmap(file, dtype, "r", start, sizes[::-1])


def _steps(header: dict[str, Any]) -> tuple[np.ndarray | None, np.ndarray]:
    """Return the steps along x, y, z and the position of the first voxel."""
    origin = np.asarray(header.get("space origin", np.zeros(3)), dtype=float)
    if origin.shape != (3,) or not np.isfinite(origin).all():
        origin = np.zeros(3)
    if "space directions" in header:
        return np.asarray(header["space directions"], dtype=float), origin
    if "spacings" in header:
        spacings = np.asarray(header["spacings"], dtype=float)
        if np.isfinite(spacings).all():
            return np.diag(spacings), origin
    return None, origin


def _unit(header: dict[str, Any], path: Path) -> str | None:
    """Return the unit that all axes share."""
    names = {
        str(name).strip().strip('"') for name in header.get("space units", header.get("units", [])) or []
    }
    names.discard("")
    if not names:
        return None
    if len(names) > 1:
        raise ScanError(
            f"{path} gives its axes different units ({', '.join(sorted(names))}): give voxel_size."
        )
    try:
        return parse_unit(names.pop())
    except UnitError:
        return None


FAMILY = Family("NRRD volume", (".nrrd", ".nhdr"), read)
