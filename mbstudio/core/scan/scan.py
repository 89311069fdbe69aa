"""A CT scan: voxels that may still lie on disk, their size and their unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from jaxtyping import Shaped

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.grid import Grid
from mbstudio.core.units import VoxelSize


class VoxelArray(Protocol):
    """What a scan's voxels must offer: enough of an array to be sliced without reading all."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def dtype(self) -> np.dtype[Any]: ...
    @property
    def ndim(self) -> int: ...
    def __getitem__(self, key: Any) -> Any: ...
    def __array__(self, dtype: Any = None, /, *, copy: bool | None = None) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class Scan:
    """Grey voxels of a CT scan.

    Attributes
    ----------
    voxels : VoxelArray, shape (Z, Y, X)
        Grey values; a memory map or a lazy stack of slices where the file allows it.
    voxel_size : VoxelSize
        Edge lengths and unit.
    origin : tuple of float
        Position (x, y, z) of the centre of voxel [0, 0, 0], in the unit of `voxel_size`.
    path : Path or None
        The file or folder that it was read from.
    metadata : mapping
        What else the file said, by the file's own names.
    grid : Grid or None
        How the file places its stored voxels in space, if it does.
    notes : tuple of str
        What was taken for granted about the file when it was opened.
    """

    voxels: VoxelArray
    voxel_size: VoxelSize
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    path: Path | None = None
    metadata: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    grid: Grid | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.voxels.ndim != 3 or 0 in self.voxels.shape:
            name = self.path or "The scan"
            raise ScanError(
                f"{name} has voxels of shape {self.voxels.shape}: "
                "a scan needs three axes (z, y, x), none empty."
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of voxels along z, y, x."""
        nz, ny, nx = self.voxels.shape
        return nz, ny, nx

    @property
    def unit(self) -> str:
        return self.voxel_size.unit

    @property
    def is_memory_mapped(self) -> bool:
        return isinstance(self.voxels, np.memmap)

    @property
    def size(self) -> tuple[float, float, float]:
        """Edge lengths (x, y, z) of the whole box in `unit`."""
        nz, ny, nx = self.shape
        dx, dy, dz = self.voxel_size.xyz
        return nx * dx, ny * dy, nz * dz

    def load(self) -> Shaped[np.ndarray, "Z Y X"]:
        """Return all voxels as an array (a memory map is returned as it is)."""
        return self.voxels if isinstance(self.voxels, np.ndarray) else np.asarray(self.voxels)
