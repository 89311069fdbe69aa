"""A disk that is full after so many bytes, for writers in Python, in C and in programs that they start."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from mbstudio.core.errors import MbstudioError

POSSIBLE = sys.platform.startswith("linux")


@contextmanager
def full_after(count: int) -> Iterator[None]:
    """Let no file grow beyond so many bytes: the system refuses to write more, as on a full disk."""
    import resource

    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (count, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def everything_in(folder: Path) -> dict[str, bytes | None]:
    """Return the contents of all files below a folder, hidden ones too; locks hold nothing."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
        if path.suffix != ".lock"
    }


def require_nothing_is_lost(
    folder: Path, name: str, write: Callable[[Path], object], places: tuple[str, ...] = ("new", "over")
) -> None:
    """Write a file or folder on disks that are full sooner or later, over an older one and where none is.

    Each time the message must name it and all must be as it was; in the end it is written.
    """
    trial = folder / "trial"
    trial.mkdir()
    write(trial / name)
    largest = max(path.stat().st_size for path in trial.rglob("*") if path.is_file())
    for place in places:
        (folder / place).mkdir()
        if place == "over":
            write(folder / place / name)
        before = everything_in(folder / place)
        for count in sorted({0, 100, largest // 2, largest - 1}):
            with full_after(count), pytest.raises((MbstudioError, OSError)) as caught:
                write(folder / place / name)
            assert name.partition(".")[0] in str(caught.value), f"{count} bytes: {caught.value!r}"
            assert "\n" not in str(caught.value)
            assert everything_in(folder / place) == before, f"{place}, {count} bytes"
        write(folder / place / name)
        assert len(everything_in(folder / place)) == len(everything_in(trial))
