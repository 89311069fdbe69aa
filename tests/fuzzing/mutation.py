"""Files with something wrong in them: flipped bits, cut ends, headers that lie, and packed bombs.

Besides bytes it knows what numbers, lines, JSON, tables, gzip and ZIP look like, so that damage gets past the
first check of a format: a packed file is unpacked, damaged, and packed again with checksums that fit.
"""

from __future__ import annotations

import gzip
import io
import json
import re
import warnings
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

# What is put into files beside random bytes: numbers at the edge, and signs that formats use.
_WORDS = (
    b"0",
    b"-1",
    b"65535",
    b"2147483647",
    b"4294967296",
    b"99999999999",
    b"99999999999999999999",
    b"1e308",
    b"1e999",
    b"nan",
    b"-inf",
    b"null",
    b'""',
    b"\xff\xff\xff\xff",
    b"\0\0\0\0",
    b"\x7f\xff\xff\xff",
    b"%s",
    b"%n%n",
    b"%09999999d",
    b"../",
    b"/etc/passwd",
    b"=",
    b"{",
    b"}",
    b"@1",
    b"\n",
    b"\r",
    b" ",
    b"[",
    b"]",
    b"\xc2\xb5",
    b"1" * 400,
    b"9" * 5000,
    b"\x80\0\0\0\0\0\0\0",
    b"LIST",
    b"LOCAL",
    b"-",
    b"\0",
    b",",
    b";",
    b"[" * 3000,
    b'{"a":' * 3000,
    b"<a>" * 2000,
    b"\x93NUMPY",
    b"PK\x03\x04",
)
_NUMBERS = (
    0,
    1,
    2,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0x8000,
    0xFFFF,
    0x10000,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    0x100000000,
    0x7FFFFFFFFFFFFFFF,
    0xFFFFFFFFFFFFFFFF,
)
_VALUES = (
    None,
    True,
    False,
    0,
    -1,
    1,
    2.5,
    1e308,
    float("nan"),
    float("inf"),
    -float("inf"),
    10**30,
    -(10**400),
    "",
    "abc",
    "nan",
    "1",
    "../../x",
    "\0",
    "µ" * 50,
    [],
    {},
    [None],
    [[]],
    [1, 2, 3],
    {"a": 1},
    "x" * 20_000,
)
_CELLS = (
    "",
    "abc",
    "nan",
    "inf",
    "-inf",
    "1e999",
    "1.5",
    "-1",
    "9" * 400,
    '"',
    "=1+1",
    "True",
    "\0",
    "µ",
    " ",
)
_HEADER = 600
"""Headers are where things go wrong: half of all damage is among the first bytes."""


def mutate(content: bytes, rng: np.random.Generator) -> bytes:
    """Return a file's content with one to four things wrong."""
    data = _mutate_as_what_it_is(content, rng) if rng.random() < 0.4 else None
    if data is not None and rng.random() < 0.8:
        return data
    changed = bytearray(content if data is None else data)
    for _ in range(int(rng.integers(1, 5))):
        if changed:
            _BYTES[int(rng.integers(len(_BYTES)))](changed, _place(changed, rng), rng)
    return bytes(changed)


def flip_one_bit(content: bytes, rng: np.random.Generator) -> bytes:
    """Return a file's content with one bit flipped."""
    changed = bytearray(content)
    changed[int(rng.integers(len(changed)))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


# ---- bytes -------------------------------------------------------------------------------------------


def _place(data: bytearray, rng: np.random.Generator) -> int:
    return int(rng.integers(len(data) if rng.random() < 0.5 else min(len(data), _HEADER)))


def _flip(data: bytearray, place: int, rng: np.random.Generator) -> None:
    data[place] ^= 1 << int(rng.integers(8))


def _set(data: bytearray, place: int, rng: np.random.Generator) -> None:
    data[place] = int(rng.integers(256))


def _write_number(data: bytearray, place: int, rng: np.random.Generator) -> None:
    size = int(rng.choice([1, 2, 4, 8]))
    number = _NUMBERS[int(rng.integers(len(_NUMBERS)))] & (256**size - 1)
    data[place : place + size] = number.to_bytes(size, "little" if rng.random() < 0.5 else "big")


def _cut_off(data: bytearray, place: int, rng: np.random.Generator) -> None:
    del data[place:]


def _take_out(data: bytearray, place: int, rng: np.random.Generator) -> None:
    del data[place : place + int(rng.integers(1, 64))]


def _double(data: bytearray, place: int, rng: np.random.Generator) -> None:
    other = int(rng.integers(len(data)))
    data[place:place] = data[other : other + int(rng.integers(1, 64))]


def _put_word(data: bytearray, place: int, rng: np.random.Generator) -> None:
    data[place:place] = _WORDS[int(rng.integers(len(_WORDS)))]


def _overwrite(data: bytearray, place: int, rng: np.random.Generator) -> None:
    word = _WORDS[int(rng.integers(len(_WORDS)))]
    data[place : place + len(word)] = word


def _replace_number(data: bytearray, place: int, rng: np.random.Generator) -> None:
    """Put a word in the place of decimal digits, as of a size in a header of text."""
    found = re.search(rb"[-+.\d]+", bytes(data[place : place + 400]))
    if found:
        data[place + found.start() : place + found.end()] = _WORDS[int(rng.integers(len(_WORDS)))]


def _shuffle_lines(data: bytearray, place: int, rng: np.random.Generator) -> None:
    """Exchange, double or drop lines, or parts of binary files between the same bytes."""
    lines = bytes(data).split(b"\n")
    one, other = (int(rng.integers(len(lines))) for _ in range(2))
    kind = rng.integers(3)
    if kind == 0:
        lines[one], lines[other] = lines[other], lines[one]
    elif kind == 1:
        lines.insert(one, lines[other])
    else:
        del lines[one]
    data[:] = b"\n".join(lines)


def _exchange_keys(data: bytearray, place: int, rng: np.random.Generator) -> None:
    """Exchange two words."""
    words = list(re.finditer(rb"[A-Za-z_]{3,}", bytes(data[: 4 * _HEADER])))
    if len(words) > 1:
        one, other = sorted(rng.choice(len(words), 2, replace=False))
        first, second = words[one], words[other]
        data[second.start() : second.end()] = first[0]
        data[first.start() : first.end()] = second[0]


def _add_much(data: bytearray, place: int, rng: np.random.Generator) -> None:
    data[place:place] = bytes([int(rng.integers(256))]) * int(rng.choice([1000, 100_000]))


_BYTES: tuple[Callable[[bytearray, int, np.random.Generator], None], ...] = (
    _flip,
    _set,
    _write_number,
    _write_number,
    _cut_off,
    _take_out,
    _double,
    _put_word,
    _overwrite,
    _replace_number,
    _replace_number,
    _shuffle_lines,
    _exchange_keys,
    _add_much,
)


# ---- what a file is ----------------------------------------------------------------------------------


def _mutate_as_what_it_is(content: bytes, rng: np.random.Generator) -> bytes | None:
    """Return content damaged in its own terms; None where its kind is not known."""
    try:
        if content.startswith(b"\x1f\x8b"):
            return _pack_again(content, rng)
        if content.startswith(b"PK"):
            return _zip_again(content, rng)
        if content.lstrip()[:1] in (b"{", b"["):
            return _json_again(content, rng)
        if b"," in content.partition(b"\n")[0] and content.isascii():
            return _table_again(content, rng)
    except (
        ValueError,
        OSError,
        EOFError,
        zlib.error,
        zipfile.BadZipFile,
        RecursionError,
        NotImplementedError,
    ):
        return None
    return None


def _pack_again(content: bytes, rng: np.random.Generator) -> bytes:
    inner = gzip.decompress(content)
    kind = rng.integers(4)
    if kind == 0:
        inner = inner[: len(inner) // 2]
    elif kind == 1:  # more than was declared, of next to no size
        inner += bytes(50_000_000)
    elif kind == 2:
        return gzip.compress(inner, 1) + gzip.compress(inner, 1)
    else:
        inner = mutate(inner, rng)
    return gzip.compress(inner, 1)


def _zip_again(content: bytes, rng: np.random.Generator) -> bytes:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    names = list(members)
    chosen = names[int(rng.integers(len(names)))]
    kind = rng.integers(6)
    if kind == 0:
        del members[chosen]
    elif kind == 1:
        members[chosen], members[names[0]] = members[names[0]], members[chosen]
    elif kind == 2:  # an array that unpacks to 8 GB if its header is believed
        members[chosen] = _array_header((10**9,), "<f8") + bytes(1000)
    elif kind == 3:
        members[chosen] = _array_header((5, 10**6), "<f8") + bytes(40 * 10**6)
    elif kind == 4:
        members["../../" + chosen] = members.pop(chosen)
    else:
        members[chosen] = mutate(members[chosen], rng)
    stream = io.BytesIO()
    with (
        warnings.catch_warnings(),
        zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
    ):
        warnings.simplefilter("ignore")
        for name, inner in members.items():
            archive.writestr(name, inner)
        if kind == 5 and rng.random() < 0.2:
            archive.writestr(chosen, members[chosen])  # the same name twice
    return stream.getvalue()


def _array_header(shape: tuple[int, ...], kind: str) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": kind, "fortran_order": False, "shape": shape})
    return stream.getvalue()


def _json_again(content: bytes, rng: np.random.Generator) -> bytes:
    tree = json.loads(content)
    places = list(_places(tree))
    if not places:
        return json.dumps(_VALUES[int(rng.integers(len(_VALUES)))]).encode()
    for _ in range(int(rng.integers(1, 3))):
        holder, key = places[int(rng.integers(len(places)))]
        kind = rng.integers(5)
        if isinstance(holder, dict) and key not in holder:
            continue
        if isinstance(holder, list) and key >= len(holder):
            continue
        if kind == 0:
            del holder[key]
        elif kind == 1:
            other_holder, other_key = places[int(rng.integers(len(places)))]
            holder[key] = json.loads(
                json.dumps(dict(enumerate([0])) if other_holder is holder else other_key)
            )
        elif kind == 2:
            value: Any = 1
            for _ in range(int(rng.choice([3, 500]))):
                value = [value]
            holder[key] = value
        else:
            holder[key] = _VALUES[int(rng.integers(len(_VALUES)))]
    text = json.dumps(tree)
    if rng.random() < 0.05:
        text = text[:-1] + "," + text[1:]  # every key twice
    return text.encode()


def _places(tree: Any, depth: int = 0) -> Any:
    """Yield holder and key of the values of a JSON tree, some of those of long lists."""
    if depth > 20:
        return
    keys = (
        list(tree)
        if isinstance(tree, dict)
        else list(range(min(len(tree), 6)))
        if isinstance(tree, list)
        else []
    )
    for key in keys:
        yield tree, key
        yield from _places(tree[key], depth + 1)


def _table_again(content: bytes, rng: np.random.Generator) -> bytes:
    rows = [line.split(",") for line in content.decode("ascii").split("\n")]
    row = int(rng.integers(len(rows) if rng.random() < 0.5 else min(len(rows), 2)))
    column = int(rng.integers(len(rows[row])))
    kind = rng.integers(7)
    if kind == 0:
        for cells in rows:
            del cells[column : column + 1]
    elif kind == 1:
        rows[row] = rows[row][:column]
    elif kind == 2:
        rows.insert(row, list(rows[int(rng.integers(len(rows)))]))
    elif kind == 3:
        del rows[row]
    elif kind == 4 and len(rows[row]) > 1:
        other = int(rng.integers(len(rows[row])))
        rows[row][column], rows[row][other] = rows[row][other], rows[row][column]
    else:
        rows[row][column] = _CELLS[int(rng.integers(len(_CELLS)))]
    return "\n".join(",".join(cells) for cells in rows).encode()
