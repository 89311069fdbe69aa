"""Reads an HDF5 file that nobody vouches for, in a process of its own.

HDF5 can loop for ever on a file made to harm, take any amount of memory or end the process. So this file is
also a program: :mod:`mbstudio.core.project.stored_reading` starts it with the project file as its standard
input, bounds its memory and time, and takes what it writes to its standard output:

1. the attributes of the root as one JSON text,
2. the groups and datasets that there are as one JSON text,
3. of every dataset that is wanted, in that order, the blocks of `blocks`: numbers as bytes, texts as JSON,
4. the four bytes ``END.``.

JSON comes after its length in eight bytes. The program imports nothing of mbstudio, so that it starts within
a fifth of a second.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import math
import sys
from collections.abc import Iterator
from typing import Any, BinaryIO

import h5py
import numpy as np

END = b"END."
REFUSED = 3
"""Exit code of the program where the file is refused; the reason is on its standard error."""

_OBJECTS = 10_000
_DEPTH = 8
_NAME = 200
_AXES = 4
_ATTRIBUTE_BYTES = 64 * 1024
_BLOCK_BYTES = 4 * 2**20
_TEXTS_A_BLOCK = 1024
# Deflate, which alone makes data smaller, does not pack better than this.
_BEST_PACKING = 1032
# A text is kept as its length and its place.
_TEXT_BYTES = 16
_FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}
_MEMORY = 2**30
_SECONDS = 1200


class RefusedError(Exception):
    """Something in the file that mbstudio never writes; the message says what."""


def blocks(shape: tuple[int, ...], chunks: tuple[int, ...] | None, item: int) -> Iterator[tuple[slice, ...]]:
    """Yield the parts of a dataset in the order in which they are read: chunks, or some rows at a time.

    `item` is the length of one value in bytes, 0 for texts.
    """
    if math.prod(shape) == 0:
        return
    if chunks is None:
        row = math.prod(shape[1:]) * item
        step = _TEXTS_A_BLOCK if item == 0 else max(1, _BLOCK_BYTES // row)
        chunks = (step, *shape[1:])[: len(shape)]
    axes = [
        [slice(start, min(start + step, length)) for start in range(0, length, step)]
        for length, step in zip(shape, chunks, strict=True)
    ]
    yield from itertools.product(*axes)


class Walk:
    """One way through a file: its groups and datasets first, then what they hold."""

    def __init__(self, file: h5py.File, length: int) -> None:
        self._file, self._length = file, length
        self._seen: set[int] = set()
        self._declared = 0
        self._texts = 0
        self.groups: dict[str, Any] = {}
        self.arrays: dict[str, Any] = {}

    def look_around(self) -> None:
        """List all groups and datasets with their attributes; no data are read yet."""
        self._enter(self._file["/"], "", 0)

    def read(self, name: str) -> Iterator[bytes | memoryview]:
        """Yield the blocks of a dataset as they are sent."""
        dataset, about = self._file[name], self.arrays[name]
        shape, texts = tuple(about["shape"]), about["dtype"] is None
        chunks = None if about["chunks"] is None else tuple(about["chunks"])
        item = 0 if texts else np.dtype(about["dtype"]).itemsize
        for part in blocks(shape, chunks, item):
            if not texts:
                yield np.ascontiguousarray(dataset[part]).reshape(-1).view(np.uint8).data
                continue
            found = np.asarray(dataset.asstr()[part], dtype=object).ravel().tolist()
            # Many places can point at one long text: together they cannot be longer than the file.
            self._texts += sum(map(len, found))
            if self._texts > self._length:
                raise RefusedError("its texts are longer than the whole file")
            yield packed(found)

    def _enter(self, group: h5py.Group, path: str, depth: int) -> None:
        if depth > _DEPTH:
            raise RefusedError(f"its groups lie more than {_DEPTH} deep")
        self._note(group, path)
        self.groups[path] = self._attributes(group, path)
        for name in group:
            if not isinstance(name, str) or not 0 < len(name) <= _NAME or not name.isprintable():
                raise RefusedError(f"a part of {path or 'it'} has an impossible name")
            place = f"{path}/{name}".lstrip("/")
            kind = group.id.links.get_info(name.encode("utf-8", "surrogateescape")).type
            if kind != h5py.h5l.TYPE_HARD:
                words = {h5py.h5l.TYPE_SOFT: "a soft link", h5py.h5l.TYPE_EXTERNAL: "a link to another file"}
                raise RefusedError(f"{place} is {words.get(kind, 'a link of an unknown kind')}")
            part = group[name]
            if isinstance(part, h5py.Group):
                self._enter(part, place, depth + 1)
            elif isinstance(part, h5py.Dataset):
                self._note(part, place)
                self.arrays[place] = self._declaration(part, place)
            else:
                raise RefusedError(f"{place} is neither a group nor a dataset")

    def _note(self, part: h5py.Group | h5py.Dataset, path: str) -> None:
        address = h5py.h5o.get_info(part.id).addr
        if address in self._seen:
            raise RefusedError(f"{path} is another name of something else in it")
        self._seen.add(address)
        if len(self._seen) > _OBJECTS:
            raise RefusedError(f"it has more than {_OBJECTS} parts")

    def _attributes(self, part: h5py.Group | h5py.Dataset, path: str) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name in part.attrs:
            attribute = part.attrs.get_id(name)
            if attribute.get_space().get_simple_extent_type() == h5py.h5s.NULL:
                found[name] = None
                continue
            dtype = _kind_of(attribute.dtype, f"attribute {name} of {path or 'the root'}")
            item = _TEXT_BYTES if dtype is None else dtype.itemsize
            if math.prod(attribute.shape) * item > _ATTRIBUTE_BYTES:
                raise RefusedError(f"attribute {name} of {path or 'the root'} is too long")
            value = part.attrs[name]
            found[name] = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        return found

    def _declaration(self, dataset: h5py.Dataset, path: str) -> dict[str, Any]:
        dtype = _kind_of(dataset.dtype, path)
        shape = tuple(map(int, dataset.shape or ()))
        if dataset.shape is None or len(shape) > _AXES:
            raise RefusedError(f"{path} has {'no shape' if dataset.shape is None else 'too many axes'}")
        stored = dataset.id.get_create_plist()
        if stored.get_external_count():
            raise RefusedError(f"{path} keeps its data in another file")
        if stored.get_layout() not in (h5py.h5d.CONTIGUOUS, h5py.h5d.CHUNKED, h5py.h5d.COMPACT):
            raise RefusedError(f"{path} is put together from other datasets")
        filters = [stored.get_filter(index)[0] for index in range(stored.get_nfilters())]
        if not _FILTERS.issuperset(filters) or len(set(filters)) < len(filters):
            raise RefusedError(f"{path} is packed in a way that mbstudio never uses")
        size = math.prod(shape) * (_TEXT_BYTES if dtype is None else dtype.itemsize)
        self._declared += size
        if self._declared > _BEST_PACKING * self._length:
            raise RefusedError(
                f"with {path} it claims to hold {self._declared / 2**20:,.0f} MiB, which no file of "
                f"{self._length / 2**20:,.2f} MiB can"
            )
        self._require_complete(dataset, path, shape, size)
        return {
            "dtype": None if dtype is None else dtype.str,
            "shape": shape,
            "chunks": dataset.chunks,
            "attributes": self._attributes(dataset, path),
        }

    def _require_complete(self, dataset: h5py.Dataset, path: str, shape: tuple[int, ...], size: int) -> None:
        """Refuse a dataset of which some was never stored: HDF5 would fill it in, whatever its size."""
        if dataset.chunks is None:
            complete = dataset.id.get_storage_size() == size
        else:
            pairs = list(zip(shape, dataset.chunks, strict=True))
            wanted = math.prod(-(-length // step) for length, step in pairs)
            fits = all(step <= max(length, 1) for length, step in pairs)
            complete = fits and dataset.id.get_num_chunks() == wanted
        if not complete:
            raise RefusedError(f"{path} does not hold all that it claims to")


def _kind_of(dtype: np.dtype[Any], place: str) -> np.dtype[Any] | None:
    """Return the type of numbers or truth values, None for texts; refuse all others."""
    if h5py.check_string_dtype(dtype) is not None:
        return None
    if dtype.kind not in "biuf" or dtype.itemsize > 8 or h5py.check_vlen_dtype(dtype) is not None:
        raise RefusedError(f"{place} holds neither numbers nor texts")
    return dtype


def packed(value: Any) -> bytes:
    """Return a value as JSON after its length in eight bytes."""
    content = json.dumps(value).encode("ascii")
    return len(content).to_bytes(8, "big") + content


def walk(stream: BinaryIO, wanted: str) -> Iterator[bytes | memoryview]:
    """Yield what is sent of a file.

    Parameters
    ----------
    stream : binary stream
    wanted : str
        A dataset, or with a minus sign before it all datasets but this one.

    Raises
    ------
    RefusedError
        If the file holds something that mbstudio never writes.
    """
    length = stream.seek(0, io.SEEK_END)
    stream.seek(0)
    with h5py.File(stream, "r") as file:
        way = Walk(file, length)
        yield packed(way._attributes(file["/"], ""))
        way.look_around()
        if wanted.startswith("-"):
            names = [name for name in way.arrays if name != wanted[1:]]
        else:
            names = [name for name in way.arrays if name == wanted]
        yield packed({"groups": way.groups, "arrays": way.arrays, "wanted": names})
        for name in names:
            yield from way.read(name)
    yield END


def _bound_this_process() -> None:
    """Take no more memory and time than reading a block at a time needs; write no file."""
    try:
        import resource
    except ImportError:  # Windows: the process that started this one bounds the time
        return
    for kind, bound in (
        (resource.RLIMIT_AS, _MEMORY), (resource.RLIMIT_CPU, _SECONDS), (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):  # fmt: skip
        hard = resource.getrlimit(kind)[1]
        # macOS refuses a bound on memory; time and claims of size are bounded all the same.
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(kind, (bound if hard == resource.RLIM_INFINITY else min(bound, hard), hard))


def main() -> int:
    """Send the file on standard input to standard output; return the exit code."""
    _bound_this_process()
    try:
        with open(0, "rb", closefd=False) as stream:
            for piece in walk(stream, sys.argv[1]):
                sys.stdout.buffer.write(piece)
            sys.stdout.buffer.flush()
    except MemoryError:
        print("reading it takes more memory than any project needs", file=sys.stderr)
        return REFUSED
    except Exception as error:  # whatever a damaged file leads to, it is refused
        print(str(error)[:500] or type(error).__name__, file=sys.stderr)
        return REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main())
