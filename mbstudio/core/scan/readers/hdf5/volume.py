"""The scan in an HDF5 file: ilastik's exports, NeXus and plain files; an array is named behind a colon."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError, SeveralArraysError, UnitError
from mbstudio.core.scan.readers.family import (
    Family,
    Reading,
    ReadOptions,
    require_grey_volume,
    require_memory,
)
from mbstudio.core.scan.readers.hdf5.served_file import Part, ServedFile
from mbstudio.core.scan.readers.pixels import PixelMeaning, decode, plain_numbers
from mbstudio.core.scan.readers.size_attributes import (
    StatedSpacing,
    attribute_text,
    spacing_of_attributes,
)
from mbstudio.core.scan.readers.tiff_lengths import length_unit
from mbstudio.core.scan.scan import VoxelArray
from mbstudio.core.scan.slice_stack import Block, SliceStack
from mbstudio.core.units import METRES_PER_UNIT, names_no_length

SUFFIXES = (".h5", ".hdf5", ".hdf", ".nxs", ".nx5", ".he5")
# A packed volume up to this size is unpacked at once; a larger one slice by slice on demand.
UNPACK_AT_ONCE_BYTES = 2 << 30
# Where ilastik, and the Data Exchange format, put the one array that is meant.
_USUAL = ("exported_data", "exchange/data")
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_MOST_PLACES, _FARTHEST = 10_000_000, 1e100


def read(path: Path, options: ReadOptions) -> Reading:
    """Read one array of an HDF5 file.

    It is the one that the caller names, or the only volume in the file, or the one that NeXus
    calls the default, or ilastik's ``exported_data``. Axes are put in the order z, y, x by ilastik's
    ``axistags``, and axes of length one are dropped.

    Raises
    ------
    ScanError
        If the file is damaged, or several arrays could be meant.
    """
    if not _begins_as_hdf5(path):
        raise ScanError(f"{path} is not an HDF5 file, or is cut off: copy or export it again.")
    file = ServedFile(path)
    try:
        reading = _reading(file, _choose(file, options.dataset, path), path, options)
    except BaseException:
        file.close()
        raise
    if not isinstance(reading.voxels, SliceStack):
        file.close()
    return reading


def _begins_as_hdf5(path: Path) -> bool:
    """Return whether the signature stands where HDF5 looks for it: at the start, or after a user block."""
    try:
        with path.open("rb") as stream:
            length, place = stream.seek(0, 2), 0
            while place + len(_SIGNATURE) <= length:
                stream.seek(place)
                if stream.read(len(_SIGNATURE)) == _SIGNATURE:
                    return True
                place = max(512, 2 * place)
    except OSError as error:
        raise ScanError(f"{path} cannot be read ({error}): copy it again.") from error
    return False


def _choose(file: ServedFile, name: str | None, path: Path) -> Part:
    """Return the array that is meant."""
    volumes = file.volumes()
    if name is not None:
        item = file.find(name)
        if item is not None and item.kind == "elsewhere":
            raise ScanError(f"{path} contains '{name}' in another file, {item.file}: open that file itself.")
        if item is not None and item.kind == "array":
            return item
        inside = [key for key in volumes if key.startswith(name.strip("/") + "/")]
        if len(inside) == 1:
            return _array(file, inside[0], path)
        raise ScanError(f"{path} contains no array '{name}'{_list_volumes(volumes)}.")
    if not volumes:
        raise ScanError(f"{path} contains no array with three axes (z, y, x): a scan needs one.")
    if len(volumes) == 1:
        return _array(file, next(iter(volumes)), path)
    default = _default_of_nexus(file)
    if default is not None and default.name.strip("/") in volumes:
        return default
    usual = [key for key in _USUAL if key in volumes]
    if len(usual) == 1:
        return _array(file, usual[0], path)
    raise SeveralArraysError(
        f"{path} holds {len(volumes)} arrays that could be the scan{_list_volumes(volumes)}. "
        f"Name the right one after a colon, as in '{path.name}:/{next(iter(volumes))}'.",
        path,
        [f"/{key}" for key in volumes],
    )


def _array(file: ServedFile, name: str, path: Path) -> Part:
    found = file.find(name)
    if found is None or found.kind != "array":
        raise ScanError(f"{path} contains no array '{name}': it is damaged; copy or export it again.")
    return found


def _list_volumes(volumes: Mapping[str, tuple[int, ...]]) -> str:
    names = [f"/{key} ({' x '.join(map(str, shape))})" for key, shape in volumes.items()]
    return ": " + ", ".join(names[:8]) + (", ..." if len(names) > 8 else "") if names else ""


def _default_of_nexus(file: ServedFile) -> Part | None:
    """Follow NeXus' ``default`` attributes to the signal of the default plot."""
    group = file.find("/")
    for _ in range(8):
        if group is None or group.kind != "group":
            return None
        signal = group.attributes.get("signal")
        if signal is not None:
            item = file.find(f"{group.name.rstrip('/')}/{attribute_text(signal)}")
            if item is not None:
                return item if item.kind == "array" else None
        name = group.attributes.get("default")
        if name is None:
            return None
        group = file.find(f"{group.name.rstrip('/')}/{attribute_text(name)}")
    return None


def _reading(file: ServedFile, array: Part, path: Path, options: ReadOptions) -> Reading:
    name = f"{path}:{array.name}"
    if array.stored is None:
        raise ScanError(f"{name} lies in other files that this one names: copy it into one file.")
    order, samples = _order_of_axes(array, name)
    shape = tuple(_shape(array)[axis] for axis in order)
    require_grey_volume(shape, array.dtype, Path(name))
    voxels = _voxels(file, array, order, samples, path, options)
    spacing, unit, unit_word = _spacing(file, array, order)
    metadata = {
        key: attribute_text(value) if not isinstance(value, np.ndarray) else value.tolist()
        for key, value in array.attributes.items()
    }
    return Reading(voxels, spacing, unit, unit_word, metadata={**metadata, "dataset": array.name})


def _shape(array: Part) -> tuple[int, ...]:
    return array.shape or ()


def _order_of_axes(array: Part, name: str) -> tuple[tuple[int, int, int], int | None]:
    """Return which axes are z, y and x, and which holds the samples of a pixel, if any does."""
    keys = _axis_keys(array)
    shape = _shape(array)
    if keys is not None and len(keys) == len(shape):
        places = {key: axis for axis, key in enumerate(keys)}
        beside = [axis for axis, key in enumerate(keys) if key not in "zyx" and shape[axis] > 1]
        if beside:
            kinds = ", ".join(f"{keys[axis]}={shape[axis]}" for axis in beside)
            raise ScanError(
                f"{name} contains more than one volume ({kinds}), such as probabilities of classes: "
                "export one channel and one time step, or the segmentation, as its own file."
            )
        if all(key in places for key in "zyx"):
            return (places["z"], places["y"], places["x"]), None
        # A class or time axis may carry the slices where there is no z.
    long = [axis for axis, count in enumerate(shape) if count > 1]
    if len(long) == 3:
        return (long[0], long[1], long[2]), None
    if len(shape) == 4 and shape[-1] in (3, 4):
        return (0, 1, 2), 3
    raise ScanError(
        f"{name} has {len(shape)} axes (shape {shape}), but a scan has three (z, y, x): "
        "save one channel and one time step as its own file."
    )


def _axis_keys(array: Part) -> list[str] | None:
    """Return ilastik's names of the axes."""
    tags = array.attributes.get("axistags")
    if tags is None:
        return None
    try:
        return [str(axis["key"]).lower() for axis in json.loads(attribute_text(tags))["axes"]]
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def _voxels(
    file: ServedFile,
    array: Part,
    order: tuple[int, int, int],
    samples: int | None,
    path: Path,
    options: ReadOptions,
) -> VoxelArray:
    """Return the voxels mapped, unpacked or lazy, in the order z, y, x."""
    name, stored_shape, kind = f"{path}:{array.name}", _shape(array), array.dtype
    shape = tuple(stored_shape[axis] for axis in order)
    count = math.prod(stored_shape)
    in_order = list(order) == sorted(order)
    if array.offset is not None and in_order and samples is None and not array.is_named:
        if array.offset + count * kind.itemsize > path.stat().st_size:
            raise ScanError(f"{name} is cut off: copy or export it again.")
        return plain_numbers(np.memmap(path, kind, "r", array.offset, shape))  # type: ignore[no-any-return]
    if count and not array.stored:
        raise ScanError(f"{name} was created but never filled with voxels: export it again.")
    whole = tuple(slice(0, length) for length in stored_shape)
    if samples is not None:
        require_memory(stored_shape, kind.itemsize, Path(name))
        image = file.read(array, whole)
        return decode(image, PixelMeaning(samples=stored_shape[-1]), name, numbers=options.numbers)
    rest = [axis for axis in range(len(stored_shape)) if axis not in order]
    if count * kind.itemsize <= UNPACK_AT_ONCE_BYTES and not options.in_part:
        volume = file.read(array, whole).transpose([*order, *rest]).reshape(shape)
        return plain_numbers(np.ascontiguousarray(volume))  # type: ignore[no-any-return]

    def read_block(block: Block) -> np.ndarray:
        parts = dict(zip(order, block, strict=True))
        stored = file.read(array, tuple(parts.get(axis, slice(0, 1)) for axis in range(len(stored_shape))))
        lengths = [stored.shape[axis] for axis in order]
        return np.ascontiguousarray(plain_numbers(stored.transpose([*order, *rest]).reshape(lengths)))

    first = read_block((slice(0, 1), slice(0, 1), slice(0, 1)))
    return SliceStack.of_blocks(read_block, (shape[0], shape[1], shape[2]), first.dtype)


def _spacing(file: ServedFile, array: Part, order: tuple[int, int, int]) -> StatedSpacing:
    """Return edges z, y, x, unit and odd unit's word by the attributes that programs write."""
    stated = spacing_of_attributes(array.attributes)
    return stated if stated[0] is not None else _spacing_of_nexus(file, array, order)


def _spacing_of_nexus(file: ServedFile, array: Part, order: tuple[int, int, int]) -> StatedSpacing:
    """Return the spacing of the places that NeXus gives along each axis."""
    group = file.find(array.parent)
    names = None if group is None else group.attributes.get("axes")
    if names is None or np.size(names) != len(_shape(array)):
        return None, None, None
    edges, unit = [], "um"
    for axis in order:
        places = file.find(f"{array.parent.rstrip('/')}/{attribute_text(np.ravel(names)[axis])}")
        length = _shape(array)[axis]
        if places is None or places.shape != (length,) or places.dtype.kind not in "iuf":
            return None, None, None
        if length > _MOST_PLACES or places.stored is None:
            return None, None, None
        values = np.asarray(file.read(places, (slice(0, length),)), dtype=float)
        if not (np.abs(values) < _FARTHEST).all():
            return None, None, None
        steps = np.abs(np.diff(values))
        word = attribute_text(places.attributes.get("units", places.attributes.get("unit", "")))
        if not steps.size or steps.min() <= 0 or np.ptp(steps) > 1e-3 * steps.max():
            return None, None, None
        if names_no_length(word):
            return None, None, None
        try:
            factor, name = length_unit(word)
        except UnitError:
            return None, None, word
        edges.append(float(steps.mean()) * factor * METRES_PER_UNIT[name] / METRES_PER_UNIT[unit])
    return (edges[0], edges[1], edges[2]), unit, None


FAMILY = Family("HDF5 or NeXus file", SUFFIXES, read, holds_several=True)
