"""Voreen, Inviwo and volvis.org: `.raw` voxels with a text `.dat` beside them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.family import side_car
from mbstudio.core.scan.readers.side_cars.key_values import KeyValues, read_key_values, real_number
from mbstudio.core.scan.readers.side_cars.layout import RawLayout
from mbstudio.core.scan.readers.tiff_lengths import Spacing

_TYPES = {
    "uchar": "u1", "uint8": "u1", "char": "i1", "int8": "i1", "ushort": "u2", "uint16": "u2", "short": "i2",
    "int16": "i2", "uint": "u4", "uint32": "u4", "int": "i4", "int32": "i4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_NAMES = re.compile(rb"^\s*(?:ObjectFileName|RawFile)\s*:", re.IGNORECASE | re.MULTILINE)


def is_description(path: Path) -> bool:
    """Return whether a ``.dat`` is the text that names a file of voxels, rather than voxels."""
    with path.open("rb") as stream:
        start = stream.read(4096)
    return b"\0" not in start and _NAMES.search(start) is not None


def describe(path: Path, data: Path | None = None) -> RawLayout | None:
    """Return what a ``.dat`` says about the file that it names, None if that is not `data`.

    The unit of its ``SliceThickness`` is not said.

    Raises
    ------
    ScanError
        If it says too little, or names a file in another folder.
    """
    said = read_key_values(path, ":")
    named = side_car(path, said.value("ObjectFileName") or said.text("RawFile"))
    if data is not None and named.name != data.name:
        return None
    counts = said.counts(said.text("Resolution").split(), "Resolution")
    kind = said.text("Format").strip().lower()
    if len(counts) != 3 or kind not in _TYPES:
        raise ScanError(
            f"{path} gives a Resolution of {said.text('Resolution')} and a Format of {said.text('Format')}, "
            "and a scan has three axes of whole or real numbers: state shape and dtype."
        )
    x, y, z = counts
    big = (said.value("ByteOrder") or said.value("Endianess") or "").lower().startswith(("big", "msb"))
    return RawLayout(
        named,
        str(path),
        (z, y, x),
        np.dtype((">" if big else "<") + _TYPES[kind]),
        said.skipped_bytes("ByteOffset"),
        spacing=_thickness(said),
        metadata=said.as_metadata(),
    )


def _thickness(said: KeyValues) -> Spacing | None:
    text = said.value("SliceThickness") or said.value("Spacing")
    edges = [real_number(word) for word in (text or "").split()]
    x, y, z = edges if len(edges) == 3 else (None, None, None)
    if not x or not y or not z or min(x, y, z) < 0:
        return None
    # What says 1 1 1 says nothing but that voxels are cubes.
    return None if x == y == z == 1 else (z, y, x)
