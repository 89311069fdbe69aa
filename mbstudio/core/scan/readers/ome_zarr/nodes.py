"""Groups and arrays of a Zarr tree, as their documents describe them."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.ome_zarr.store import ZarrFiles, checked_key, document
from mbstudio.core.scan.readers.text import one_line

_MOST_NODES, _DEEPEST = 5000, 24


@dataclass(frozen=True, eq=False)
class Node:
    """A group or an array.

    Attributes
    ----------
    key : str
        Its path in the tree; empty for the root.
    format : int
        2 or 3.
    is_array : bool
    attributes : mapping
    shape : tuple of int
        Of an array.
    axes : tuple of str or None
        Names of an array's axes, where it gives them.
    content : dict
        An array's own document.
    """

    key: str
    format: int
    is_array: bool
    attributes: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    shape: tuple[int, ...] = ()
    axes: tuple[str, ...] | None = None
    content: dict[str, Any] = field(default_factory=dict)

    @property
    def counts(self) -> str:
        return " x ".join(map(str, self.shape))

    @property
    def is_volume(self) -> bool:
        """Whether it is an array that has three axes longer than one."""
        return self.is_array and sum(count > 1 for count in self.shape) >= 3


def joined_key(*parts: str) -> str:
    """Return a path of parts, of which some may be empty."""
    return "/".join(part for part in parts if part)


def node_at(files: ZarrFiles, key: str) -> Node | None:
    """Return the group or array of a path, None if there is none.

    Raises
    ------
    ScanError
        If its document cannot be understood, or the path leads out of the folder.
    """
    key = checked_key(key, files)
    content = _json(files, joined_key(key, "zarr.json"))
    if content is not None:
        attributes = content.get("attributes")
        return _node(files, key, 3, content.get("node_type") == "array", content, attributes)
    attributes = _json(files, joined_key(key, ".zattrs"))
    content = _json(files, joined_key(key, ".zarray"))
    if content is not None:
        return _node(files, key, 2, True, content, attributes)
    if attributes is not None or _json(files, joined_key(key, ".zgroup")) is not None:
        return _node(files, key, 2, False, {}, attributes)
    return None


def _node(
    files: ZarrFiles, key: str, number: int, is_array: bool, content: dict[str, Any], attributes: Any
) -> Node:
    facts = attributes if isinstance(attributes, dict) else {}
    if not is_array:
        return Node(key, number, False, MappingProxyType(facts))
    shape = content.get("shape")
    if not isinstance(shape, list) or not all(type(count) is int and count >= 0 for count in shape):
        raise ScanError(
            f"{named(files, key)} does not say how many voxels it holds (shape = {str(shape)[:40]}): "
            "export it again."
        )
    names = content.get("dimension_names") if number == 3 else facts.get("_ARRAY_DIMENSIONS")
    axes = None
    if isinstance(names, list) and len(names) == len(shape) and all(isinstance(name, str) for name in names):
        axes = tuple(name.lower() for name in names)
    return Node(key, number, True, MappingProxyType(facts), tuple(shape), axes, content)


def _json(files: ZarrFiles, key: str) -> dict[str, Any] | None:
    """Return what a document says, None if it is not there."""
    text = document(files, key)
    if text is None:
        return None
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ScanError(
            f"{files.path} cannot be read as Zarr ({key}: {error}): it is damaged or cut off; copy "
            "or export it again."
        ) from error
    if not isinstance(content, dict):
        raise ScanError(f"{files.path} holds no description of an array or group in {key}: export it again.")
    return content


def walk(files: ZarrFiles, key: str = "", depth: int = 0) -> Iterator[Node]:
    """Yield a node and all below it, without looking into the chunks of arrays."""
    pending, seen = [(key, depth)], 0
    while pending:
        place, level = pending.pop()
        node = node_at(files, place)
        if node is not None:
            yield node
        seen += 1
        if seen > _MOST_NODES:
            raise ScanError(
                f"{files.path} holds more than {_MOST_NODES:,} groups: name the array that is meant "
                "behind a colon."
            )
        if level < _DEEPEST and (node is None or not node.is_array):
            inside = [joined_key(place, name) for name in files.children(place)]
            pending += [(child, level + 1) for child in reversed(inside)]


def named(files: ZarrFiles, key: str) -> str:
    """Return what to call an array in messages."""
    return f"{files.path}:{key}" if key else str(files.path)


def metadata_of(node: Node, files: ZarrFiles) -> tuple[Any, np.dtype[Any], tuple[int, ...]]:
    """Return zarr's own metadata of an array, its type, and the shape of what lies in one file.

    zarr is given the document alone, so that it opens no file.

    Raises
    ------
    ScanError
        If zarr does not understand it.
    """
    import zarr
    from zarr.storage import MemoryStore, StorePath

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # Made of its description alone: no file is looked for, and no thread of zarr's begins.
            array: Any = zarr.AsyncArray.from_dict(StorePath(MemoryStore()), dict(node.content))
            dtype, chunks = np.dtype(array.dtype), tuple(array.shards or array.chunks)
    except MemoryError:
        raise
    except Exception as error:  # zarr raises errors of many unrelated types
        raise ScanError(
            f"{named(files, node.key)} is described in a way that zarr does not understand "
            f"({type(error).__name__}: {one_line(error)}): export it again."
        ) from error
    if len(chunks) != len(node.shape) or min(chunks, default=1) < 1 or math.prod(chunks) > 2**40:
        raise ScanError(f"{named(files, node.key)} has chunks of impossible shape {chunks}: export it again.")
    return array.metadata, dtype, chunks
