"""GE (phoenix datos|x): `.vol` voxels with a `.pcr` beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions, require_beside
from mbstudio.core.scan.readers.side_cars.key_values import read_key_values, whole_number
from mbstudio.core.scan.readers.side_cars.layout import RawLayout, open_layout

# Codes of Format, as SlicerMorph's importer has them.
_TYPES = {1: "<u1", 5: "<u2", 10: "<f4"}
_SECTION = "volumedata"


def read(path: Path, options: ReadOptions) -> Reading:
    """Read the voxels beside a ``.pcr`` file, which have its name.

    Raises
    ------
    ScanError
        If the description is incomplete, or does not fit the voxels.
    """
    return open_layout(describe(path, None), options)


def describe(path: Path, data: Path | None) -> RawLayout:
    """Return what a ``.pcr`` file says about `data`, or about the ``.vol`` of its own name.

    Raises
    ------
    ScanError
        If it does not say how many voxels of which type there are, or the volume is missing.
    """
    said = read_key_values(path)
    if _SECTION not in {where for where, _, _ in said.entries}:
        raise ScanError(
            f"{path} is not a description of a reconstruction by datos|x ([VolumeData] is missing): "
            "copy it again."
        )
    x, y, z = (said.count(f"Volume_Size{axis}", _SECTION) for axis in "XYZ")
    code = whole_number(said.text("Format", _SECTION))
    if code not in _TYPES:
        raise ScanError(
            f"{path} gives Format as {said.text('Format', _SECTION)}, and only 1 (8 bits), 5 (16 bits) "
            f"and 10 "
            "(float) are known: state shape and dtype."
        )
    if data is None:
        data = next((other for end in (".vol", ".VOL") if (other := path.with_suffix(end)).exists()), None)
        if data is None:
            raise ScanError(
                f"{path} describes the voxels in {path.stem}.vol, which is missing: put it beside."
            )
        require_beside(path, data)
    edge = said.length("VoxelSizeRec", _SECTION)
    return RawLayout(
        data,
        str(path),
        (z, y, x),
        np.dtype(_TYPES[code]),
        spacing=(edge, edge, edge) if edge else None,
        unit="mm" if edge else None,
        metadata=said.as_metadata(),
    )


FAMILY = Family("GE phoenix volume", (".pcr",), read)
