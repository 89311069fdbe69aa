"""ESRF (PyHST): `.vol` or `.raw` voxels with a `.vol.info` or `.raw.info` beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.side_cars.key_values import KeyValues, read_text
from mbstudio.core.scan.readers.side_cars.layout import RawLayout

_TYPES = {
    "uint8": "u1", "uchar": "u1", "int8": "i1", "uint16": "u2", "ushort": "u2", "int16": "i2", "short": "i2",
    "uint32": "u4", "int32": "i4", "float": "f4", "float32": "f4", "float64": "f8", "double": "f8",
}  # fmt: skip


def is_pyhst(path: Path) -> bool:
    """Return whether an ``.info`` file is PyHST's: other programs write anything under that ending."""
    with path.open("rb") as stream:
        return b"NUM_X" in stream.read(4096).upper()


def describe(path: Path, data: Path) -> RawLayout:
    """Return what PyHST's ``.info`` says about a volume.

    The unit of its ``voxelSize`` is not said. Without ``DATA_TYPE``, the length tells the type.

    Raises
    ------
    ScanError
        If it does not say how many voxels there are, or has them packed as bits.
    """
    entries = []
    for line in read_text(path).splitlines():
        key, found, value = line.partition("=")
        # s1 and S1 are different keys, but neither is of interest here.
        if found and key.strip().lower() not in ("s1", "s2"):
            entries.append(("", key.strip().lower(), value.strip()))
    said = KeyValues(path, tuple(entries))
    x, y, z = (said.count(f"NUM_{axis}") for axis in "XYZ")
    kind = (said.value("DATA_TYPE") or "").lower()
    if kind and kind not in _TYPES:
        raise ScanError(f"{path} gives voxels of '{kind}', which are not read: save them as whole bytes.")
    order = (said.value("BYTEORDER") or "LOWBYTEFIRST").upper()
    if order not in ("LOWBYTEFIRST", "HIGHBYTEFIRST"):
        raise ScanError(f"{path} gives BYTEORDER as '{order}': it is LOWBYTEFIRST or HIGHBYTEFIRST.")
    sign = ">" if order == "HIGHBYTEFIRST" else "<"
    edge = said.length("voxelSize")
    return RawLayout(
        data,
        str(path),
        (z, y, x),
        np.dtype(sign + _TYPES[kind]) if kind else None,
        spacing=(edge, edge, edge) if edge else None,
        metadata=said.as_metadata(),
    )
