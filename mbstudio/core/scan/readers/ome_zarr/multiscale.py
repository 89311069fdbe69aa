"""NGFF: which array of a multiscale image is the finest, its axes, and where its voxels lie."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.ome_zarr.nodes import Node, joined_key, named, node_at
from mbstudio.core.scan.readers.ome_zarr.store import ZarrFiles

# Names of the axes of versions that do not give them.
_USUAL_AXES = ("t", "c", "z", "y", "x")


@dataclass(frozen=True)
class Axis:
    """An axis of a multiscale image: its name and unit, as the file has them."""

    name: str
    unit: str = ""
    is_space: bool = False


@dataclass(frozen=True, eq=False)
class Level:
    """One array of a multiscale image.

    Attributes
    ----------
    node : Node
    axes : tuple of Axis
    scale, translation : tuple of float or None
        Along each axis; None where the file gives none.
    doubt : str or None
        Why they are not believed; a sentence's end.
    levels : int
        Of how many sizes it is the finest.
    """

    node: Node
    axes: tuple[Axis, ...]
    scale: tuple[float, ...] | None = None
    translation: tuple[float, ...] | None = None
    doubt: str | None = None
    levels: int = 1


def multiscales_of(node: Node) -> list[Mapping[str, Any]]:
    """Return what a group says of multiscale images, whichever version of NGFF it is of."""
    ome = node.attributes.get("ome")
    facts = ome if isinstance(ome, dict) else node.attributes
    found = facts.get("multiscales")
    return [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []


def finest(files: ZarrFiles, group: Node) -> Level:
    """Return the finest array of the one multiscale image of a group.

    Raises
    ------
    ScanError
        If there are several images, an array is not there, or axes do not fit the array.
    """
    images = multiscales_of(group)
    if len(images) > 1:
        names = ", ".join(_paths(images[0])[:1] + _paths(images[1])[:1])
        raise ScanError(
            f"{named(files, group.key)} holds {len(images)} multiscale images: name the array that is meant "
            f"behind a colon, such as {names}."
        )
    levels: list[tuple[int, str, Node]] = []
    for path in _paths(images[0]):
        node = node_at(files, joined_key(group.key, path))
        if node is None or not node.is_array:
            if levels:
                continue  # a coarser one that was left behind
            raise ScanError(
                f"{named(files, group.key)} names its array '{path}', which is not there: copy all "
                "of the folder."
            )
        levels.append((math.prod(node.shape), path, node))
    if not levels:
        raise ScanError(f"{named(files, group.key)} is a multiscale image without arrays: export it again.")
    _, path, node = max(levels, key=lambda level: level[0])
    return _level(files, images[0], path, node, len(levels))


def level_of(files: ZarrFiles, node: Node) -> Level | None:
    """Return what the groups above an array say of it, None if it belongs to no multiscale image."""
    parts = node.key.split("/")
    for depth in range(len(parts) - 1, -1, -1):
        group = node_at(files, "/".join(parts[:depth]))
        path = "/".join(parts[depth:])
        for image in multiscales_of(group) if group is not None and not group.is_array else ():
            if path in _paths(image):
                return _level(files, image, path, node, 1)
    return None


def _paths(image: Mapping[str, Any]) -> list[str]:
    datasets = image.get("datasets")
    found = (
        [one.get("path") for one in datasets if isinstance(one, dict)] if isinstance(datasets, list) else []
    )
    return [path.strip("/") for path in found if isinstance(path, str) and path.strip("/")]


def _level(files: ZarrFiles, image: Mapping[str, Any], path: str, node: Node, levels: int) -> Level:
    axes = _axes(image, node, files)
    dataset = next(
        one for one in image["datasets"] if isinstance(one, dict) and str(one.get("path")).strip("/") == path
    )
    scale: np.ndarray | None = None
    translation = np.zeros(len(axes))
    for place in (dataset, image):
        transformations = place.get("coordinateTransformations")
        if transformations is None:
            continue
        found = _transformation(transformations, len(axes))
        if isinstance(found, str):
            return Level(node, axes, doubt=found, levels=levels)
        if found[0] is not None:
            scale = found[0] if scale is None else scale * found[0]
            translation = translation * found[0]
        translation = translation + found[1]
    numbers = None if scale is None else tuple(float(part) for part in scale)
    return Level(node, axes, numbers, tuple(float(part) for part in translation), levels=levels)


def _axes(image: Mapping[str, Any], node: Node, files: ZarrFiles) -> tuple[Axis, ...]:
    """Return the axes of an image, as any version of NGFF gives them."""
    given = image.get("axes")
    count = len(node.shape)
    if given is None and "coordinateSystems" in image:
        raise ScanError(
            f"{named(files, node.key)} is of a version of NGFF later than 0.5, which is not read: "
            "save it as version 0.4 or 0.5."
        )
    if given is None and count <= len(_USUAL_AXES):
        return tuple(Axis(name, is_space=name in "zyx") for name in _USUAL_AXES[-count:])
    axes = []
    for one in given if isinstance(given, list) else ():
        if isinstance(one, str):
            axes.append(Axis(one.lower(), is_space=one.lower() in ("z", "y", "x")))
        elif isinstance(one, dict) and isinstance(one.get("name"), str):
            unit = one.get("unit")
            axes.append(
                Axis(one["name"].lower(), unit if isinstance(unit, str) else "", one.get("type") == "space")
            )
    if len(axes) != count:
        raise ScanError(
            f"{named(files, node.key)} has {count} axes (shape {node.shape}), but its image names "
            f"{len(axes)}: "
            "export it again."
        )
    return tuple(axes)


def _transformation(given: Any, count: int) -> tuple[np.ndarray | None, np.ndarray] | str:
    """Return scale and translation, or why they cannot be told; a sentence's end."""
    scale: np.ndarray | None = None
    translation = np.zeros(count)
    for one in given if isinstance(given, list) else ():
        kind = one.get("type") if isinstance(one, dict) else None
        if kind == "identity":
            continue
        if kind not in ("scale", "translation"):
            return f"places its voxels by a transformation ({str(kind)[:40]}) that is not read here"
        numbers = _numbers(one.get(kind), count)
        if numbers is None:
            return f"places its voxels by a {kind} that is not {count} numbers"
        if kind == "scale":
            scale = numbers if scale is None else scale * numbers
            translation = translation * numbers
        else:
            translation = translation + numbers
    return scale, translation


def _numbers(given: Any, count: int) -> np.ndarray | None:
    if not isinstance(given, Sequence) or len(given) != count:
        return None
    if not all(type(part) in (int, float) and abs(part) < 1e30 for part in given):
        return None
    return np.array([float(part) for part in given])
