"""Which of a file's voxels a scan is made of: a region, and blocks that are averaged.

A crop is written as Python writes slices: ``100:300,:,50:`` (z, y, x). An end left out is the scan's own,
a negative one counts from the end. Unlike Python's, ends beyond the scan are refused.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import SupportsIndex

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.slice_stack import Block
from mbstudio.core.units import VoxelSize

Counts = tuple[int, int, int]
Crop = str | slice | Sequence[slice]
"""A region as text (``"100:300,:,50:"``) or as slices in the order z, y, x (``np.s_[100:300, :, 50:]``)."""
Bin = str | int | Sequence[int]
"""Voxels that become one, along all axes (``2``) or along z, y, x (``"1,2,2"``)."""

AXES = ("z", "y", "x")
_ENDS = re.compile(r"^\s*([+-]?\d+)?\s*:\s*([+-]?\d+)?\s*$")
_HOW_TO_CROP = "write it as 100:300,0:512,0:512 or 100:300,:,50: (z, y, x)"


@dataclass(frozen=True)
class Excerpt:
    """The part of a file's voxels that a scan is made of.

    Attributes
    ----------
    whole : tuple of int
        Number of voxels of the file along z, y, x.
    start, stop : tuple of int
        The region in voxels of the file, half open. It holds whole blocks only.
    bin : tuple of int
        Voxels of the file that are one of the scan's, along z, y, x.
    header_bytes : int
        Bytes before the voxels, which a RAW file does not tell.
    """

    whole: Counts
    start: Counts
    stop: Counts
    bin: Counts = (1, 1, 1)
    header_bytes: int = field(default=0, compare=False)

    @classmethod
    def of_whole(cls, shape: Counts, header_bytes: int = 0) -> Excerpt:
        """Return the excerpt that leaves nothing out."""
        return cls(shape, (0, 0, 0), shape, header_bytes=header_bytes)

    @property
    def shape(self) -> Counts:
        """Number of the scan's voxels along z, y, x."""
        z, y, x = (
            (stop - start) // factor
            for start, stop, factor in zip(self.start, self.stop, self.bin, strict=True)
        )
        return z, y, x

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole file as it is."""
        return self.shape == self.whole

    @property
    def is_binned(self) -> bool:
        return self.bin != (1, 1, 1)

    @property
    def left_out(self) -> tuple[Counts, Counts]:
        """Voxels of the file before and behind the region along z, y, x."""
        return self.start, _along_axes(
            count - stop for count, stop in zip(self.whole, self.stop, strict=True)
        )

    @property
    def block(self) -> Block:
        """The region as slices of the file's voxels."""
        z, y, x = (slice(start, stop) for start, stop in zip(self.start, self.stop, strict=True))
        return z, y, x

    def require_possible(self, shape: Counts) -> None:
        """Refuse what is no part of a file that gives a scan of this shape.

        Raises
        ------
        ScanError
            If the region is empty or reaches beyond the file, or holds parts of blocks.
        """
        ends = zip(self.whole, self.start, self.stop, self.bin, strict=True)
        possible = all(
            0 <= start < stop <= count and factor >= 1 and (stop - start) % factor == 0
            for count, start, stop, factor in ends
        )
        if not possible or self.shape != shape:
            raise ScanError(
                f"A scan of {times(shape)} voxels cannot be the part {self.start} to {self.stop} of "
                f"{self.whole} in blocks of {self.bin} (z, y, x): the record of it is damaged."
            )

    def voxel_size_of_file(self, size: VoxelSize) -> VoxelSize:
        """Return the size of the file's voxels, from that of the scan's."""
        z, y, x = (edge / factor for edge, factor in zip(size.zyx, self.bin, strict=True))
        return VoxelSize(z, y, x, size.unit)

    def cropped(self, block: Block) -> Excerpt:
        """Return the part of this one that lies in a block of the scan's voxels (see `read_crop`)."""
        start = _along_axes(
            first + part.start * factor
            for first, part, factor in zip(self.start, block, self.bin, strict=True)
        )
        stop = _along_axes(
            first + part.stop * factor
            for first, part, factor in zip(self.start, block, self.bin, strict=True)
        )
        return replace(self, start=start, stop=stop)

    def binned(self, factors: Counts) -> Excerpt:
        """Return this one in blocks of voxels, without those at the far end that fill no block."""
        stop = _along_axes(
            start + (stop - start) // factor * factor
            for start, stop, factor in zip(self.start, self.stop, factors, strict=True)
        )
        return replace(self, stop=stop, bin=factors)

    def describe(self) -> str:
        """Return region and bin in words, for lists of properties: z, y, x in voxels of the file."""
        words = []
        if (self.start, self.stop) != ((0, 0, 0), self.whole):
            ends = ", ".join(f"{start}:{stop}" for start, stop in zip(self.start, self.stop, strict=True))
            words.append(f"{ends} of {times(self.whole)}")
        if self.is_binned:
            words.append(f"bin {describe_bin(self.bin)}")
        return "; ".join(words)


def times(counts: Sequence[int]) -> str:
    """Return numbers of voxels as people write them: ``400 × 512 × 512``."""
    return " × ".join(str(count) for count in counts)


def describe_bin(factors: Counts) -> str:
    """Return a bin as one number, or three (z, y, x) where they differ."""
    return str(factors[0]) if len(set(factors)) == 1 else times(factors)


def read_crop(crop: Crop, shape: Counts) -> Block:
    """Return a region as slices of a scan's voxels, with both ends and within the scan.

    Parameters
    ----------
    crop : str, slice or sequence of slice
        Up to three parts in the order z, y, x; axes left out are whole.
    shape : tuple of int
        Number of the scan's voxels along z, y, x.

    Raises
    ------
    ScanError
        If it cannot be read, is empty, or reaches beyond the scan.
    """
    parts = _parts(crop)
    if not 1 <= len(parts) <= 3:
        raise ScanError(f"The region '{_text(crop)}' has {len(parts)} parts: {_HOW_TO_CROP}.")
    parts += [slice(None)] * (3 - len(parts))
    size = f"{' x '.join(map(str, shape))} voxels (z, y, x)"
    ends: list[slice] = []
    for axis, part, count in zip(AXES, parts, shape, strict=True):
        if part.step not in (None, 1):
            raise ScanError(
                f"The region '{_text(crop)}' has a step along {axis}: "
                "give two ends, and a bin for larger voxels."
            )
        start, stop = (
            default if end is None else _index(end, crop) + (count if _index(end, crop) < 0 else 0)
            for end, default in ((part.start, 0), (part.stop, count))
        )
        if not (0 <= start <= count and 0 <= stop <= count):
            raise ScanError(
                f"The region '{_text(crop)}' reaches beyond the scan along {axis}, which has {size}: "
                f"give ends from 0 to {count} there."
            )
        if start >= stop:
            raise ScanError(
                f"The region '{_text(crop)}' is empty along {axis} ({start}:{stop}): the scan has {size}; "
                "give a second end above the first."
            )
        ends.append(slice(start, stop))
    z, y, x = ends
    return z, y, x


def read_bin(factors: Bin) -> Counts:
    """Return how many voxels become one along z, y, x.

    Parameters
    ----------
    factors : int, str or sequence of int
        One number, or three (z, y, x).

    Raises
    ------
    ScanError
        If it is neither, or a number is below 1.
    """
    words = factors.split(",") if isinstance(factors, str) else factors
    try:
        if isinstance(words, SupportsIndex):
            numbers = [operator.index(words)]
        else:
            numbers = [int(word) if isinstance(word, str) else operator.index(word) for word in words]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) == 1:
        numbers *= 3
    if len(numbers) != 3 or min(numbers) < 1:
        raise ScanError(
            f"The bin '{factors}' cannot be read: give one whole number from 1, such as 2, or three as 1,2,2 "
            "(z, y, x)."
        )
    z, y, x = numbers
    return z, y, x


def require_bin_fits(factors: Counts, shape: Counts) -> None:
    """Refuse a bin of more voxels than there are.

    Raises
    ------
    ScanError
        Naming the axis and the size.
    """
    for axis, factor, count in zip(AXES, factors, shape, strict=True):
        if factor > count:
            raise ScanError(
                f"A bin of {factor} is larger than the {count} voxels along {axis} of "
                f"{' x '.join(map(str, shape))} (z, y, x): give at most {count} there, or a larger region."
            )


def left_out_note(shape: Counts, factors: Counts) -> str | None:
    """Return the note on voxels at the far end that fill no block, None if there are none."""
    rest = [
        f"{count % factor} along {axis}"
        for axis, count, factor in zip(AXES, shape, factors, strict=True)
        if count % factor
    ]
    if not rest:
        return None
    return (
        f"has {' x '.join(map(str, shape))} voxels (z, y, x), of which a bin of {describe_bin(factors)} "
        f"leaves the last ones out ({', '.join(rest)})."
    )


def _along_axes(counts: Iterable[int]) -> Counts:
    z, y, x = counts
    return z, y, x


def _index(end: object, crop: Crop) -> int:
    try:
        return operator.index(end)  # type: ignore[arg-type]
    except TypeError as error:
        raise ScanError(
            f"The region '{_text(crop)}' has ends that are not whole numbers: {_HOW_TO_CROP}."
        ) from error


def _parts(crop: Crop) -> list[slice]:
    """Return what was given as slices, yet without regard to a scan."""
    if isinstance(crop, slice):
        return [crop]
    if not isinstance(crop, str):
        parts = list(crop)
        if not all(isinstance(part, slice) for part in parts):
            raise ScanError(f"The region '{crop}' is not a sequence of slices: {_HOW_TO_CROP}.")
        return parts
    parts = []
    for word in crop.split(","):
        match = _ENDS.match(word)
        if match is None:
            raise ScanError(f"The region '{crop}' cannot be read at '{word.strip()}': {_HOW_TO_CROP}.")
        parts.append(slice(*(int(end) if end is not None else None for end in match.groups())))
    return parts


def _text(crop: Crop) -> str:
    """Return a region as it is written on the command line."""
    if isinstance(crop, str):
        return crop
    parts = [crop] if isinstance(crop, slice) else crop
    return ",".join(
        f"{'' if part.start is None else part.start}:{'' if part.stop is None else part.stop}"
        f"{'' if part.step is None else f':{part.step}'}"
        for part in parts
    )
