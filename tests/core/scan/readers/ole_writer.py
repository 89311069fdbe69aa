"""Writes OLE compound files, as [MS-CFB] lays them out: enough of them for the tests of what is kept in "
"such."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

SECTOR, SMALL_SECTOR, CUTOFF = 512, 64, 4096
FREE, END, FAT = 0xFFFFFFFF, 0xFFFFFFFE, 0xFFFFFFFD
Tree = dict[str, "Tree | bytes"]


def ole_file(streams: dict[str, bytes], scattered: int | None = None) -> bytes:
    """Return a compound file of streams by names such as ``ImageInfo/ImageWidth``.

    Parameters
    ----------
    scattered : int, optional
        Seed of an order in which the sectors of the streams lie; else each lies in one piece.
    """
    tree: Tree = {}
    for name, content in streams.items():
        *folders, last = name.split("/")
        node = tree
        for folder in folders:
            node = node.setdefault(folder, {})  # type: ignore[assignment]
        node[last] = content
    entries: list[list] = []
    _add("Root Entry", tree, entries, kind=5)
    small, minifat = bytearray(), []
    sectors: list[bytes] = []
    chains: list[list[int]] = []

    def store(content: bytes) -> list[int]:
        first = len(sectors)
        sectors.extend(_pieces(content, SECTOR))
        chains.append(list(range(first, len(sectors))))
        return chains[-1]

    for entry in entries:
        content = entry[3]
        if entry[1] != 2:
            continue
        if len(content) < CUTOFF:
            entry[4] = len(minifat) if content else END
            pieces = _pieces(content, SMALL_SECTOR)
            minifat += [len(minifat) + i + 1 for i in range(len(pieces) - 1)] + [END] * bool(pieces)
            small += b"".join(pieces)
        else:
            entry[4] = store(content)
    entries[0][3], entries[0][4] = bytes(small), store(bytes(small)) if small else END
    smalls = store(struct.pack(f"<{len(minifat)}I", *minifat).ljust(SECTOR, b"\xff")) if minifat else []
    places = np.arange(len(sectors))
    if scattered is not None:
        places = np.random.default_rng(scattered).permutation(len(sectors))
    for entry in entries:
        if isinstance(entry[4], list):
            entry[4] = int(places[entry[4][0]])
    directory = b"".join(_packed(entry) for entry in entries)
    extra = _pieces(directory, SECTOR)
    beginning = len(sectors)
    total = beginning + len(extra)
    fats = -(-(total + -(-total // 127) + 1) // 128)
    table = [FREE] * (fats * 128)
    for chain in chains:
        for here, there in zip(chain, [*chain[1:], None], strict=True):
            table[places[here]] = END if there is None else int(places[there])
    for index in range(len(extra)):
        table[beginning + index] = beginning + index + 1 if index + 1 < len(extra) else END
    for index in range(fats):
        table[total + index] = FAT
    assert fats <= 109
    header = struct.pack(
        "<8s16sHHHHH6sIIIIIIIIII", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", b"", 0x3E, 3, 0xFFFE, 9, 6, b"", 0,
        fats, beginning, 0, CUTOFF, int(places[smalls[0]]) if smalls else END, len(smalls), END, 0, total,
    )  # fmt: skip
    header += struct.pack("<108I", *[total + i for i in range(1, fats)], *[FREE] * (109 - fats))
    ordered = [b""] * len(sectors)
    for index, content in enumerate(sectors):
        ordered[places[index]] = content
    return header + b"".join(ordered) + b"".join(extra) + struct.pack(f"<{len(table)}I", *table)


def _pieces(content: bytes, length: int) -> list[bytes]:
    return [content[at : at + length].ljust(length, b"\0") for at in range(0, len(content), length)]


def _add(name: str, node: Tree | bytes, entries: list[list], kind: int) -> int:
    """Add the entry of a storage or stream and of all in it; return its number."""
    number = len(entries)
    # name, kind, [left, right, child], content, first sector
    entries.append([name, kind, [FREE, FREE, FREE], node if isinstance(node, bytes) else b"", END])
    if isinstance(node, dict):
        names = sorted(node, key=lambda key: (len(key), key.upper()))
        entries[number][2][2] = _balanced(names, node, entries)
        entries[number][4] = 0 if kind == 1 else END
    return number


def _balanced(names: Sequence[str], node: Tree, entries: list[list]) -> int:
    if not names:
        return FREE
    middle = len(names) // 2
    chosen = node[names[middle]]
    number = _add(names[middle], chosen, entries, 1 if isinstance(chosen, dict) else 2)
    entries[number][2][0] = _balanced(names[:middle], node, entries)
    entries[number][2][1] = _balanced(names[middle + 1 :], node, entries)
    return number


def _packed(entry: list) -> bytes:
    name, kind, (left, right, child), content, first = entry
    text = (name + "\0").encode("utf-16-le")
    return struct.pack(
        "<64sHBBIII16sIQQIQ", text, len(text), kind, 1, left, right, child, b"", 0, 0, 0, first, len(content)
    )
