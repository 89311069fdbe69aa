"""HDF5: ilastik's exports, NeXus and plain files; one of several arrays is named behind a colon."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError, SeveralArraysError, UnitError
from mbstudio.core.scan.readers.family import (
    Family,
    Reading,
    ReadOptions,
    require_grey_volume,
    require_memory,
)
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
    import h5py

    if not h5py.is_hdf5(path):
        raise ScanError(f"{path} is not an HDF5 file, or is cut off: copy or export it again.")
    try:
        with h5py.File(path, "r", locking=False) as file:
            dataset = _choose(file, options.dataset, path)
            return _reading(dataset, path, options)
    except (ScanError, MemoryError):
        raise
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise ScanError(
            f"{path} cannot be read as HDF5 ({error}): it is damaged or cut off; copy or export it again."
        ) from error


def _volumes(file: Any) -> dict[str, Any]:
    """Return the arrays of numbers that have three axes longer than one, by their names."""
    import h5py

    found: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "buif":
            return
        if sum(count > 1 for count in item.shape or ()) >= 3:
            found[name] = item

    file.visititems(visit)
    return found


def _choose(file: Any, name: str | None, path: Path) -> Any:
    """Return the array that is meant."""
    import h5py

    volumes = _volumes(file)
    if name is not None:
        link = file.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise ScanError(
                f"{path} contains '{name}' in another file, {link.filename}: open that file itself."
            )
        item = file.get(name)
        if isinstance(item, h5py.Dataset):
            return item
        inside = [key for key in volumes if key.startswith(name.strip("/") + "/")]
        if len(inside) == 1:
            return volumes[inside[0]]
        raise ScanError(f"{path} contains no array '{name}'{_list_volumes(volumes)}.")
    if not volumes:
        raise ScanError(f"{path} contains no array with three axes (z, y, x): a scan needs one.")
    if len(volumes) == 1:
        return next(iter(volumes.values()))
    default = _default_of_nexus(file)
    if default is not None and default.name.strip("/") in volumes:
        return default
    usual = [volumes[key] for key in _USUAL if key in volumes]
    if len(usual) == 1:
        return usual[0]
    raise SeveralArraysError(
        f"{path} holds {len(volumes)} arrays that could be the scan{_list_volumes(volumes)}. "
        f"Name the right one after a colon, as in '{path.name}:/{next(iter(volumes))}'.",
        path,
        [f"/{key}" for key in volumes],
    )


def _list_volumes(volumes: Mapping[str, Any]) -> str:
    names = [f"/{key} ({' x '.join(map(str, item.shape))})" for key, item in volumes.items()]
    return ": " + ", ".join(names[:8]) + (", ..." if len(names) > 8 else "") if names else ""


def _default_of_nexus(file: Any) -> Any | None:
    """Follow NeXus' ``default`` attributes to the signal of the default plot."""
    import h5py

    group = file
    for _ in range(8):
        signal = group.attrs.get("signal")
        if signal is not None and attribute_text(signal) in group:
            item = group.get(attribute_text(signal))
            return item if isinstance(item, h5py.Dataset) else None
        name = group.attrs.get("default")
        if name is None or not isinstance(group.get(attribute_text(name)), h5py.Group):
            return None
        group = group[attribute_text(name)]
    return None


def _reading(dataset: Any, path: Path, options: ReadOptions) -> Reading:
    name = f"{path}:{dataset.name}"
    if dataset.is_virtual or dataset.external:
        raise ScanError(f"{name} lies in other files that this one names: copy it into one file.")
    order, samples = _order_of_axes(dataset, name)
    shape = tuple(dataset.shape[axis] for axis in order)
    require_grey_volume(shape, dataset.dtype, Path(name))
    voxels = _voxels(dataset, order, samples, path, name, options)
    spacing, unit, unit_word = _spacing(dataset, order)
    metadata = {
        key: attribute_text(value) if not isinstance(value, np.ndarray) else value.tolist()
        for key, value in dataset.attrs.items()
        if not isinstance(value, type(None)) and _is_short(value)
    }
    return Reading(voxels, spacing, unit, unit_word, metadata={**metadata, "dataset": dataset.name})


def _is_short(value: Any) -> bool:
    return np.size(value) <= 64 and not hasattr(value, "id")


def _order_of_axes(dataset: Any, name: str) -> tuple[tuple[int, int, int], int | None]:
    """Return which axes are z, y and x, and which holds the samples of a pixel, if any does."""
    keys = _axis_keys(dataset)
    shape = dataset.shape
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


def _axis_keys(dataset: Any) -> list[str] | None:
    """Return ilastik's names of the axes."""
    tags = dataset.attrs.get("axistags")
    if tags is None:
        return None
    try:
        return [str(axis["key"]).lower() for axis in json.loads(attribute_text(tags))["axes"]]
    except (ValueError, KeyError, TypeError):
        return None


def _voxels(
    dataset: Any,
    order: tuple[int, int, int],
    samples: int | None,
    path: Path,
    name: str,
    options: ReadOptions,
) -> VoxelArray:
    """Return the voxels mapped, unpacked or lazy, in the order z, y, x."""
    offset = dataset.id.get_offset() if dataset.chunks is None and not dataset.compression else None
    shape = tuple(dataset.shape[axis] for axis in order)
    in_order = list(order) == sorted(order)
    is_enum = dataset.dtype.kind == "b" or bool(dataset.dtype.metadata)
    if offset is not None and in_order and samples is None and not is_enum:
        return plain_numbers(np.memmap(path, dataset.dtype, "r", offset, shape))  # type: ignore[no-any-return]
    count = math.prod(dataset.shape)
    stored = int(dataset.id.get_storage_size())
    if count and not stored:
        raise ScanError(f"{name} was created but never filled with voxels: export it again.")
    if samples is not None:
        require_memory(dataset.shape, dataset.dtype.itemsize, Path(name))
        return decode(dataset[()], PixelMeaning(samples=dataset.shape[-1]), name, numbers=options.numbers)
    if count * dataset.dtype.itemsize <= UNPACK_AT_ONCE_BYTES and not options.in_part:
        whole = dataset[()]
        rest = [axis for axis in range(whole.ndim) if axis not in order]
        volume = np.ascontiguousarray(whole.transpose([*order, *rest]).reshape(shape))
        return plain_numbers(volume)  # type: ignore[no-any-return]
    inside = dataset.name

    def read_block(block: Block) -> np.ndarray:
        import h5py

        parts = dict(zip(order, block, strict=True))
        with h5py.File(path, "r", locking=False) as again:
            stored = again[inside][tuple(parts.get(axis, 0) for axis in range(len(again[inside].shape)))]
        ranks = [sorted(order).index(axis) for axis in order]
        return np.ascontiguousarray(plain_numbers(stored.transpose(ranks)))

    first = read_block((slice(0, 1), slice(0, 1), slice(0, 1)))
    return SliceStack.of_blocks(read_block, (shape[0], shape[1], shape[2]), first.dtype)


def _spacing(dataset: Any, order: tuple[int, int, int]) -> StatedSpacing:
    """Return edges z, y, x, unit and odd unit's word by the attributes that programs write."""
    stated = spacing_of_attributes(dataset.attrs)
    return stated if stated[0] is not None else _spacing_of_nexus(dataset, order)


def _spacing_of_nexus(dataset: Any, order: tuple[int, int, int]) -> StatedSpacing:
    """Return the spacing of the places that NeXus gives along each axis."""
    group = dataset.parent
    names = group.attrs.get("axes")
    if names is None or np.size(names) != len(dataset.shape):
        return None, None, None
    edges, unit = [], "um"
    for axis in order:
        places = group.get(attribute_text(np.ravel(names)[axis]))
        if places is None or getattr(places, "ndim", 0) != 1 or places.shape[0] != dataset.shape[axis]:
            return None, None, None
        values = np.asarray(places[()], dtype=float)
        steps = np.abs(np.diff(values))
        word = attribute_text(places.attrs.get("units", places.attrs.get("unit", "")))
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
