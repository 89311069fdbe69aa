"""Ranges of grey values as text: ``90:140, 200:255``."""

from __future__ import annotations

import math

from mbstudio.core.errors import SegmentationError


def read_ranges(text: str) -> tuple[float, ...]:
    """Return lower and upper ends, in pairs, of ranges written as ``90:140, 200:255``.

    Raises
    ------
    SegmentationError
        If the text holds no ranges, or one whose lower end is not the lower.
    """
    ends: list[float] = []
    try:
        for part in text.split(","):
            low, high = map(float, part.split(":"))
            ends += [low, high]
    except ValueError as error:
        raise SegmentationError(
            f"'{text}' contains no ranges of grey values: write them as 90:140,200:255."
        ) from error
    if not all(math.isfinite(end) for end in ends) or not all(
        low < high for low, high in zip(ends[::2], ends[1::2], strict=True)
    ):
        raise SegmentationError(f"'{text}' contains an empty range: write the lower grey value first.")
    return tuple(ends)


def write_ranges(ends: tuple[float, ...]) -> str:
    """Return ranges as `read_ranges` reads them."""
    return ", ".join(f"{low:g}:{high:g}" for low, high in zip(ends[::2], ends[1::2], strict=True))
