"""The voxel size in the attributes of an array, by the names that programs write into HDF5 and Zarr."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mbstudio.core.errors import UnitError
from mbstudio.core.scan.readers.text import plain_text
from mbstudio.core.scan.readers.tiff_lengths import Spacing, length_unit
from mbstudio.core.units import names_no_length

StatedSpacing = tuple[Spacing | None, str | None, str | None]
"""Edges z, y, x, their unit, and what stands where the unit should if that is no length."""


def spacing_of_attributes(attributes: Mapping[str, Any]) -> StatedSpacing:
    """Return edges z, y, x, unit and odd unit's word; all None where the attributes say nothing."""
    if "element_size_um" in attributes:  # Fiji's HDF5 plugin, ilastik, PlantSeg
        edges = _three(attributes["element_size_um"])
        if edges is not None:
            return edges, "um", None
    for name in ("voxel_size", "voxelsize", "pixel_size", "spacing", "resolution", "element_size"):
        if name in attributes:
            edges = _three(attributes[name])
            if edges is None:
                continue
            keys = ("unit", "units", f"{name}_unit", f"{name}_units")
            words = [attribute_text(attributes[key]) for key in keys if key in attributes]
            return _with_unit(edges, words[0] if words else "")
    return None, None, None


def attribute_text(value: Any) -> str:
    """Return an attribute as text, in whichever way it was written."""
    if isinstance(value, np.ndarray):
        value = value.flat[0] if value.size else ""
    return plain_text(value) if isinstance(value, bytes) else str(value)


def _three(value: Any) -> Spacing | None:
    try:
        numbers = [float(number) for number in np.ravel(value)]
    except (TypeError, ValueError, OverflowError):
        return None
    if len(numbers) == 1:
        numbers *= 3
    if len(numbers) != 3 or min(numbers) <= 0:
        return None
    return numbers[0], numbers[1], numbers[2]


def _with_unit(edges: Spacing, word: str) -> StatedSpacing:
    if names_no_length(word):
        return edges, None, None
    try:
        factor, unit = length_unit(word)
    except UnitError:
        return edges, None, word
    z, y, x = edges
    return (z * factor, y * factor, x * factor), unit, None
