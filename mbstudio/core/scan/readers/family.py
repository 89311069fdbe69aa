"""What every reader module offers, and what it hands back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.scan import VoxelArray


@dataclass(frozen=True)
class ReadOptions:
    """What the caller states about a file that cannot say it itself (RAW).

    Attributes
    ----------
    shape : tuple of int or None
        Number of voxels along z, y, x.
    dtype : numpy dtype or None
    header_bytes : int
        Bytes to skip before the first voxel.
    big_endian : bool
    """

    shape: tuple[int, int, int] | None = None
    dtype: np.dtype[Any] | None = None
    header_bytes: int = 0
    big_endian: bool = False


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
    origin : tuple of float
        Position (x, y, z) of voxel [0, 0, 0] in the file's unit.
    metadata : mapping
        What else the file said.
    """

    voxels: VoxelArray
    spacing: tuple[float, float, float] | None = None
    unit: str | None = None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    metadata: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))


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
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Path, ReadOptions], Reading]
    reads_folders: bool = False


def require_grey_volume(shape: tuple[int, ...], dtype: np.dtype[Any], path: Path) -> None:
    """Raise ScanError unless the voxels are three-dimensional real numbers."""
    if len(shape) == 4 and shape[-1] in (3, 4):
        raise ScanError(
            f"{path} holds colour images (shape {shape}): convert it to grey values first, "
            "for example in ImageJ with Image > Type > 16-bit."
        )
    if len(shape) != 3:
        raise ScanError(
            f"{path} has {len(shape)} axes (shape {shape}), but a scan has three (z, y, x): "
            "save one channel and one time step as its own file."
        )
    if 0 in shape:
        raise ScanError(f"{path} contains no voxels (shape {shape}): export the scan again.")
    if dtype.kind not in "buif":
        raise ScanError(
            f"{path} holds values of type {dtype}: export grey values as integers or real numbers."
        )
