"""OME-Zarr (NGFF 0.4 and 0.5) and plain Zarr arrays: the one that is meant, and how it lies in space."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError, SeveralArraysError
from mbstudio.core.scan.grid import Grid
from mbstudio.core.scan.readers.family import (
    Family,
    Reading,
    ReadOptions,
    require_grey_volume,
    require_memory,
)
from mbstudio.core.scan.readers.ome_zarr.chunks import MOST_COMPRESSION, ZarrArray
from mbstudio.core.scan.readers.ome_zarr.multiscale import Axis, Level, finest, level_of, multiscales_of
from mbstudio.core.scan.readers.ome_zarr.nodes import Node, joined_key, named, node_at, walk
from mbstudio.core.scan.readers.ome_zarr.store import DOCUMENTS, ZarrFiles, open_files
from mbstudio.core.scan.readers.orientation import along_axes, impossible
from mbstudio.core.scan.readers.pixels import PixelMeaning, decode, plain_numbers
from mbstudio.core.scan.readers.size_attributes import spacing_of_attributes
from mbstudio.core.scan.readers.tiff_lengths import shared_unit
from mbstudio.core.scan.scan import VoxelArray
from mbstudio.core.scan.slice_stack import Block, SliceStack

FOLDER_SUFFIX = ".zarr"
SUFFIXES = (FOLDER_SUFFIX, ".zarr.zip", ".ozx")
# A volume up to this size is unpacked at once; a larger one chunk by chunk on demand.
UNPACK_AT_ONCE_BYTES = 2 << 30
_LARGEST_SLAB = 1 << 30
# So many channels and times are named one by one.
_MOST_NAMES = 200
_INDEX = re.compile(r"([A-Za-z]\w*)=(\d+)")


def read(path: Path, options: ReadOptions) -> Reading:
    """Read one array of a Zarr folder or archive.

    It is the one that the caller names, or the finest one of the only image, or the only volume.
    Of axes beside z, y and x the caller names the place, as in ``c=1``, unless they have only one.

    Raises
    ------
    ScanError
        If the files are damaged, or several arrays could be meant.
    """
    files = open_files(path.parent if path.is_file() and path.name in DOCUMENTS else path)
    name, places = _asked(options.dataset)
    level, notes = _choose(files, name, options.numbers)
    array = ZarrArray(files, level.node)
    order, fixed, samples = _order_of_axes(level, places, array, path)
    shape = tuple(array.shape[axis] for axis in order)
    require_grey_volume(shape, array.dtype, Path(array.name))
    _require_filled(array)
    if array.missing and not options.numbers:  # most of a label image is empty, and left out
        notes.append(
            f"lacks {array.missing:,} of {array.files:,} chunks, where Zarr means {array.filler}: if the "
            "image is not empty there, it was not copied as a whole."
        )
    voxels = _voxels(array, order, fixed, samples, options)
    metadata = {
        "array": level.node.key,
        "format": level.node.format,
        "axes": " ".join(axis.name for axis in level.axes),
    }
    return _placed(voxels, level, order, path, Reading(voxels, metadata=metadata, notes=tuple(notes)))


def recognises(path: Path) -> bool:
    """Return whether a folder is a Zarr tree, or a file one of its documents."""
    if path.is_dir():
        return path.suffix.lower() == FOLDER_SUFFIX or any((path / name).is_file() for name in DOCUMENTS)
    return path.name in DOCUMENTS


# Which array ------------------------------------------------------------------------------------------


def _asked(dataset: str | None) -> tuple[str | None, dict[str, int]]:
    """Part ``labels/grains,c=1`` into the name of an array and places along its axes."""
    if dataset is None:
        return None, {}
    places, names = {}, []
    for part in dataset.split(","):
        found = _INDEX.fullmatch(part.strip())
        if found:
            places[found[1].lower()] = int(found[2])
        else:
            names.append(part)
    name = ",".join(names).strip("/")
    return name or None, places


def _choose(files: ZarrFiles, name: str | None, numbers: bool) -> tuple[Level, list[str]]:
    """Return the array that is meant, and what was taken for granted."""
    node = node_at(files, name or "")
    if node is not None and node.is_array:
        return level_of(files, node) or _plain(node), []
    if name is not None and node is None:
        raise ScanError(f"{files.path} holds no array '{name}'{_listed(files, _candidates(files, ''))}.")
    below = _candidates(files, node.key if node is not None else "")
    if not below:
        raise ScanError(
            f"{named(files, name or '')} holds no array of three axes (z, y, x): a scan needs one. "
            "If it should, copy or export it again."
        )
    labels = {key: found for key, found in below.items() if _is_label(key, node)}
    images = {key: found for key, found in below.items() if key not in labels}
    if numbers and labels:
        chosen = _only(files, labels)
        level, notes = _level(files, chosen)
        if images:
            notes.append(f"is an image with labels: the labels {chosen.key} were taken.")
        return level, notes
    if node is not None and node.key in below:
        return _level(files, node)
    return _level(files, _only(files, images or labels))


def _is_label(key: str, top: Node | None) -> bool:
    inside = key.removeprefix(top.key) if top is not None else key
    return "labels" in inside.split("/")[:-1]


def _candidates(files: ZarrFiles, key: str) -> dict[str, Node]:
    """Return images, and volumes that belong to none, by their names."""
    found: dict[str, Node] = {}
    arrays: set[str] = set()
    for node in walk(files, key):
        if not node.is_array and multiscales_of(node):
            found[node.key] = node
            for image in multiscales_of(node):
                datasets = image.get("datasets")
                paths = [one.get("path") for one in datasets if isinstance(one, dict)] if isinstance(
                    datasets, list
                ) else []  # fmt: skip
                arrays |= {joined_key(node.key, str(path).strip("/")) for path in paths}
        elif node.is_volume and node.key not in arrays:
            found[node.key] = node
    return found


def _only(files: ZarrFiles, nodes: Mapping[str, Node]) -> Node:
    if len(nodes) == 1:
        return next(iter(nodes.values()))
    raise SeveralArraysError(
        f"{files.path} holds {len(nodes)} arrays that could be meant{_listed(files, nodes)}. "
        f"Name the right one after a colon, as in '{files.path.name}:{next(iter(nodes))}'.",
        files.path,
        list(nodes),
    )


def _listed(files: ZarrFiles, nodes: Mapping[str, Node]) -> str:
    names = []
    for key, node in list(nodes.items())[:8]:
        counts = node.counts if node.is_array else finest(files, node).node.counts
        names.append(f"{key or '/'} ({counts})")
    return ": " + ", ".join(names) + (", ..." if len(nodes) > 8 else "") if names else ""


def _level(files: ZarrFiles, node: Node) -> tuple[Level, list[str]]:
    """Return the array of an image, or the array itself, and what was taken for granted."""
    if node.is_array:
        return level_of(files, node) or _plain(node), []
    level = finest(files, node)
    notes = []
    if level.levels > 1:
        inside = level.node.key.removeprefix(node.key).strip("/")
        notes.append(
            f"holds {level.levels} sizes of the image; the finest, {inside} ({level.node.counts}), was taken."
        )
    return level, notes


def _plain(node: Node) -> Level:
    """Return an array that belongs to no image."""
    return Level(node, tuple(Axis(name, is_space=name in ("z", "y", "x")) for name in node.axes or ()))


# Its axes and voxels ----------------------------------------------------------------------------------


def _order_of_axes(
    level: Level, places: Mapping[str, int], array: ZarrArray, path: Path
) -> tuple[tuple[int, int, int], dict[int, int], int | None]:
    """Return which axes are z, y, x, the place along each other one, and the axis of samples of a pixel."""
    shape, names = array.shape, [axis.name for axis in level.axes]
    unknown = [name for name in places if name not in names or name in ("z", "y", "x")]
    if unknown:
        raise ScanError(
            f"{array.name} has no axis '{unknown[0]}' to choose from: its axes are "
            f"{', '.join(names) if names else 'not named'}."
        )
    fixed = {}
    for name, place in places.items():
        axis = names.index(name)
        if place >= shape[axis]:
            raise ScanError(
                f"{array.name} has no {name}={place}: its axis {name} has places 0 to {shape[axis] - 1}."
            )
        fixed[axis] = place
    if all(name in names for name in "zyx"):
        order = [names.index(name) for name in "zyx"]
    elif sum(axis.is_space for axis in level.axes) == 3:
        order = [place for place, axis in enumerate(level.axes) if axis.is_space]
    else:
        order = [axis for axis, count in enumerate(shape) if count > 1 and axis not in fixed]
        if len(order) == 4 and shape[-1] in (3, 4) and not names:
            return (order[0], order[1], order[2]), {}, 3
        if len(order) != 3 and len(shape) - len(fixed) == 3:
            order = [axis for axis in range(len(shape)) if axis not in fixed]
    beside = [
        axis for axis, count in enumerate(shape) if axis not in order and axis not in fixed and count > 1
    ]
    if beside and names:
        raise _several_volumes(level, places, beside, path)
    if len(order) != 3:
        raise ScanError(
            f"{array.name} has {len(shape)} axes (shape {shape}), but a scan has three (z, y, x): "
            "save one channel and one time step as its own array."
        )
    for axis in range(len(shape)):
        if axis not in order:
            fixed.setdefault(axis, 0)
    return (order[0], order[1], order[2]), fixed, None


def _several_volumes(
    level: Level, places: Mapping[str, int], beside: Sequence[int], path: Path
) -> SeveralArraysError:
    """Return the refusal of an array of several channels or times, with what names each."""
    key, shape = level.node.key, level.node.shape
    kinds = ", ".join(f"{level.axes[axis].name}={shape[axis]}" for axis in beside)
    chosen = [key] if key else []
    chosen += [f"{name}={place}" for name, place in places.items()]
    cells = itertools.islice(itertools.product(*(range(shape[axis]) for axis in beside)), _MOST_NAMES)
    names = [
        ",".join([*chosen, *(f"{level.axes[axis].name}={at}" for axis, at in zip(beside, cell, strict=True))])
        for cell in cells
    ]
    return SeveralArraysError(
        f"{path}{f':{key}' if key else ''} holds more than one volume ({kinds}): name the one that "
        "is meant behind "
        f"a colon, as in '{path.name}:{names[0]}'.",
        path,
        names,
    )


def _require_filled(array: ZarrArray) -> None:
    """Raise ScanError if an array claims more than its files can hold."""
    needed = math.prod(array.shape) * array.dtype.itemsize
    if needed and not array.stored:
        raise ScanError(f"{array.name} was created but never filled with voxels: export it again.")
    if needed > MOST_COMPRESSION * array.stored + 2**20:
        raise ScanError(
            f"{array.name} states {' x '.join(map(str, array.shape))} voxels, {needed:,} bytes, but holds "
            f"{array.stored:,}: its description is wrong or its data is cut off; copy or export it again."
        )


def _voxels(
    array: ZarrArray,
    order: tuple[int, int, int],
    fixed: Mapping[int, int],
    samples: int | None,
    options: ReadOptions,
) -> VoxelArray:
    """Return the voxels, unpacked or lazy, in the order z, y, x."""
    shape = tuple(array.shape[axis] for axis in order)
    meaning = PixelMeaning(samples=array.shape[samples] if samples is not None else 1)

    def read_block(part: Block) -> np.ndarray:
        start = [fixed.get(axis, 0) for axis in range(len(array.shape))]
        stop = [start[axis] + 1 if axis in fixed else count for axis, count in enumerate(array.shape)]
        for axis, ends in zip(order, part, strict=True):
            start[axis], stop[axis] = ends.start, ends.stop
        block = array.read(start, stop).transpose([*order, *(a for a in range(len(start)) if a not in order)])
        if samples is not None:
            return np.ascontiguousarray(decode(block, meaning, array.name, numbers=options.numbers))
        block = block.reshape([ends.stop - ends.start for ends in part])
        return np.asarray(plain_numbers(np.ascontiguousarray(block)))

    def read_slices(first: int, last: int) -> np.ndarray:
        return read_block((slice(first, last), slice(0, shape[1]), slice(0, shape[2])))

    slice_bytes = shape[1] * shape[2] * array.dtype.itemsize
    is_small = shape[0] * slice_bytes <= UNPACK_AT_ONCE_BYTES
    if (is_small and not options.in_part) or samples is not None:
        require_memory(array.shape, array.dtype.itemsize, Path(array.name))
        return read_slices(0, shape[0])
    depth = array.chunks[order[0]]
    if depth * slice_bytes > _LARGEST_SLAB:
        depth = 1
    slabs: dict[int, np.ndarray] = {}
    lock = Lock()

    def read_slice(index: int) -> np.ndarray:
        with lock:  # of all slices of a chunk the chunk is unpacked once
            slab = index // depth
            if slab not in slabs:
                slabs.clear()
                slabs[slab] = read_slices(slab * depth, min((slab + 1) * depth, shape[0]))
            image: np.ndarray = slabs[slab][index - slab * depth]
            return image.copy()

    kind = plain_numbers(np.zeros(1, array.dtype)).dtype
    return SliceStack(read_slice, (shape[0], shape[1], shape[2]), kind, read_block=read_block)


# Its place in space -----------------------------------------------------------------------------------


def _placed(voxels: Any, level: Level, order: tuple[int, int, int], path: Path, bare: Reading) -> Reading:
    """Return what the image, or the array's own attributes, say of the size and place of the voxels."""
    if level.doubt is not None:
        return replace(bare, doubt=level.doubt)
    if level.scale is None or level.translation is None:
        spacing, unit, word = spacing_of_attributes(level.node.attributes)
        return replace(bare, spacing=spacing, unit=unit, unit_word=word)
    scale = np.array([level.scale[axis] for axis in reversed(order)])
    origin = np.array([level.translation[axis] for axis in reversed(order)])
    wrong = impossible(np.diag(scale))
    if wrong is not None:
        return replace(bare, doubt=wrong)
    factors, unit, word = shared_unit([level.axes[axis].unit for axis in reversed(order)])
    steps, origin = np.diag(scale * factors), origin * factors
    grid = Grid(steps, origin, unit)
    voxels, spacing, corner, flipped = along_axes(voxels, steps, origin, path)
    return replace(
        bare,
        voxels=voxels,
        spacing=spacing,
        unit=unit,
        unit_word=word,
        origin=corner,
        grid=None if grid.is_placeholder else replace(grid, flipped=flipped),
    )


FAMILY = Family(
    "OME-Zarr or Zarr", SUFFIXES, read, reads_folders=True, recognises=recognises, holds_several=True
)
