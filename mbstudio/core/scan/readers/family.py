"""What every reader module offers, and what it hands back."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.grid import Grid
from mbstudio.core.scan.scan import VoxelArray

# Deflate packs at most 1032 bytes into one; what claims more is no volume of that size.
_MOST_COMPRESSION = 1100


@dataclass(frozen=True)
class ReadOptions:
    """What the caller states about a file, and what is wanted of it.

    Attributes
    ----------
    shape : tuple of int or None
        Number of voxels along z, y, x.
    dtype : numpy dtype or None
    header_bytes : int
        Bytes to skip before the first voxel.
    big_endian : bool
    numbers : bool
        Whether the voxels are numbers of grains rather than grey values: a palette's colours then
        mean nothing, and black and white are not exchanged.
    dataset : str or None
        Which of the arrays in a container (HDF5, Zarr, VTK) is meant.
    in_part : bool
        Whether only a part of the voxels is wanted: what can be read in blocks is not read before
        they are asked for.
    """

    shape: tuple[int, int, int] | None = None
    dtype: np.dtype[Any] | None = None
    header_bytes: int = 0
    big_endian: bool = False
    numbers: bool = False
    dataset: str | None = None
    in_part: bool = False


@dataclass(frozen=True, eq=False)
class Reading:
    """What a file holds.

    Attributes
    ----------
    voxels : VoxelArray, shape (Z, Y, X)
    spacing : tuple of float or None
        Edge lengths z, y, x of a voxel as the file gives them; None where it says nothing.
    unit : str or None
        Unit of `spacing` and `origin`; None where the file does not say.
    unit_word : str or None
        What the file says where its unit should be, if that is no length unit.
    origin : tuple of float
        Position (x, y, z) of voxel [0, 0, 0] in the file's unit.
    metadata : mapping
        What else the file said.
    grid : Grid or None
        How the file places its stored voxels in space, if it does.
    notes : tuple of str
        What was taken for granted, for the user to know; whole sentences without the file's name.
    size_notes : tuple of str
        The same about the spacing, of no interest where the caller states it.
    doubt : str or None
        Why the spacing is not believed unless the caller states it; a sentence's end.
    white_is_zero : bool
        Whether `numbers` were asked for and the file shows 0 as white.
    """

    voxels: VoxelArray
    spacing: tuple[float, float, float] | None = None
    unit: str | None = None
    unit_word: str | None = None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    metadata: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    grid: Grid | None = None
    notes: tuple[str, ...] = ()
    size_notes: tuple[str, ...] = ()
    doubt: str | None = None
    white_is_zero: bool = False


@dataclass(frozen=True)
class Family:
    """One family of files.

    Attributes
    ----------
    name : str
        As a person would call it.
    suffixes : tuple of str
        Lower-case file endings with the dot; empty for folders.
    read : callable
        ``read(path, options) -> Reading``; raises ScanError.
    reads_folders : bool
    recognises : callable or None
        ``recognises(path) -> bool``: whether a folder, or a file whose ending says nothing, is of this
        family by what it holds. The family of folders without it takes all others.
    holds_several : bool
        Whether one of several arrays may be named behind a colon.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Path, ReadOptions], Reading]
    reads_folders: bool = False
    recognises: Callable[[Path], bool] | None = None
    holds_several: bool = False


def require_grey_volume(shape: tuple[int, ...], dtype: np.dtype[Any], path: Path) -> None:
    """Raise ScanError unless the voxels are three-dimensional real numbers."""
    if len(shape) != 3:
        raise ScanError(
            f"{path} has {len(shape)} axes (shape {shape}), but a scan has three (z, y, x): "
            "save one channel and one time step as its own file."
        )
    if min(shape) < 1:
        raise ScanError(f"{path} contains no voxels (shape {shape}): export the scan again.")
    if dtype.kind not in "buif":
        raise ScanError(
            f"{path} contains values of type {dtype}: export grey values as integers or real numbers."
        )


def require_memory(
    shape: tuple[int, ...],
    itemsize: int,
    path: Path,
    stored: int | None = None,
    packing: int = _MOST_COMPRESSION,
) -> None:
    """Raise ScanError, before memory is taken, if a volume cannot be in a file or in this machine.

    Parameters
    ----------
    stored : int, optional
        Bytes of the compressed file that the volume is to be unpacked from.
    packing : int
        By how much its compression packs at most.
    """
    needed = math.prod(shape) * itemsize
    if stored is not None and needed > packing * max(stored, 1) + 2**20:
        raise ScanError(
            f"{path} states {' x '.join(map(str, shape))} voxels, {needed:,} bytes, but holds {stored:,}: "
            "its header is wrong or its data is cut off; copy or export it again."
        )
    there = physical_memory()
    if there is not None and needed > 0.9 * there:
        raise ScanError(
            f"{path} needs {needed / 2**30:.1f} GiB of memory, and this machine has {there / 2**30:.1f}: "
            "save it uncompressed, so that it need not be unpacked, or crop it."
        )


def memory_refusal(path: Path) -> ScanError:
    """Return the error of a file for which memory ran out while it was read."""
    return ScanError(
        f"{path} asks for more memory than there is: it is damaged, or too large to be read while other "
        "programs run; copy it again, close them, or open a part of it."
    )


def physical_memory() -> int | None:
    """Return the bytes of memory of this machine, None where it does not say."""
    try:
        return int(os.sysconf("SC_PAGE_SIZE")) * int(os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):
        return None


def require_file(path: Path) -> None:
    """Raise ScanError unless `path` is there and a regular file, which cannot wait for a writer for ever."""
    if not is_there(path):
        raise ScanError(f"{path} does not exist: check the name and the folder.")
    if not path.is_file():
        raise ScanError(f"{path} is not a regular file, so it holds no scan.")


def is_there(path: Path) -> bool:
    """Return whether a file of that name exists; a name that no file can have is of none."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def side_car(path: Path, name: str) -> Path:
    """Return the file beside `path` that it names; ScanError if that lies in another folder."""
    name = name.strip().strip('"').strip()
    plain = name.removeprefix("./").removeprefix(".\\")
    if not plain or any(sign in plain for sign in "/\\:\0") or plain in (".", ".."):
        raise ScanError(
            f"{path} refers to its data file '{name}' outside its folder: "
            "put both into one folder and name the data file there without a folder."
        )
    return require_beside(path, path.parent / plain)


def require_beside(path: Path, other: Path) -> Path:
    """Return `other`; ScanError if it is a link that leads out of the folder of `path`."""
    try:
        place = other.resolve().parent
        leads_out = place not in (path.parent.resolve(), path.resolve().parent)
    except (OSError, RuntimeError, ValueError) as error:
        raise ScanError(
            f"{path} names its data file '{other.name}', which cannot be found: {error}."
        ) from error
    if leads_out:
        raise ScanError(
            f"{path} names its data file '{other.name}', a link that leads outside its folder, "
            f"to {place}: put the file itself beside it."
        )
    return other
