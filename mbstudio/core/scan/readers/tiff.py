"""Multi-page TIFF: ImageJ, OME and plain stacks, memory-mapped where they are uncompressed."""

from __future__ import annotations

import logging
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError, UnitError
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions, require_grey_volume
from mbstudio.core.scan.slice_stack import SliceStack
from mbstudio.core.units import conversion_factor, parse_unit

# A compressed stack up to this size is decoded at once; a larger one page by page on demand.
DECODE_AT_ONCE_BYTES = 2 << 30
# Resolutions that cameras, scanners and image editors write without meaning a length.
_MEANINGLESS_DPI = (1, 72, 96, 100, 120, 144, 150, 180, 200, 240, 300, 350, 400, 600, 1200)

Spacing = tuple[float, float, float]


@contextmanager
def _quiet_tifffile() -> Iterator[list[str]]:
    """Collect the errors that tifffile logs about a broken file instead of printing them."""
    messages: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.levelno >= logging.ERROR:
                messages.append(record.getMessage())

    logger, collector = logging.getLogger("tifffile"), Collector()
    propagates, logger.propagate = logger.propagate, False
    logger.addHandler(collector)
    try:
        yield messages
    finally:
        logger.removeHandler(collector)
        logger.propagate = propagates


def read(path: Path, options: ReadOptions) -> Reading:
    """Read a TIFF stack of one channel and one time step.

    Raises
    ------
    ScanError
        If the file is empty, truncated, no TIFF, in colour, or has more than three axes.
    """
    import tifffile

    if path.stat().st_size == 0:
        raise ScanError(f"{path} is empty (0 bytes): copy or export the scan again.")
    try:
        with _quiet_tifffile() as errors, tifffile.TiffFile(path) as document:
            pages = len(document.pages)
            if errors:
                raise ScanError(
                    f"{path} is cut off or damaged: only {pages} of its pages can be found; "
                    "copy or export it again."
                )
            voxels = _voxels(document, path)
            spacing, unit, metadata = _voxel_size(document)
    except ScanError:
        raise
    except Exception as error:  # the parser and the codecs raise errors of many unrelated types
        raise ScanError(
            f"{path} cannot be read as a TIFF stack ({error}): "
            "it is damaged or cut off; copy or export it again."
        ) from error
    return Reading(voxels, spacing, unit, metadata=metadata)


def _voxels(document: Any, path: Path) -> Any:
    """Return the voxels of the file's one series, mapped, decoded or lazy."""
    import tifffile

    if not document.series:
        raise ScanError(f"{path} holds no images: copy or export the scan again.")
    if len(document.series) > 1 and len({series.shape for series in document.series}) > 1:
        shapes = ", ".join(str(series.shape) for series in document.series[:4])
        raise ScanError(
            f"{path} holds {len(document.series)} images of different sizes ({shapes}): "
            "save the slices of one scan, all of one size, as their own file."
        )
    _require_complete(document, path)
    shape, dtype = _stack_shape(document, path)
    require_grey_volume(shape, dtype, path)
    page = document.pages[0]
    if len(document.series) == 1 and document.series[0].dataoffset is not None and page.is_memmappable:
        byte_order = document.byteorder
        return np.memmap(path, dtype.newbyteorder(byte_order), "r", document.series[0].dataoffset, shape)
    if math.prod(shape) * dtype.itemsize <= DECODE_AT_ONCE_BYTES:
        volume = document.asarray() if len(document.series) == 1 else document.asarray(key=slice(None))
        return np.ascontiguousarray(volume).reshape(shape)

    def read_slice(index: int) -> np.ndarray:
        return np.array(tifffile.imread(path, key=index))

    return SliceStack(read_slice, shape, dtype)


def _stack_shape(document: Any, path: Path) -> tuple[tuple[int, int, int], np.dtype[Any]]:
    """Return (Z, Y, X) and the dtype; axes of length one beside these are dropped."""
    series = document.series[0]
    dtype = np.dtype(series.dtype)
    if "S" in series.axes and series.shape[series.axes.index("S")] in (3, 4):
        raise ScanError(
            f"{path} holds colour images (shape {series.shape}): convert it to grey values first, "
            "for example in ImageJ with Image > Type > 16-bit."
        )
    if len(document.series) > 1:  # plain pages that tifffile does not join
        return (len(document.pages), *document.pages[0].shape), dtype
    axes = [(axis, length) for axis, length in zip(series.axes, series.shape, strict=True) if length > 1]
    crowd = [f"{axis}={length}" for axis, length in axes if axis in "CT"]
    if len(axes) > 3 or (crowd and len(axes) == 3 and "Z" in series.axes and dict(axes).get("Z", 1) > 1):
        raise ScanError(
            f"{path} holds more than one volume (axes {series.axes}, shape {series.shape}): "
            "save one channel and one time step as its own file."
        )
    lengths = tuple(length for _, length in axes)
    if len(axes) < 3:  # slices only one voxel long along an axis
        lengths = tuple(series.shape[-3:]) if len(series.shape) >= 3 else (1, *series.shape)
    return lengths, dtype


def _require_complete(document: Any, path: Path) -> None:
    """Raise ScanError if a page's data lies beyond the end of the file."""
    size = document.filehandle.size
    count = len(document.pages)
    series = document.series[0]
    if series.dataoffset is not None:
        missing = series.dataoffset + series.nbytes > size
    else:
        missing = any(
            offset + length > size or offset == 0
            for page in document.pages
            for offset, length in zip(page.dataoffsets, page.databytecounts, strict=False)
            if length
        )
    declared = document.shaped_metadata[0].get("shape") if document.shaped_metadata else None
    if declared and math.prod(declared) != sum(math.prod(one.shape) for one in document.series):
        missing = True
    if document.is_imagej and (document.imagej_metadata or {}).get("images", count) > max(
        count, math.prod(series.shape[:-2])
    ):
        missing = True
    if missing:
        raise ScanError(
            f"{path} is cut off: its pages need more than its {size:,} bytes; copy or export it again."
        )


def voxel_size_of(file: Path) -> tuple[Spacing | None, str | None, dict[str, Any]]:
    """Return spacing (z, y, x), unit and metadata of a TIFF file."""
    import tifffile

    with _quiet_tifffile(), tifffile.TiffFile(file) as document:
        return _voxel_size(document)


def _voxel_size(document: Any) -> tuple[Spacing | None, str | None, dict[str, Any]]:
    """Read the voxel size: OME first, then ImageJ, then the bare resolution tags.

    OME must state all three edges. ImageJ and plain TIFF without a slice distance are taken to
    have cubic voxels, as cone-beam CT does; `open_scan` can be told otherwise.
    """
    if document.is_ome:
        return _ome_size(document)
    tags = document.pages[0].tags
    pixel = _pixel_from_tags(tags)
    if document.is_imagej:
        facts = dict(document.imagej_metadata or {})
        unit = _known_unit(facts.get("unit"))
        if pixel is None or unit is None:
            return None, None, facts
        depth = float(facts.get("spacing", pixel[1]))
        return (depth, *pixel), unit, facts
    per_unit = {2: ("cm", 2.54), 3: ("cm", 1.0)}  # ResolutionUnit: inch, centimetre
    resolution_unit = int(tags["ResolutionUnit"].value) if "ResolutionUnit" in tags else 2
    if pixel is None or resolution_unit not in per_unit:
        return None, None, {}
    unit, factor = per_unit[resolution_unit]
    if any(_is_camera_default(1 / edge, resolution_unit) for edge in pixel):
        return None, None, {}
    y, x = (edge * factor for edge in pixel)
    return (y, y, x), unit, {}


def _is_camera_default(resolution: float, resolution_unit: int) -> bool:
    """Whether pixels per inch (2) or centimetre (3) are a number that software writes unasked."""
    dpi = resolution if resolution_unit == 2 else resolution * 2.54
    return any(abs(dpi - known) < 0.02 * max(known, 1) for known in _MEANINGLESS_DPI) or (
        resolution_unit == 3 and abs(resolution - 1) < 1e-6
    )


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


def _known_unit(text: Any) -> str | None:
    """Return the canonical unit of an ImageJ unit text, None if it is no length ('pixel')."""
    name = str(text or "").replace("\\u00B5", "µ").replace("\\u00b5", "µ")
    try:
        return parse_unit(name)
    except UnitError:
        return None


def _ome_size(document: Any) -> tuple[Spacing | None, str | None, dict[str, Any]]:
    """Read PhysicalSizeX, Y, Z of the first OME image; OME's default unit is the micrometre."""
    root = ElementTree.fromstring(document.ome_metadata)
    pixels = next((node for node in root.iter() if node.tag.rpartition("}")[2] == "Pixels"), None)
    if pixels is None:
        return None, None, {}
    facts = dict(pixels.attrib)
    edges, units = [], []
    for axis in "ZYX":
        if f"PhysicalSize{axis}" not in facts:
            return None, None, facts
        unit = _known_unit(facts.get(f"PhysicalSize{axis}Unit", "µm"))
        if unit is None:
            return None, None, facts
        edges.append(float(facts[f"PhysicalSize{axis}"]))
        units.append(unit)
    z, y, x = (edge * conversion_factor(unit, units[-1]) for edge, unit in zip(edges, units, strict=True))
    return (z, y, x), units[-1], facts


FAMILY = Family("TIFF stack", (".tif", ".tiff"), read)
