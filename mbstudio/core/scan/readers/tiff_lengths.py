"""The voxel size that a TIFF file states: OME first, then ImageJ, then the bare resolution tags."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mbstudio.core.errors import UnitError
from mbstudio.core.units import METRES_PER_UNIT, names_no_length, parse_unit

# Resolutions that cameras, scanners and image editors write without meaning a length.
_MEANINGLESS_DPI = (1, 72, 96, 100, 120, 144, 150, 180, 200, 240, 300, 350, 400, 600, 1200)
# Lengths that scan files may be given in beside those of mbstudio.
_OTHER_UNITS = {
    "inch": (25.4, "mm"), "inches": (25.4, "mm"), "in": (25.4, "mm"), "pm": (1e-3, "nm"),
    "å": (0.1, "nm"), "angstrom": (0.1, "nm"), "ångström": (0.1, "nm"), "dm": (10.0, "cm"),
}  # fmt: skip

Spacing = tuple[float, float, float]


@dataclass(frozen=True)
class StatedSize:
    """What a file says about the size of its voxels.

    Attributes
    ----------
    spacing : tuple of float or None
        Edges z, y, x in `unit`.
    unit : str or None
    unit_word : str or None
        What stands where the unit should, if it is no length that is known.
    metadata : dict
    notes : tuple of str
    doubt : str or None
        As in `Reading`.
    """

    spacing: Spacing | None = None
    unit: str | None = None
    unit_word: str | None = None
    metadata: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    doubt: str | None = None


def length_unit(text: object) -> tuple[float, str]:
    """Return how many of a unit of mbstudio's a unit's text means, and which; UnitError if none."""
    word = str(text or "")
    if word.strip().lower() in _OTHER_UNITS:
        return _OTHER_UNITS[word.strip().lower()]
    return 1.0, parse_unit(word)


def shared_unit(words: list[str]) -> tuple[np.ndarray, str | None, str | None]:
    """Return what three axes' numbers must be multiplied by to be in one unit, and that unit.

    Behind them comes a word that is no length, if there is one.
    """
    said = [word for word in words if not names_no_length(word)]
    if not said:
        return np.ones(3), None, None
    try:
        lengths = [
            length_unit(word) for word in (words if len(words) == 3 else [said[0]] * 3) if word in said
        ]
    except UnitError:
        return np.ones(3), None, next(word for word in said if not _is_length(word))
    unit = lengths[0][1]
    factors = [count * (METRES_PER_UNIT[name] / METRES_PER_UNIT[unit]) for count, name in lengths]
    if len(factors) != 3:  # one axis says nothing: it is taken to be as the others, if they agree
        if len(set(factors)) > 1:
            return np.ones(3), None, ", ".join(words)
        factors = [factors[0]] * 3
    return np.array(factors), unit, None


def _is_length(word: str) -> bool:
    try:
        length_unit(word)
    except UnitError:
        return False
    return True


def joined(edges: tuple[float, float, float], words: tuple[object, object, object]) -> StatedSize:
    """Return edges z, y, x, each with its own unit's text, in the unit of the last."""
    lengths = []
    for word in words:
        try:
            lengths.append(length_unit(word))
        except UnitError:
            said = str(word or "")
            return StatedSize(unit_word=None if names_no_length(said) else said)
    unit = lengths[-1][1]
    z, y, x = (
        edge * count * (METRES_PER_UNIT[name] / METRES_PER_UNIT[unit] if name != unit else 1.0)
        for edge, (count, name) in zip(edges, lengths, strict=True)
    )
    return StatedSize((z, y, x), unit)


def stated_size(document: Any) -> StatedSize:
    """Read the voxel size of an opened TIFF file.

    OME must state all three edges. Where ImageJ and plain TIFF say nothing of the slice distance,
    voxels are taken for cubic, as cone-beam CT makes them, and that is noted.
    """
    if document.is_ome:
        return _ome_size(document)
    tags = document.pages[0].tags
    pixel = _pixel_from_tags(tags)
    if document.is_imagej:
        return _imagej_size(document, pixel)
    per_unit = {2: 2.54, 3: 1.0}  # ResolutionUnit: inch, centimetre
    resolution_unit = int(tags["ResolutionUnit"].value) if "ResolutionUnit" in tags else 1
    if pixel is None or resolution_unit not in per_unit:
        return StatedSize()
    if _is_camera_default(pixel, resolution_unit):
        return StatedSize()
    y, x = (edge * per_unit[resolution_unit] for edge in pixel)
    return StatedSize((y, y, x), "cm", notes=cubic(y, "cm") if len(document.pages) > 1 else ())


def cubic(edge: float, unit: str) -> tuple[str, ...]:
    """Return the note that slices are taken to be as far apart as rows."""
    shown = edge * METRES_PER_UNIT[unit] / METRES_PER_UNIT["um"]
    return (
        f"states its pixel size but not its slice spacing, which was taken as {shown:g} µm, too. "
        "Give voxel_size if that is wrong.",
    )


def _imagej_size(document: Any, pixel: tuple[float, float] | None) -> StatedSize:
    """Read resolution tags in ImageJ's unit, and its ``spacing``, ``yunit`` and ``zunit``."""
    facts = dict(document.imagej_metadata or {})
    x_unit = facts.get("unit")
    y_unit, z_unit = facts.get("yunit") or x_unit, facts.get("zunit") or x_unit
    if pixel is None:
        return StatedSize(metadata=facts)
    notes: tuple[str, ...] = ()
    doubt = None
    depth = _number(facts.get("spacing"))
    if depth is None or depth == 0:
        depth = pixel[0]
        if "zunit" in facts:
            z_unit = y_unit
        has_slices = math.prod(document.series[0].shape[:-2]) > 1
        if has_slices and _is_by_imagej(facts) and abs(pixel[0] - 1) > 0.01:
            # ImageJ leaves out a distance of 1, which is also what it assumes where nothing was set.
            doubt = (
                f"gives pixels of {pixel[1]:g} {x_unit or ''} and slices 1 {z_unit or ''} apart, "
                "which ImageJ assumes if the voxel depth was not set"
            )
        elif has_slices:
            known = joined((depth, *pixel), (z_unit, y_unit, x_unit))
            if known.spacing is not None and known.unit is not None:
                notes = cubic(known.spacing[0], known.unit)
    words = {"inch": 2, "inches": 2, "in": 2, "cm": 3}
    by_camera = words.get(str(x_unit or "").lower())
    if by_camera is not None and _is_camera_default(pixel, by_camera):
        return StatedSize(metadata=facts)
    size = joined((abs(depth), *pixel), (z_unit, y_unit, x_unit))
    return StatedSize(size.spacing, size.unit, size.unit_word, facts, notes, doubt)


def _is_by_imagej(facts: dict[str, Any]) -> bool:
    """Whether ImageJ wrote the file; tifffile writes its name with version 1.11a."""
    return str(facts.get("ImageJ", "")).strip() not in ("", "1.11a")


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _is_camera_default(pixel: tuple[float, float], resolution_unit: int) -> bool:
    """Whether pixels per inch (2) or centimetre (3) are a number that software writes unasked."""
    for edge in pixel:
        dpi = 1 / edge if resolution_unit == 2 else 2.54 / edge
        if any(abs(dpi - known) < 0.02 * max(known, 1) for known in _MEANINGLESS_DPI):
            return True
        if resolution_unit == 3 and abs(1 / edge - 1) < 1e-6:
            return True
    return False


def _pixel_from_tags(tags: Any) -> tuple[float, float] | None:
    """Return the pixel's edges (y, x) from the resolution tags, per resolution unit."""
    edges = []
    for name in ("YResolution", "XResolution"):
        if name not in tags:
            return None
        pixels, units = tags[name].value
        if pixels <= 0 or units <= 0:
            return None
        edges.append(units / pixels)
    return edges[0], edges[1]


def _ome_size(document: Any) -> StatedSize:
    """Read PhysicalSizeX, Y, Z of the first OME image; OME's default unit is the micrometre."""
    root = ElementTree.fromstring(document.ome_metadata)
    pixels = next((node for node in root.iter() if node.tag.rpartition("}")[2] == "Pixels"), None)
    if pixels is None:
        return StatedSize()
    facts = dict(pixels.attrib)
    edges = tuple(_number(facts.get(f"PhysicalSize{axis}")) for axis in "ZYX")
    z, y, x = edges
    if z is None or y is None or x is None:
        return StatedSize(metadata=facts)
    words = tuple(facts.get(f"PhysicalSize{axis}Unit", "µm") for axis in "ZYX")
    size = joined((z, y, x), (words[0], words[1], words[2]))
    return StatedSize(size.spacing, size.unit, size.unit_word, facts)
