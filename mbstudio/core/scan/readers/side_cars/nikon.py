"""Nikon (X-Tek): `.vol` voxels with the `.vgi` of VGStudio, or the `.xtekct` of CT Pro, beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions, is_there, require_beside
from mbstudio.core.scan.readers.side_cars.key_values import (
    KeyValues,
    read_key_values,
    real_number,
    whole_number,
)
from mbstudio.core.scan.readers.side_cars.layout import RawLayout, base_name, in_unit, open_layout
from mbstudio.core.scan.readers.tiff_lengths import Spacing

XTEK_SUFFIXES = (".xtekct", ".xtekvolume")
_XTEK_TYPES = {
    "float": "<f4", "uint16": "<u2", "ushort": "<u2", "16bit": "<u2", "uint8": "<u1", "8bit": "<u1",
}  # fmt: skip


def read(path: Path, options: ReadOptions) -> Reading:
    """Read the voxels that a ``.vgi`` or ``.xtekct`` file describes, beside it.

    Raises
    ------
    ScanError
        If the description is incomplete, or does not fit the voxels.
    """
    describe = describe_xtek if path.suffix.lower() in XTEK_SUFFIXES else describe_vgi
    return open_layout(describe(path, None), options)


def describe_vgi(path: Path, data: Path | None) -> RawLayout:
    """Return what a ``.vgi`` file says, about `data` or else about the file that it names.

    Its sizes and resolutions are in the order x, y, z. Without a unit it means millimetres, as
    Nikon and GE write it.

    Raises
    ------
    ScanError
        If it says too little, or describes several volumes or a volume in several files.
    """
    said = read_key_values(path)
    files = list(dict.fromkeys(where for where, _, _ in said.entries if _is_file(where)))
    if len(files) > 1:
        raise ScanError(
            f"{path} describes {len(files)} files of voxels: save the one volume that is meant on its own."
        )
    # What a file holds stands in [file1]; [representation] says the same of the volume.
    where = files[0] if files else "representation"
    texts = (*said.values("size", "representation"), *said.values("size", where))
    sizes = {said.counts(text.split(), "size") for text in texts}
    if len(sizes) > 1:
        one, other = sorted(sizes)[:2]
        raise ScanError(
            f"{path} gives its size as {_times(one)} and as {_times(other)} (x, y, z), as of a volume of "
            f"which "
            "a part is shown: save that part on its own, or state shape and dtype."
        )
    if not sizes or len(next(iter(sizes))) != 3:
        raise ScanError(f"{path} does not say how many voxels there are along x, y and z (size).")
    x, y, z = next(iter(sizes))
    name = said.value("name", where)
    notes: tuple[str, ...] = ()
    if data is None:
        data, notes = _named(path, name)
    mirrors = (said.value("mirror") or "").split()
    if any(whole_number(word) not in (0, None) for word in mirrors):
        notes += (
            f"has a description ({path.name}) that asks for mirrored axes (mirror = {' '.join(mirrors)}, "
            "x, y, z), which was not done: left and right may be exchanged.",
        )
    spacing, unit, word = _resolution(said)
    return RawLayout(
        data,
        str(path),
        (z, y, x),
        _vgi_type(said, where),
        said.skipped_bytes("skipheader", where),
        spacing,
        unit,
        word,
        metadata=said.as_metadata(),
        notes=notes,
    )


def _is_file(section: str) -> bool:
    last = section.rpartition("/")[2]
    return last.startswith("file") and last[4:].isdigit()


def _times(counts: tuple[int, ...]) -> str:
    return " x ".join(map(str, counts))


def _named(path: Path, name: str | None) -> tuple[Path, tuple[str, ...]]:
    """Return the file of voxels beside a description, and a note where its name is another."""
    own = [other for ending in (".vol", ".VOL", ".raw") if (other := path.with_suffix(ending)).exists()]
    plain = base_name(name or "")
    if plain in (".", ".."):
        plain = ""
    if plain and is_there(path.parent / plain):
        return require_beside(path, path.parent / plain), ()
    if own:
        told = f"names its voxels '{name}', which are not there: {own[0].name} was taken." if plain else ""
        return require_beside(path, own[0]), (told,) if told else ()
    wanted = plain or path.with_suffix(".vol").name
    raise ScanError(f"{path} describes the voxels in {wanted}, which is missing: put it beside.")


def _vgi_type(said: KeyValues, where: str) -> np.dtype[Any] | None:
    volume = "representation"
    bits = whole_number(said.value("bitsperelement", where) or said.value("bitsperelement", volume) or "")
    kind = (said.value("datatype", where) or said.value("datatype", volume) or "").lower()
    if bits is None and not kind:
        return None
    if "float" in kind or "double" in kind or "real" in kind:
        letter, bits = "f", bits or (64 if "double" in kind else 32)
    elif "unsigned" in kind or (not kind and bits in (8, 16)):
        letter = "u"
    elif "int" in kind or "signed" in kind:
        letter = "i"
    else:
        letter = ""
    if not letter or bits is None or bits not in ((32, 64) if letter == "f" else (8, 16, 32, 64)):
        raise ScanError(
            f"{said.path} gives voxels of '{kind or 'no type'}' with {bits} bits, which are not read: "
            "export 8 or 16 bits or float, or state shape and dtype."
        )
    order = (said.value("byteorder", where) or said.value("endian", where) or "").lower()
    sign = ">" if "big" in order or "msb" in order or "high" in order else "<"
    return np.dtype(f"{sign}{letter}{bits // 8}")


def _resolution(said: KeyValues) -> tuple[Spacing | None, str | None, str | None]:
    text = said.value("resolution", "geometry") or said.value("resolution") or said.value("samplingdistance")
    if text is None:
        return None, None, None
    edges = [real_number(word) for word in text.split()]
    if len(edges) != 3 or any(edge is None or edge < 0 for edge in edges):
        raise ScanError(f"{said.path} gives resolution as '{text}', which is not three lengths: correct it.")
    x, y, z = (edge or 0.0 for edge in edges)
    if min(x, y, z) == 0:
        return None, None, None
    return in_unit((z, y, x), said.value("unit", "geometry") or said.value("unit") or "mm")


def describe_xtek(path: Path, data: Path | None) -> RawLayout:
    """Return what CT Pro's ``.xtekct`` says about the volume that it reconstructed, in mm.

    Raises
    ------
    ScanError
        If it does not say how many voxels there are, or the volume is not beside it.
    """
    said = read_key_values(path)
    if "xtekct" not in {where for where, _, _ in said.entries}:
        raise ScanError(f"{path} is not a description of a reconstruction by CT Pro ([XTekCT] is missing).")
    x, y, z = (said.count(f"Voxels{axis}", "xtekct") for axis in "XYZ")
    notes: tuple[str, ...] = ()
    if data is None:
        name = said.value("name", "xtekct")
        data, notes = _named(path, f"{name}.vol" if name and not name.lower().endswith(".vol") else name)
    edges = [said.length(f"VoxelSize{axis}", "xtekct") for axis in "ZYX"]
    spacing, unit, word = None, None, None
    if edges[0] and edges[1] and edges[2]:
        spacing, unit, word = in_unit((edges[0], edges[1], edges[2]), said.value("units", "xtekct") or "mm")
    kind = (said.value("scaling_datatypevolume") or "").lower().replace(" ", "").replace("-", "")
    code = next((code for name, code in _XTEK_TYPES.items() if kind.startswith(name)), None)
    return RawLayout(
        data,
        str(path),
        (z, y, x),
        np.dtype(code) if code else None,
        spacing=spacing,
        unit=unit,
        unit_word=word,
        metadata=said.as_metadata(),
        notes=notes,
    )


FAMILY = Family("Nikon volume", (".vgi", *XTEK_SUFFIXES), read)
