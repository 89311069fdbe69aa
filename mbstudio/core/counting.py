"""Numbers of things in words: one grain, but two grains."""

from __future__ import annotations


def counted(count: int, noun: str, plural: str = "") -> str:
    """Return a number with its noun: ``1 grain``, ``2,000 grains``.

    Parameters
    ----------
    count : int
    noun : str
        For exactly one.
    plural : str
        For any other number; the noun and an s by default.
    """
    return f"{count:,} {noun if count == 1 else plural or noun + 's'}"
