"""Multi-page TIFF: ImageJ, OME and plain stacks, memory-mapped where they are uncompressed."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.family import (
    Family,
    Reading,
    ReadOptions,
    memory_refusal,
    require_grey_volume,
    require_memory,
)
from mbstudio.core.scan.readers.pixels import PixelMeaning, decode, plain_numbers
from mbstudio.core.scan.readers.tiff_lengths import StatedSize, cubic, stated_size
from mbstudio.core.scan.scan import VoxelArray
from mbstudio.core.scan.slice_stack import Block, SliceStack

# A compressed stack up to this size is decoded at once; a larger one page by page on demand.
DECODE_AT_ONCE_BYTES = 2 << 30
_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_OTHER_MAGIC = {
    b"\x89PNG": "a PNG image", b"\xff\xd8\xff": "a JPEG image", b"BM": "a BMP image", b"GIF8": "a GIF image",
    b"\x89HDF": "an HDF5 file", b"PK\x03\x04": "a ZIP archive", b"\x1f\x8b": "a gzip archive",
    b"NRRD": "an NRRD file", b"%PDF": "a PDF document", b"<!DO": "a web page", b"<htm": "a web page",
    b"\x93NUM": "a NumPy array",
}  # fmt: skip


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


def _opened(path: Path) -> Any:
    """Open a TIFF file, and no other that it may name as part of a set."""
    import tifffile

    return tifffile.TiffFile(path, _multifile=False)


def read(path: Path, options: ReadOptions) -> Reading:
    """Read a TIFF stack of one channel and one time step.

    Raises
    ------
    ScanError
        If the file is empty, truncated, no TIFF, in colour, or has more than three axes.
    """
    require_tiff(path)
    try:
        with _quiet_tifffile() as errors, _opened(path) as document:
            pages = len(document.pages)
            if errors:
                raise ScanError(
                    f"{path} is cut off or damaged: only {pages} of its pages can be found; "
                    "copy or export it again."
                )
            voxels, white_is_zero, notes = _voxels(document, path, options)
            size = stated_size(document)
    except ScanError:
        raise
    except MemoryError as error:
        raise memory_refusal(path) from error
    except Exception as error:  # the parser and the codecs raise errors of many unrelated types
        raise _unreadable(path, error) from error
    return Reading(
        voxels, size.spacing, size.unit, size.unit_word, metadata=size.metadata,
        notes=notes, size_notes=size.notes, doubt=size.doubt, white_is_zero=white_is_zero,
    )  # fmt: skip


def require_tiff(path: Path) -> None:
    """Raise ScanError, with the true cause, if a file does not begin as TIFF files do."""
    if path.stat().st_size == 0:
        raise ScanError(f"{path} is empty (0 bytes): copy or export the scan again.")
    with path.open("rb") as stream:
        start = stream.read(4)
    if start in _MAGIC:
        return
    for magic, kind in _OTHER_MAGIC.items():
        if start.startswith(magic):
            raise ScanError(
                f"{path} is not a TIFF file but {kind}: give it the right ending, or export as TIFF."
            )
    raise ScanError(f"{path} is not a TIFF file, although its name ends so: export the scan as TIFF.")


def _unreadable(path: Path, error: Exception) -> ScanError:
    """Return the error that tells why a TIFF file cannot be decoded."""
    reason = str(error) or type(error).__name__
    if "imagecodecs" in reason or "codec" in reason.lower() or "not supported" in reason:
        return ScanError(
            f"{path} is compressed or laid out in a way that cannot be decoded here ({reason}): "
            "save it uncompressed."
        )
    return ScanError(
        f"{path} cannot be read as a TIFF stack ({reason}): it is damaged or cut off; "
        "copy or export it again."
    )


def _voxels(document: Any, path: Path, options: ReadOptions) -> tuple[VoxelArray, bool, tuple[str, ...]]:
    """Return the voxels of the file's one stack, mapped, decoded or lazy; whether white is zero; notes."""
    if not document.series:
        raise ScanError(f"{path} contains no images: copy or export the scan again.")
    numbers = options.numbers
    chosen, notes = _stack(document, path)
    _require_complete(document, chosen, path)
    shape, dtype = _stack_shape(document, chosen, path)
    page = chosen[0].keyframe
    meaning = meaning_of(page)
    require_grey_volume(shape, dtype, path)
    one = chosen[0] if len(chosen) == 1 else None
    raw: VoxelArray
    if one is not None and one.dataoffset is not None and page.is_memmappable and meaning.samples == 1:
        order = document.byteorder
        raw = np.memmap(path, dtype.newbyteorder(order), "r", one.dataoffset, shape)
        if meaning.is_plain or (numbers and meaning.palette is None):
            return plain_numbers(raw), meaning.white_is_zero, notes
    volume = math.prod(shape) * dtype.itemsize * meaning.samples
    pages = [part.index for series in chosen for part in series.pages if part is not None]
    if (volume <= DECODE_AT_ONCE_BYTES and not options.in_part) or len(pages) != shape[0]:
        require_memory(shape, dtype.itemsize * meaning.samples, path, document.filehandle.size)
        return _decode_at_once(chosen, shape, meaning, path, numbers), meaning.white_is_zero, notes

    def read_block(block: Block) -> np.ndarray:
        images = []
        try:
            with _quiet_tifffile(), _opened(path) as again:
                for number in pages[block[0]]:
                    page = again.pages[number]
                    whole = decode(_samples_last(page.asarray(), page.axes), meaning, path, numbers=numbers)
                    images.append(whole[block[1], block[2]].copy())
        except ScanError:
            raise
        except MemoryError as error:
            raise memory_refusal(path) from error
        except Exception as error:  # as in read
            raise _unreadable(path, error) from error
        return np.stack(images)

    first = read_block((slice(0, 1), slice(0, 1), slice(0, 1)))
    return SliceStack.of_blocks(read_block, shape, first.dtype), meaning.white_is_zero, notes


def _decode_at_once(
    chosen: Sequence[Any], shape: tuple[int, int, int], meaning: PixelMeaning, path: Path, numbers: bool
) -> np.ndarray:
    volumes = [_samples_last(series.asarray(), series.axes) for series in chosen]
    volume = volumes[0] if len(volumes) == 1 else np.stack(volumes)
    full = (*shape, volume.shape[-1]) if meaning.samples > 1 else shape
    return decode(np.ascontiguousarray(volume).reshape(full), meaning, path, numbers=numbers)


def _samples_last(image: np.ndarray, axes: str) -> np.ndarray:
    """Return an image with the samples of a pixel on its last axis, if it has such."""
    return np.moveaxis(image, axes.index("S"), -1) if "S" in axes else image


def meaning_of(page: Any) -> PixelMeaning:
    """Return what the numbers of a page stand for, by its tags."""
    photometric = int(page.photometric)
    palette = None
    if photometric == 3 and page.colormap is not None:
        palette = np.ascontiguousarray(np.asarray(page.colormap, dtype=np.uint16).T)
        if palette.size and palette.max() < 256:  # bytes where the format has two-byte colours
            palette = palette * np.uint16(257)
    bits = page.bitspersample
    bits = int(bits if isinstance(bits, int) else max(bits))
    lossy = int(page.compression) in (6, 7, 33003, 33005, 34712, 34892)
    samples = int(page.samplesperpixel) if "S" in page.axes else 1
    return PixelMeaning(photometric == 0, bits, palette, samples, lossy)


def _stack(document: Any, path: Path) -> tuple[list[Any], tuple[str, ...]]:
    """Choose the series that make the stack: one volume, or many single pages of one size."""
    series = list(document.series)
    if len(series) == 1:
        return series, ()
    volumes = [one for one in series if _depth(one) > 1]
    if not volumes and len({(one.shape, one.dtype) for one in series}) == 1:
        return series, ()
    if len(volumes) == 1 and all(one is volumes[0] or _is_beside(one, volumes[0]) for one in series):
        others = ", ".join(_named(one) for one in series if one is not volumes[0])
        return volumes, (f"contains other images besides the stack, which were left out: {others}.",)
    names = ", ".join(_named(one) for one in series[:6])
    if len({one.shape[-2:] for one in series}) > 1:
        raise ScanError(
            f"{path} contains {len(series)} images of different sizes ({names}): "
            "save the slices of one scan, all of the same size, as their own file."
        )
    raise ScanError(
        f"{path} contains {len(series)} stacks of images ({names}), and it is unclear which is the scan: "
        "save the right one as its own file."
    )


def _depth(series: Any) -> int:
    """Return how many images a series holds."""
    return math.prod(
        length for axis, length in zip(series.axes, series.shape, strict=True) if axis not in "YXS"
    )


def _is_beside(series: Any, volume: Any) -> bool:
    """Whether a single image lies before or behind all pages of a volume: a label or preview of it."""
    if _depth(series) > 1:
        return False
    mine = [page.index for page in series.pages if page is not None]
    its = [page.index for page in volume.pages if page is not None]
    return not mine or not its or mine[-1] < its[0] or mine[0] > its[-1]


def _named(series: Any) -> str:
    name = f"'{series.name}' " if series.name else ""
    return f"{name}{' x '.join(map(str, series.shape))}"


def _stack_shape(
    document: Any, chosen: Sequence[Any], path: Path
) -> tuple[tuple[int, int, int], np.dtype[Any]]:
    """Return (Z, Y, X) and the dtype; axes of length one beside these are dropped."""
    series = chosen[0]
    dtype = np.dtype(series.dtype)
    pairs = [(axis, length) for axis, length in zip(series.axes, series.shape, strict=True) if axis != "S"]
    axes, shape = "".join(axis for axis, _ in pairs), tuple(length for _, length in pairs)
    if len(chosen) > 1:  # plain pages that tifffile does not join
        return (len(chosen), shape[-2], shape[-1]), dtype
    long = [(axis, length) for axis, length in pairs if length > 1]
    crowd = [f"{axis}={length}" for axis, length in long if axis in "CT"]
    slices = dict(pairs).get("Z", 1)
    if len(long) > 3 or (crowd and len(long) == 3 and slices > 1):
        raise ScanError(
            f"{path} contains more than one volume (axes {axes}, shape {shape}): "
            "save one channel and one time step as its own file."
        )
    _require_slices(document, dict(pairs), path)
    if len(long) < 3:  # slices only one voxel long along an axis
        shape = shape[-3:] if len(shape) >= 3 else (1, *shape)
        return (shape[0], shape[1], shape[2]), dtype
    return (long[0][1], long[1][1], long[2][1]), dtype


def _require_slices(document: Any, lengths: dict[str, int], path: Path) -> None:
    """Refuse what ImageJ says are colour channels, or moments in time, of one slice."""
    facts = (document.imagej_metadata or {}) if document.is_imagej else {}
    if facts and 1 < lengths.get("C", 1) <= 4 and str(facts.get("mode", "")) in ("composite", "color"):
        raise ScanError(
            f"{path} contains {lengths['C']} channels of one slice: save one channel of all slices as its "
            "own file."
        )
    if facts and lengths.get("T", 1) > 1 and "finterval" in facts:
        raise ScanError(
            f"{path} is a time series of one slice ({lengths['T']} frames): if its frames are slices, swap "
            "frames and slices in ImageJ with Image > Properties, and clear the frame interval."
        )


def _require_complete(document: Any, chosen: Sequence[Any], path: Path) -> None:
    """Raise ScanError if a page's data lies beyond the end of the file."""
    size = document.filehandle.size
    count = len(document.pages)
    series = chosen[0]
    if document.is_ome and any(page is None for one in chosen for page in one.pages):
        raise ScanError(
            f"{path} is one file of a set, and the slices in the other files are not read: "
            "save the set as one file."
        )
    if series.dataoffset is not None and len(chosen) == 1:
        missing = series.dataoffset + series.nbytes > size
    else:
        missing = any(
            offset + length > size or offset == 0
            for page in document.pages
            for offset, length in zip(page.dataoffsets, page.databytecounts, strict=False)
            if length
        )
    declared = document.shaped_metadata[0].get("shape") if document.shaped_metadata else None
    if declared and math.prod(declared) > sum(math.prod(one.shape) for one in document.series):
        missing = True
    if document.is_imagej and (document.imagej_metadata or {}).get("images", count) > max(
        count, math.prod(series.shape[:-2])
    ):
        missing = True
    if missing:
        raise ScanError(
            f"{path} is cut off: its pages need more than its {size:,} bytes; copy or export it again."
        )


# One slice of a folder -------------------------------------------------------------------------------


def read_image(file: Path, numbers: bool) -> tuple[np.ndarray, bool]:
    """Return the one image of a file, decoded, and whether white is zero."""
    require_tiff(file)
    with _quiet_tifffile() as errors, _opened(file) as document:
        # The pages are counted before anything goes through them: in a circle of pages that would not end.
        count = len(document.pages)
        if count > 1 and errors:
            raise ScanError(f"The slice {file} is cut off or damaged: copy or export it again.")
        if count > 1:
            raise ScanError(
                f"The slice {file} holds {count} images instead of one: "
                "open the file itself if it is the whole scan."
            )
        page = document.pages[0]
        meaning = meaning_of(page)
        require_memory(page.shape, np.dtype(page.dtype or "u1").itemsize, file, document.filehandle.size)
        image = _samples_last(page.asarray(), page.axes)
    return decode(image, meaning, f"The slice {file}", numbers=numbers), meaning.white_is_zero


def describe_image(file: Path) -> tuple[tuple[int, int], str]:
    """Return rows and columns of a file's first page and what its pixels are, from its tags alone."""
    require_tiff(file)
    with _quiet_tifffile(), _opened(file) as document:
        page = document.pages[0]
        kind = f"{page.dtype}, {page.samplesperpixel} values a pixel, {page.photometric.name.lower()}"
        return (int(page.imagelength), int(page.imagewidth)), kind


def stated_size_of(file: Path) -> StatedSize:
    """Return what a TIFF file says about the size of its voxels."""
    with _quiet_tifffile(), _opened(file) as document:
        len(document.pages)  # as in read_image
        return stated_size(document)


def note_assumed_spacing(size: StatedSize) -> tuple[str, ...]:
    """Return the note that slices of a folder are taken to be as far apart as rows."""
    assert size.spacing is not None
    assert size.unit is not None
    return cubic(size.spacing[0], size.unit)


FAMILY = Family("TIFF stack", (".tif", ".tiff"), read)
