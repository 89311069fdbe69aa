"""The voxels of a Zarr array: its chunks, none of which is unpacked beyond the size that it must have."""

from __future__ import annotations

import bz2
import itertools
import lzma
import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.ome_zarr.nodes import Node, joined_key, metadata_of, named
from mbstudio.core.scan.readers.ome_zarr.store import DOCUMENTS, ZarrFiles
from mbstudio.core.scan.readers.unpacking import inflated

_PACKERS = ("blosc", "bz2", "gzip", "lz4", "lzma", "zlib", "zstd")
_LZMA_MEMORY = 2**28
_MISSING = 2**64 - 1
_LARGEST_CHUNK = 2**33
# Empty chunks pack by so much at most; what claims more is no array of that size.
MOST_COMPRESSION = 30_000


class _Damage(Exception):
    """A chunk that is not what its array's description says; told with its name by `ZarrArray`."""


@dataclass(frozen=True)
class Codec:
    """How a chunk became bytes.

    Attributes
    ----------
    dtype : numpy dtype
        With the byte order of the bytes.
    turns : tuple of tuple of int
        Orders of axes, one applied after the other.
    packer : str or None
        By what the bytes were compressed.
    checked : bool
        Whether a checksum follows them.
    inner : Codec or None
        Of the chunks of a shard.
    inner_shape : tuple of int
    index_first, index_checked : bool
        Where a shard keeps the places of its chunks, and whether a checksum follows them.
    """

    dtype: np.dtype[Any]
    turns: tuple[tuple[int, ...], ...] = ()
    packer: str | None = None
    checked: bool = False
    inner: Codec | None = None
    inner_shape: tuple[int, ...] = ()
    index_first: bool = False
    index_checked: bool = True

    def place(self, data: bytes, shape: tuple[int, ...], out: np.ndarray, corner: Sequence[int]) -> None:
        """Write what a chunk holds into `out`, in which its first voxel lies at `corner`."""
        if self.inner is not None:
            self._place_shard(data, shape, out, corner)
            return
        block = self.decode(data, shape)
        mine = tuple(
            slice(max(-start, 0), max(min(count, total - start), 0))
            for start, count, total in zip(corner, shape, out.shape, strict=True)
        )
        its = tuple(
            slice(max(start, 0), max(min(start + count, total), 0))
            for start, count, total in zip(corner, shape, out.shape, strict=True)
        )
        out[its] = block[mine]

    def decode(self, data: bytes, shape: tuple[int, ...]) -> np.ndarray:
        """Return the voxels of a chunk."""
        size = math.prod(shape) * self.dtype.itemsize
        if self.checked:
            data = _checked(data)
        block = data if self.packer is None else _unpacked(data, self.packer, size)
        if len(block) != size:
            raise _Damage(f"{len(block):,} bytes where {size:,} should be")
        turned = list(shape)
        for turn in self.turns:
            turned = [turned[axis] for axis in turn]
        voxels = np.frombuffer(block, self.dtype).reshape(turned)
        for turn in reversed(self.turns):
            voxels = voxels.transpose(np.argsort(turn))
        return voxels

    def _place_shard(
        self, data: bytes, shape: tuple[int, ...], out: np.ndarray, corner: Sequence[int]
    ) -> None:
        assert self.inner is not None
        counts = tuple(whole // part for whole, part in zip(shape, self.inner_shape, strict=True))
        length = 16 * math.prod(counts) + (4 if self.index_checked else 0)
        if len(data) < length:
            raise _Damage(f"a shard of {len(data):,} bytes without its index")
        index = data[:length] if self.index_first else data[len(data) - length :]
        places = np.frombuffer(_checked(index) if self.index_checked else index, "<u8").reshape(*counts, 2)
        for cell in itertools.product(*(range(count) for count in counts)):
            start, size = (int(number) for number in places[cell])
            inner_corner = [
                at + step * count for at, step, count in zip(corner, cell, self.inner_shape, strict=True)
            ]
            if (start, size) == (_MISSING, _MISSING) or not _meets(inner_corner, self.inner_shape, out.shape):
                continue
            if start + size > len(data):
                raise _Damage("a shard whose index points behind its end")
            self.inner.place(data[start : start + size], self.inner_shape, out, inner_corner)


def _meets(corner: Sequence[int], shape: Sequence[int], total: Sequence[int]) -> bool:
    return all(at < whole and at + count > 0 for at, count, whole in zip(corner, shape, total, strict=True))


def _checked(data: bytes) -> bytes:
    """Return bytes without the checksum behind them, which must be right."""
    import google_crc32c

    if len(data) < 4 or google_crc32c.value(data[:-4]) != int.from_bytes(data[-4:], "little"):
        raise _Damage("a checksum that is wrong")
    return data[:-4]


def _unpacked(data: bytes, packer: str, size: int) -> bytes:
    """Unpack up to one byte more than there should be."""
    import imagecodecs

    if size > MOST_COMPRESSION * len(data) + 2**20:
        raise _Damage(f"{len(data):,} bytes, too few for {size:,}")
    try:
        if packer in ("gzip", "zlib"):
            return inflated(data, size, "zlib or gzip")
        if packer == "bz2":
            return bz2.BZ2Decompressor().decompress(data, size + 1)
        if packer == "lzma":
            return lzma.LZMADecompressor(memlimit=_LZMA_MEMORY).decompress(data, size + 1)
        if packer == "zstd":
            return bytes(imagecodecs.zstd_decode(data, out=size))
        if packer == "blosc":
            stated = [int.from_bytes(data[at : at + 4], "little") for at in (4, 12)]
            if stated != [size, len(data)]:
                raise _Damage("another size than it should have")
            # The second version reads what the first wrote, and does not crash where it is damaged.
            return bytes(imagecodecs.blosc2_decode(data, out=size))
        if len(data) < 4 or int.from_bytes(data[:4], "little") != size:  # as numcodecs writes LZ4
            raise _Damage("another size than it should have")
        return bytes(imagecodecs.lz4_decode(data[4:], out=size))
    except (RuntimeError, ValueError, OSError, EOFError, zlib.error, lzma.LZMAError) as error:
        raise _Damage(f"what {packer} cannot unpack: {error}") from error


class ZarrArray:
    """An array whose voxels are read when they are asked for.

    Parameters
    ----------
    files : ZarrFiles
    node : Node

    Attributes
    ----------
    shape, dtype, chunks
        As numpy has them; chunks are those that are packed by themselves.
    stored : int
        Bytes of all chunks that are there.
    files, missing : int
        How many files of chunks there should be, and how many are not there: such voxels have the fill value.

    Raises
    ------
    ScanError
        If zarr does not understand the array's description, or it is packed in a way not read here.
    """

    def __init__(self, files: ZarrFiles, node: Node) -> None:
        self.name = named(files, node.key)
        self._store, self._node = files, node
        metadata, dtype, self._outer = metadata_of(node, files)
        self._key_of = metadata.encode_chunk_key
        self._fill = metadata.fill_value
        self.shape = node.shape
        if dtype.kind not in "buif":
            raise ScanError(
                f"{self.name} holds values of type {dtype}: export grey values as integers or real numbers."
            )
        facts = metadata.to_dict()
        self._codec = (
            self._codec_of_2(facts, dtype) if node.format == 2 else self._codec_of_3(facts["codecs"], dtype)
        )
        self.dtype = dtype.newbyteorder("=")
        self.chunks = self._codec.inner_shape or self._outer
        if math.prod(self.chunks) * dtype.itemsize > _LARGEST_CHUNK:
            raise ScanError(
                f"{self.name} has chunks of {self.chunks} voxels, too large to unpack: save it anew."
            )
        self.files, self.stored, self.missing = self._found()

    def _found(self) -> tuple[int, int, int]:
        """Return how many chunks there should be, the bytes of those that are there, and how many are not."""
        grid = [-(-count // chunk) for count, chunk in zip(self.shape, self._outer, strict=True)]
        total, stored, found = math.prod(grid), 0, 0
        if total <= 4096:
            sizes = [self._store.size(joined_key(self._node.key, key)) for key in self._keys(grid)]
            present = [size for size in sizes if size is not None]
            return total, sum(present), total - len(present)
        for name, size in self._store.within(self._node.key):
            if name.rpartition("/")[2] not in DOCUMENTS:
                found, stored = found + 1, stored + size
        return total, stored, max(total - found, 0)

    def _keys(self, grid: Sequence[int]) -> Iterator[str]:
        return (self._key_of(cell) for cell in itertools.product(*(range(count) for count in grid)))

    def read(self, start: Sequence[int], stop: Sequence[int]) -> np.ndarray:
        """Return the voxels from one corner to before another.

        Raises
        ------
        ScanError
            If a chunk is damaged, or cannot be read.
        """
        shape = tuple(last - first for first, last in zip(start, stop, strict=True))
        out = np.empty(shape, self.dtype)
        if self.missing or self._codec.inner is not None:
            out[...] = self.filler
        ranges = [
            range(first // chunk, -(-last // chunk))
            for first, last, chunk in zip(start, stop, self._outer, strict=True)
        ]
        for cell in itertools.product(*ranges):
            key = self._key_of(cell)
            data = self._chunk(joined_key(self._node.key, key))
            if data is None:
                continue
            corner = [at * chunk - first for at, chunk, first in zip(cell, self._outer, start, strict=True)]
            try:
                self._codec.place(data, self._outer, out, corner)
            except _Damage as error:
                raise ScanError(
                    f"{self.name} holds in its chunk {key} {error}: it is damaged or cut off; copy "
                    "or export it again."
                ) from error
        return out

    @property
    def filler(self) -> Any:
        """What stands where chunks are missing."""
        if self._fill is None:
            raise ScanError(
                f"{self.name} lacks chunks and does not say what stands there (fill_value): copy all of it."
            )
        return self._fill

    def _chunk(self, key: str) -> bytes | None:
        """Return a chunk's bytes; ScanError if there are more than any chunk of its size packs into."""
        size = self._store.size(key)
        if size is None:
            if not self.missing:
                raise ScanError(f"{self.name} has lost its chunk {key} since it was opened: open it again.")
            return None
        largest = 2 * math.prod(self._outer) * self.dtype.itemsize + 2**20
        if size > largest:
            raise ScanError(
                f"{self.name} holds {size:,} bytes in its chunk {key}, more than its voxels need: "
                "it is damaged; "
                "copy or export it again."
            )
        try:
            return self._store.read(key)
        except OSError as error:
            raise ScanError(f"{self.name} cannot be read ({error}): check that you may read it.") from error

    # How chunks became bytes -------------------------------------------------------------------------

    def _codec_of_2(self, facts: Mapping[str, Any], dtype: np.dtype[Any]) -> Codec:
        """Return the codec of an array of format 2."""
        for one in facts.get("filters") or ():
            raise self._unread(_name_of(one))
        compressor = facts.get("compressor")
        turns = (tuple(reversed(range(len(self.shape)))),) if facts.get("order") == "F" else ()
        if compressor is None:
            return Codec(dtype, turns)
        name = _name_of(compressor)
        if name not in _PACKERS:
            raise self._unread(name)
        return Codec(dtype, turns, name)

    def _codec_of_3(self, codecs: Sequence[Mapping[str, Any]], dtype: np.dtype[Any]) -> Codec:
        """Return the codec of an array, or of the chunks of a shard, of format 3."""
        turns: list[tuple[int, ...]] = []
        packer: str | None = None
        shard: Mapping[str, Any] | None = None
        checked = is_bytes = False
        for one in codecs:
            name, setting = _name_of(one), one.get("configuration") or {}
            if name == "transpose" and not is_bytes:
                turns.append(tuple(int(axis) for axis in setting["order"]))
            elif name == "bytes" and not is_bytes:
                is_bytes, dtype = True, dtype.newbyteorder(">" if setting.get("endian") == "big" else "<")
            elif name == "sharding_indexed" and not is_bytes and not turns:
                is_bytes, shard = True, setting
            elif name in _PACKERS and is_bytes and packer is None and shard is None and not checked:
                packer = name
            elif name == "crc32c" and is_bytes and shard is None and not checked:
                checked = True
            else:
                raise self._unread(name)
        if shard is None:
            return Codec(dtype, tuple(turns), packer, checked)
        inner_shape = tuple(int(count) for count in shard["chunk_shape"])
        outer = self._outer
        if len(inner_shape) != len(outer) or any(
            part < 1 or whole % part for whole, part in zip(outer, inner_shape, strict=True)
        ):
            raise ScanError(f"{self.name} has shards that its chunks do not divide: export it again.")
        index = [_name_of(one) for one in shard["index_codecs"]]
        if index not in (["bytes"], ["bytes", "crc32c"]):
            raise self._unread(" and ".join(index))
        if str(shard["index_codecs"][0].get("configuration", {}).get("endian", "little")) != "little":
            raise self._unread("a big-endian index of shards")
        inner = self._codec_of_3(shard["codecs"], dtype)
        if inner.inner is not None:
            raise self._unread("shards within shards")
        first = str(shard.get("index_location", "end")) == "start"
        return Codec(
            dtype, inner=inner, inner_shape=inner_shape, index_first=first, index_checked=len(index) == 2
        )

    def _unread(self, name: str) -> ScanError:
        return ScanError(
            f"{self.name} is packed by '{name}' in a way that is not read here: "
            f"save it uncompressed, or by one of {', '.join(_PACKERS)}."
        )


def _name_of(codec: Any) -> str:
    """Return the name of a codec in either format; numcodecs' own stand in format 3 behind its name."""
    facts = codec if isinstance(codec, Mapping) else codec.get_config()
    return str(facts.get("name") or facts.get("id")).removeprefix("numcodecs.")
