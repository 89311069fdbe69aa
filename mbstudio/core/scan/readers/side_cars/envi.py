"""ENVI: voxels with a `.hdr` beside them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.side_cars.key_values import KeyValues, read_text, whole_number
from mbstudio.core.scan.readers.side_cars.layout import RawLayout

_TYPES = {
    1: "u1", 2: "i2", 3: "i4", 4: "f4", 5: "f8", 12: "u2", 13: "u4", 14: "i8", 15: "u8",
}  # fmt: skip


def is_envi(path: Path) -> bool:
    """Return whether a ``.hdr`` is ENVI's: other programs have binary or other text under that ending."""
    with path.open("rb") as stream:
        return stream.read(8).strip().upper().startswith(b"ENVI")


def describe(path: Path, data: Path) -> RawLayout:
    """Return what an ENVI header says: samples, lines and bands are x, y and z. It has no voxel size.

    Raises
    ------
    ScanError
        If it says too little, or its bands are not stored one after the other.
    """
    text = re.sub(r"\{[^}]*\}", lambda list_: " ".join(list_[0].split()), read_text(path))
    entries = []
    for line in text.splitlines()[1:]:
        key, found, value = line.partition("=")
        if found:
            entries.append(("", " ".join(key.lower().split()), value.strip()))
    said = KeyValues(path, tuple(entries))
    x, y, z = (said.count(key) for key in ("samples", "lines", "bands"))
    interleave = (said.value("interleave") or "bsq").lower()
    if interleave != "bsq" and z > 1:
        raise ScanError(f"{path} stores its bands as {interleave.upper()}: save them as BSQ, slice by slice.")
    code, order = whole_number(said.text("data type")), whole_number(said.value("byte order") or "0")
    if code not in _TYPES or order not in (0, 1):
        raise ScanError(
            f"{path} gives voxels of data type {said.text('data type')} and byte order {order}, which are "
            f"not "
            "read: save them as whole or real numbers."
        )
    return RawLayout(
        data,
        str(path),
        (z, y, x),
        np.dtype((">" if order else "<") + _TYPES[code]),
        said.skipped_bytes("header offset"),
        metadata=said.as_metadata(),
    )
