"""The numbers of an array of a VTK image: text, base64 or raw, packed in blocks or not."""

from __future__ import annotations

import binascii
import lzma
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.unpacking import inflated
from mbstudio.core.scan.readers.vtk_image.layout import Layout, StoredArray

_TYPES = {
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4",
    "Int64": "i8", "UInt64": "u8", "Float32": "f4", "Float64": "f8",
}  # fmt: skip
_PACKERS = {"vtkZLibDataCompressor": "zlib", "vtkLZ4DataCompressor": "lz4", "vtkLZMADataCompressor": "lzma"}
_LZMA_MEMORY = 2**28
_BLANKS = b" \t\r\n"


class _Damage(Exception):
    """What is stored is not what the XML says."""


class _Bytes:
    """Bytes one after the other, raw or in base64, none of them beyond the end.

    Parameters
    ----------
    stored : uint8 array
    encoding : str
    """

    def __init__(self, stored: np.ndarray, encoding: str) -> None:
        self._stored, self._place = stored, 0
        self._is_raw = encoding == "raw"
        self._rest = b""

    def take(self, count: int) -> bytes:
        """Return so many bytes."""
        if self._is_raw:
            self._place += count
            if self._place > len(self._stored):
                raise _Damage("ends too early")
            return bytes(self._stored[self._place - count : self._place])
        missing = count - len(self._rest)
        if missing > 0:
            letters = -(-missing // 3) * 4
            text = bytes(self._stored[self._place : self._place + letters])
            self._place += letters
            try:
                block = binascii.a2b_base64(text, strict_mode=True)
            except binascii.Error as error:
                raise _Damage(f"holds something that is not base64 ({error})") from error
            # A group that is filled up ends what was encoded by itself; what follows begins anew.
            ends = text.endswith(b"=")
            block, self._rest = self._rest + block, b""
            if len(block) < count:
                raise _Damage("ends too early")
            if not ends:
                self._rest = block[count:]
            return block[:count]
        taken, self._rest = self._rest[:count], self._rest[count:]
        return taken


def type_of(layout: Layout, array: StoredArray, path: Path) -> np.dtype[Any]:
    """Return the type of an array's numbers.

    Raises
    ------
    ScanError
        If they are no numbers.
    """
    order = ">" if layout.file.get("byte_order", "LittleEndian") == "BigEndian" else "<"
    kind = array.attributes.get("type", "")
    if kind not in _TYPES:
        raise ScanError(
            f"{path} holds values of type {kind} in '{array.name}': save them as numbers of whole bytes."
        )
    return np.dtype(order + _TYPES[kind])


def numbers_of(layout: Layout, array: StoredArray, count: int, path: Path) -> np.ndarray:
    """Return the numbers of an array, mapped where they lie in the file as they are.

    Raises
    ------
    ScanError
        If they are not as many as the XML says, or damaged.
    """
    dtype = type_of(layout, array, path)
    try:
        return _numbers(layout, array, count, dtype, path)
    except _Damage as error:
        raise ScanError(
            f"{path} {error} in its array '{array.name}': it is damaged or cut off; copy or export it again."
        ) from error


def _numbers(layout: Layout, array: StoredArray, count: int, dtype: np.dtype[Any], path: Path) -> np.ndarray:
    form = array.attributes.get("format", "ascii")
    size = count * dtype.itemsize
    file = np.memmap(path, np.uint8, "r")
    if form == "ascii":
        return _from_text(bytes(file[array.begin : array.end]), count, dtype)
    if form == "appended":
        offset = _offset(array, path)
        start = layout.appended + offset
        if not layout.appended or start >= len(file):
            raise _Damage("has no data")
        stored, encoding = file[start:], layout.appended_encoding
    elif form == "binary":
        inline = bytes(file[array.begin : array.end]).translate(None, _BLANKS)
        stored, encoding = np.frombuffer(inline, np.uint8), "base64"
    else:
        raise ScanError(
            f"{path} stores its array '{array.name}' in the unknown format '{form}': export it again."
        )
    if encoding not in ("raw", "base64"):
        raise ScanError(f"{path} stores its data in the unknown encoding '{encoding}': export it again.")
    header = _header_type(layout, path)
    source = _Bytes(stored, encoding)
    compressor = layout.file.get("compressor")
    if compressor:
        if compressor not in _PACKERS:
            raise ScanError(
                f"{path} is packed by '{compressor}', which is not read here: save it uncompressed."
            )
        return np.frombuffer(_unpacked(source, header, size, _PACKERS[compressor]), dtype)
    length = int(np.frombuffer(source.take(header.itemsize), header)[0])
    if length != size:
        raise _Damage(f"states {length:,} bytes where {size:,} should be")
    if encoding == "raw":
        begin = start + header.itemsize
        if begin + size > len(file):
            raise _Damage("ends too early")
        return np.memmap(path, dtype, "r", begin, count)
    if size > len(stored):
        raise _Damage("ends too early")
    return np.frombuffer(source.take(size), dtype)


def _offset(array: StoredArray, path: Path) -> int:
    text = array.attributes.get("offset", "0")
    if not text.isascii() or not text.isdigit() or len(text) > 18:
        raise ScanError(
            f"{path} does not say where its array '{array.name}' lies (offset={text[:40]}): export it again."
        )
    return int(text)


def _header_type(layout: Layout, path: Path) -> np.dtype[Any]:
    kind = layout.file.get("header_type", "UInt32")
    if kind not in ("UInt32", "UInt64"):
        raise ScanError(f"{path} has headers of the unknown type '{kind}': export it again.")
    order = ">" if layout.file.get("byte_order", "LittleEndian") == "BigEndian" else "<"
    return np.dtype(order + _TYPES[kind])


def _from_text(text: bytes, count: int, dtype: np.dtype[Any]) -> np.ndarray:
    """Return numbers that are written out."""
    if len(text) < 2 * count - 1:
        raise _Damage(f"holds {len(text):,} letters, too few for {count:,} numbers")
    wide = np.float64 if dtype.kind == "f" else np.uint64 if dtype == np.uint64 else np.int64
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            numbers = np.fromstring(text.decode("ascii"), wide, sep=" ")
    except (ValueError, DeprecationWarning, OverflowError, RuntimeWarning) as error:
        raise _Damage(f"holds something that is not a number ({error})") from error
    if len(numbers) != count:
        raise _Damage(f"holds {len(numbers):,} numbers where {count:,} should be")
    if (
        dtype.kind != "f"
        and count
        and not (int(numbers.min()) >= np.iinfo(dtype).min and int(numbers.max()) <= np.iinfo(dtype).max)
    ):
        raise _Damage(f"holds numbers that are none of {dtype.name}")
    with np.errstate(over="ignore"):
        return numbers.astype(dtype.newbyteorder("="))


def _unpacked(source: _Bytes, header: np.dtype[Any], size: int, packer: str) -> bytes:
    """Unpack blocks, each up to the size that it must have."""
    blocks, block, last = (int(part) for part in np.frombuffer(source.take(3 * header.itemsize), header))
    full = blocks - (1 if last else 0)
    if blocks < 1 or blocks > max(size, 1) or full * block + last != size:
        raise _Damage(f"states {blocks:,} blocks of {block:,} bytes where {size:,} bytes should be in all")
    lengths = np.frombuffer(source.take(blocks * header.itemsize), header).astype(object)
    out = bytearray()
    # In base64 all blocks are encoded as one.
    for index, length in enumerate(lengths):
        wanted = last if last and index == blocks - 1 else block
        packed = source.take(int(length)) if int(length) <= 2 * wanted + 4096 else b""
        try:
            part = _unpack(packed, packer, wanted)
        except (RuntimeError, ValueError, EOFError, zlib.error, lzma.LZMAError) as error:
            raise _Damage(f"holds a block that {packer} cannot unpack ({error})") from error
        if len(part) != wanted:
            raise _Damage(f"holds a block of {len(part):,} bytes where {wanted:,} should be")
        out += part
    return bytes(out)


def _unpack(packed: bytes, packer: str, size: int) -> bytes:
    """Unpack up to one byte more than there should be."""
    import imagecodecs

    if packer == "zlib":
        return inflated(packed, size, "zlib")
    if packer == "lzma":
        return lzma.LZMADecompressor(memlimit=_LZMA_MEMORY).decompress(packed, size + 1)
    if size > 256 * len(packed) + 64:
        raise ValueError("too few bytes")
    return bytes(imagecodecs.lz4_decode(packed, out=size))
