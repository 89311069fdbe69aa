"""AmiraMesh volumes and label images of Amira and Avizo."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError, UnitError
from mbstudio.core.scan.grid import Grid
from mbstudio.core.scan.readers.amira.header import AmiraHeader, Field, begins_as_amira, read_header
from mbstudio.core.scan.readers.family import (
    Family,
    Reading,
    ReadOptions,
    require_grey_volume,
    require_memory,
)
from mbstudio.core.scan.readers.orientation import along_axes, impossible
from mbstudio.core.scan.readers.pixels import PixelMeaning, decode
from mbstudio.core.scan.readers.tiff_lengths import length_unit
from mbstudio.core.scan.readers.unpacking import unpacked, written_out
from mbstudio.core.scan.scan import VoxelArray
from mbstudio.core.units import names_no_length

_TYPES = {
    "byte": "u1", "ubyte": "u1", "uint8": "u1", "sbyte": "i1", "int8": "i1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4",
    "double": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
# A number written as text takes about so many bytes until it is one.
_BYTES_OF_A_WORD = 60
# Materials are a few; what is named more often is a grain each.
_FEW_MATERIALS = 12


def read(path: Path, options: ReadOptions) -> Reading:
    """Read the one field on a uniform lattice.

    The bounding box runs from the centre of the first voxel to that of the last, so that voxels are
    as far apart as its extent by one less than their number. Labels beside their probabilities are
    the labels.

    Raises
    ------
    ScanError
        If the file is damaged, cut off, no lattice of three uniform axes, or holds classes of
        material where numbers of grains are wanted.
    """
    header = read_header(path)
    field = _choose(header, path)
    _require_uniform(header, path)
    if options.numbers:
        _require_grains(header, path)
    dtype = _dtype(field, header.order, path)
    require_grey_volume(header.shape, dtype, path)
    if header.order == "a" and field.packing is not None:
        raise ScanError(f"{path} holds packed numbers ({field.packing}) in a file of text: export it again.")
    raw = _voxels(header, field, dtype, path)
    voxels: VoxelArray = decode(raw, PixelMeaning(samples=field.samples), path, numbers=options.numbers)
    metadata = {**header.parameters, "materials": ", ".join(header.materials)}
    return _placed(voxels, header, metadata, path)


def _choose(header: AmiraHeader, path: Path) -> Field:
    """Return the field that is meant."""
    fields = header.fields
    if not fields:
        raise ScanError(f"{path} declares no values for its voxels (Lattice {{ ... }} @1): export it again.")
    labels = [field for field in fields if field.name.lower() == "labels"]
    others = [field for field in fields if field.name.lower() not in ("labels", "probability", "weights")]
    if len(labels) == 1 and not others:
        return labels[0]
    if len(fields) > 1:
        names = ", ".join(f"{field.name} ({field.kind})" for field in fields[:8])
        raise ScanError(
            f"{path} holds {len(fields)} values for each voxel ({names}), and which of them is the scan "
            f"is not "
            "said: save the one that is meant as its own file."
        )
    return fields[0]


def _require_uniform(header: AmiraHeader, path: Path) -> None:
    kind = header.parameters.get("coordtype", '"uniform"').strip('"').lower()
    if kind != "uniform":
        raise ScanError(
            f"{path} has {kind} coordinates, in which voxels are not all of one size: resample it to a "
            f"uniform "
            "lattice first."
        )


def _require_grains(header: AmiraHeader, path: Path) -> None:
    """Refuse labels that are classes: several materials whose names differ in more than a number."""
    names = header.materials[1:]
    stems = {re.sub(r"[\d_\-\s.#]+", "", name).lower() for name in names}
    if 1 < len(names) <= _FEW_MATERIALS and len(stems) > 1:
        raise ScanError(
            f"{path} holds classes of material ({', '.join(names)}) and no single grains: label the "
            f"grains of one "
            "material first (in Avizo: Labeling), or open the file as the scan itself, so that mbstudio "
            "finds "
            "the grains."
        )


def _dtype(field: Field, order: str, path: Path) -> np.dtype[Any]:
    if field.kind not in _TYPES or field.samples < 1:
        raise ScanError(
            f"{path} holds values of type {field.kind}: export grey values as whole or real numbers."
        )
    return np.dtype((">" if order == ">" else "<") + _TYPES[field.kind])


def _voxels(header: AmiraHeader, field: Field, dtype: np.dtype[Any], path: Path) -> np.ndarray:
    """Return the values mapped, or unpacked."""
    full = header.shape if field.samples == 1 else (*header.shape, field.samples)
    count, held = math.prod(full), path.stat().st_size
    start = _start(header, field, path)
    if header.order == "a":
        require_memory(full, _BYTES_OF_A_WORD, path, held)
        return _as_text(header, field, dtype, full, path)
    needed = count * dtype.itemsize
    length = needed if field.packing is None else field.length
    if length is None or start + length > held:
        stated = needed if length is None else length
        raise ScanError(
            f"{path} states {' x '.join(map(str, header.shape))} voxels (z, y, x) of {dtype.name} in "
            f"{stated:,} "
            f"bytes, but holds {max(held - start, 0):,}: it is cut off; copy or export it again."
        )
    if field.packing is None:
        return np.memmap(path, dtype, "r", start, full)
    require_memory(full, dtype.itemsize, path, None if field.packing.lower() == "hxbyterle" else length)
    packing = field.packing.lower()
    if packing == "hxzip":
        with path.open("rb") as stream:
            stream.seek(start)
            return unpacked(stream, "zlib", needed, path, length).view(dtype).reshape(full)
    if packing == "hxbyterle" and dtype.itemsize == 1:
        from mbstudio.core.scan.readers.amira.encodings import unrolled

        if needed > 128 * length:
            raise ScanError(
                f"{path} states more voxels than its {length:,} packed bytes can hold: it is damaged."
            )
        with path.open("rb") as stream:
            stream.seek(start)
            return unrolled(stream.read(length), needed, path).view(dtype).reshape(full)
    raise ScanError(
        f"{path} packs {dtype.name} in a way that is not read ({field.packing}): save it without compression."
    )


def _as_text(
    header: AmiraHeader, field: Field, dtype: np.dtype[Any], full: tuple[int, ...], path: Path
) -> np.ndarray:
    count = math.prod(full)
    with path.open("rb") as stream:
        stream.seek(header.data_start)
        content = stream.read()
    parts = re.split(rb"(?:^|\n)@\d+[^\n]*\n", content)
    if field.number > len(parts):
        raise ScanError(f"{path} ends before its values @{field.number}: it is cut off; copy it again.")
    return written_out(parts[field.number - 1], count, dtype, path).reshape(full)


def _start(header: AmiraHeader, field: Field, path: Path) -> int:
    """Return the byte at which a field's binary values begin: behind those of the fields before it."""
    start = header.data_start
    if field.number == 1 or header.order == "a":
        return start
    with path.open("rb") as stream:
        for number in range(1, field.number):
            before = next((other for other in header.fields if other.number == number), None)
            if before is None:
                raise ScanError(f"{path} declares no values @{number}: export the labels alone.")
            size = np.dtype(_TYPES.get(before.kind, "u1")).itemsize * before.samples * math.prod(header.shape)
            stream.seek(start + (size if before.packing is None else before.length or 0))
            line = stream.read(64)
            marker = re.match(rb"\s*@" + str(number + 1).encode() + rb"[^\n]*\n", line)
            if marker is None:
                raise ScanError(
                    f"{path} does not hold its values @{number + 1} where they should be: it is damaged."
                )
            start = stream.tell() - len(line) + marker.end()
    return start


def _placed(voxels: VoxelArray, header: AmiraHeader, metadata: dict[str, Any], path: Path) -> Reading:
    """Return the voxels with what the bounding box, the transformation and the units say."""
    box = header.numbers("boundingbox", 6)
    if box is None:
        return Reading(voxels, metadata=metadata)
    extent = box[1::2] - box[::2]
    gaps = np.array(header.shape[::-1]) - 1
    # A box says nothing of the size of a single voxel along an axis: it is that along another.
    known = [extent[axis] / gaps[axis] for axis in range(3) if gaps[axis]]
    spacing = np.array(
        [extent[axis] / gaps[axis] if gaps[axis] else (known or [0.0])[0] for axis in range(3)]
    )
    steps, origin = np.diag(spacing), box[::2]
    turn = header.numbers("transformationmatrix", 16)
    if turn is not None:
        matrix = turn.reshape(4, 4)
        steps, origin = steps @ matrix[:3, :3], origin @ matrix[:3, :3] + matrix[3, :3]
    wrong = impossible(steps)
    if wrong is not None or spacing.min() < 0:
        return Reading(voxels, metadata=metadata, doubt=wrong or "gives a bounding box that runs backwards")
    word = header.parameters.get("units/coordinates", "").strip('"')
    scale, unit, unit_word = 1.0, None, None
    if not names_no_length(word):
        try:
            scale, unit = length_unit(word)
        except UnitError:
            unit_word = word
    voxels, edges, corner, flipped = along_axes(voxels, steps * scale, origin * scale, path)
    grid = Grid(steps * scale, origin * scale, unit, flipped)
    return Reading(
        voxels, edges, unit, unit_word, corner, metadata, grid=None if grid.is_placeholder else grid
    )


FAMILY = Family("AmiraMesh volume", (".am", ".amiramesh"), read, recognises=begins_as_amira)
