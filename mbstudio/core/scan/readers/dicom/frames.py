"""The pixels of DICOM frames: bare ones by their place in the file, packed ones by imagecodecs."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.dicom.headers import Header, name_of
from mbstudio.core.scan.readers.pixels import PixelMeaning, decode

# Transfer syntaxes of bare pixels; what says none is of the first.
_BARE = ("", "1.2.840.10008.1.2", "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.2")
# The codec of imagecodecs for each packed one, and whether it loses something.
_CODECS = {
    "1.2.840.10008.1.2.5": ("runs", False),
    "1.2.840.10008.1.2.4.50": ("jpeg", True), "1.2.840.10008.1.2.4.51": ("jpeg", True),
    "1.2.840.10008.1.2.4.57": ("jpeg", False), "1.2.840.10008.1.2.4.70": ("jpeg", False),
    "1.2.840.10008.1.2.4.80": ("jpegls", False), "1.2.840.10008.1.2.4.81": ("jpegls", True),
    "1.2.840.10008.1.2.4.90": ("jpeg2k", False), "1.2.840.10008.1.2.4.91": ("jpeg2k", True),
}  # fmt: skip
_ITEM, _END = b"\xfe\xff\x00\xe0", b"\xfe\xff\xdd\xe0"
# Blank slices pack by so much at most; what claims more is no image of that size.
_MOST_COMPRESSION = 30_000


def is_bare(header: Header) -> bool:
    """Return whether pixels lie in the file as they are."""
    return header.syntax in _BARE


def require_readable(header: Header) -> None:
    """Raise ScanError if the pixels are packed in a way that is not read, or cannot be in the file."""
    if not is_bare(header) and header.syntax not in _CODECS:
        raise ScanError(
            f"{header.path} is packed as {name_of(header.syntax)}, which is not read here: "
            "save it uncompressed, for example with dcmdjpeg or gdcmconv --raw."
        )
    there = header.path.stat().st_size
    needed = header.frame_bytes * len(header.frames)
    stated = f"{len(header.frames)} frames of {header.rows} x {header.columns} pixels, {needed:,} bytes"
    if is_bare(header):
        held = min(there - header.offset, header.length)
        if needed > held:
            raise ScanError(
                f"{header.path} states {stated}, but holds {max(held, 0):,}: it is cut off, or its "
                "header is wrong; "
                "copy or export it again."
            )
    elif needed > _MOST_COMPRESSION * there + 2**20:
        raise ScanError(
            f"{header.path} states {stated}, but holds {there:,} in all: its header is wrong or its "
            "data is cut "
            "off; copy or export it again."
        )


def frame_reader(header: Header) -> Callable[[int], np.ndarray]:
    """Return a function that reads the stored numbers of a frame, shape (rows, columns[, samples]).

    Raises
    ------
    ScanError
        If the packed frames of the file cannot be found.
    """
    if is_bare(header):
        return lambda index: _bare(header, index)
    places = _packed_frames(header)
    return lambda index: _unpacked(header, places[index])


def meaning_of(header: Header, index: int) -> PixelMeaning:
    """Return what the numbers of a frame stand for."""
    frame = header.frames[index]
    lossy = header.syntax in _CODECS and _CODECS[header.syntax][1]
    return PixelMeaning(
        header.white_is_zero, header.bits, None, header.samples, lossy, frame.slope, frame.intercept
    )


def decoded(header: Header, index: int, stored: np.ndarray, numbers: bool) -> np.ndarray:
    """Return the values of a frame."""
    image = np.ascontiguousarray(_counting_bits(stored, header))
    return decode(image, meaning_of(header, index), header.path, numbers=numbers)


def _counting_bits(stored: np.ndarray, header: Header) -> np.ndarray:
    """Return numbers by the bits that count: others may hold overlays, or the sign of packed numbers."""
    rest = 8 * header.dtype.itemsize - header.bits
    if rest == 0 or stored.dtype.kind == "f":
        return stored
    native = stored.astype(stored.dtype.newbyteorder("="))
    return np.asarray(np.right_shift(np.left_shift(native, rest), rest))


def _shape(header: Header) -> tuple[int, ...]:
    if header.samples == 1:
        return header.rows, header.columns
    if header.planar:
        return header.samples, header.rows, header.columns
    return header.rows, header.columns, header.samples


def _bare(header: Header, index: int) -> np.ndarray:
    try:
        with header.path.open("rb") as stream:
            stream.seek(header.offset + index * header.frame_bytes)
            block = stream.read(header.frame_bytes)
    except OSError as error:
        raise ScanError(f"{header.path} cannot be read ({error}): check that you may read it.") from error
    if len(block) != header.frame_bytes:
        raise ScanError(f"{header.path} has become shorter since it was opened: open it again.")
    image = np.frombuffer(block, header.dtype).reshape(_shape(header))
    return np.moveaxis(image, 0, -1) if header.planar else image


# Packed frames ----------------------------------------------------------------------------------------


def _packed_frames(header: Header) -> list[list[tuple[int, int]]]:
    """Return the fragments of each frame: where they begin in the file, and how long they are."""
    fragments: list[tuple[int, int]] = []
    count = len(header.frames)
    there = header.path.stat().st_size
    with header.path.open("rb") as stream:
        stream.seek(header.offset)
        while True:
            start = stream.read(8)
            if len(start) < 8 or start[:4] == _END:
                break
            length = int.from_bytes(start[4:], "little")
            place = stream.tell()
            if start[:4] != _ITEM or place + length > there:
                raise _cut(header.path)
            fragments.append((place, length))
            stream.seek(length, 1)
            if len(fragments) > count + 2**20:
                raise _cut(header.path)
        if not fragments:
            raise _cut(header.path)
        (table, size), *fragments = fragments
        stream.seek(table)
        offsets = np.frombuffer(stream.read(size // 4 * 4), "<u4")
    if len(fragments) == count:
        return [[fragment] for fragment in fragments]
    if count == 1 and fragments:
        return [fragments]
    if len(offsets) != count:
        raise _cut(header.path)
    first = fragments[0][0] - 8
    starts = [first + int(offset) for offset in offsets] + [there]
    frames = [
        [fragment for fragment in fragments if begin <= fragment[0] - 8 < end]
        for begin, end in pairwise(starts)
    ]
    if not all(frames):
        raise _cut(header.path)
    return frames


def _cut(path: Path) -> ScanError:
    return ScanError(f"{path} does not hold the packed frames that it states: it is damaged or cut off; "
                     "copy or export it again.")  # fmt: skip


def _unpacked(header: Header, fragments: list[tuple[int, int]]) -> np.ndarray:
    """Unpack a frame, which must have the size that the header states."""
    import imagecodecs

    with header.path.open("rb") as stream:
        parts = []
        for place, length in fragments:
            stream.seek(place)
            parts.append(stream.read(length))
    packed = b"".join(parts)
    name = _CODECS[header.syntax][0]
    try:
        if name == "runs":
            return _unpacked_runs(packed, header)
        if name == "jpeg2k":
            _require_size(packed, header)
        return _into(getattr(imagecodecs, f"{name}_decode"), packed, header)
    except (RuntimeError, ValueError, TypeError, OSError, IndexError) as error:
        raise ScanError(
            f"{header.path} holds a frame that {name} cannot unpack ({error}): it is damaged, or "
            "packed in a way "
            "that is not read here; save it uncompressed, for example with gdcmconv --raw."
        ) from error


def _into(codec: Any, packed: bytes, header: Header) -> np.ndarray:
    """Unpack into an array of the stated size: another one is found out before anything is unpacked."""
    shape = (header.rows, header.columns) + ((header.samples,) if header.samples > 1 else ())
    kinds = [f"u{header.dtype.itemsize}", f"i{header.dtype.itemsize}"]
    if header.dtype.itemsize == 2 and header.bits <= 8:
        kinds.append("u1")
    failure: Exception | None = None
    for kind in kinds:
        out = np.empty(shape, kind)
        try:
            codec(packed, out=out)
        except ValueError as error:
            failure = error
            continue
        return (
            out.astype(header.dtype)
            if out.dtype.itemsize != header.dtype.itemsize
            else out.view(header.dtype)
        )
    assert failure is not None
    raise failure


def _require_size(packed: bytes, header: Header) -> None:
    """Raise ValueError unless a JPEG 2000 states the size of a frame: else it would be unpacked first."""
    if packed[:4] != b"\xff\x4f\xff\x51" or len(packed) < 40:
        raise ValueError("no codestream of JPEG 2000")
    width, height, left, top = (int.from_bytes(packed[at : at + 4], "big") for at in (8, 12, 16, 20))
    parts = int.from_bytes(packed[40:42], "big")
    if (height - top, width - left, parts) != (header.rows, header.columns, header.samples):
        raise ValueError(f"it states the shape ({height - top}, {width - left})")


def _unpacked_runs(packed: bytes, header: Header) -> np.ndarray:
    """Unpack bytes that are packed by their runs, the planes of high bytes before those of low ones."""
    count = int.from_bytes(packed[:4], "little")
    size, pixels = header.dtype.itemsize, header.rows * header.columns
    if count != size * header.samples or len(packed) < 64:
        raise ValueError(f"{count} planes of bytes where {size * header.samples} should be")
    starts = [int(start) for start in np.frombuffer(packed, "<u4", count, 4)] + [len(packed)]
    planes = np.empty((header.samples, pixels, size), np.uint8)
    for plane in range(count):
        sample, byte = divmod(plane, size)
        runs = _runs(memoryview(packed)[starts[plane] : starts[plane + 1]], pixels)
        planes[sample, :, size - 1 - byte] = np.frombuffer(runs, np.uint8)
    values = planes.view(header.dtype.newbyteorder("<"))[..., 0].reshape(-1, header.rows, header.columns)
    return np.moveaxis(values, 0, -1) if header.samples > 1 else values[0]


def _runs(packed: memoryview, size: int) -> bytes:
    """Return so many bytes of runs and of bytes as they are."""
    out, place = bytearray(), 0
    while len(out) < size and place < len(packed):
        sign = packed[place]
        if sign < 128:
            out += packed[place + 1 : place + 2 + sign]
            place += 2 + sign
        else:
            if sign > 128:
                out += bytes(packed[place + 1 : place + 2]) * (257 - sign)
            place += 2
    if len(out) < size:
        raise ValueError(f"{len(out)} bytes where {size} should be")
    return bytes(out[:size])
