"""A CT scan: voxels that may still lie on disk, their size and their unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Shaped

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.excerpt import (
    Bin,
    Crop,
    Excerpt,
    left_out_note,
    read_bin,
    read_crop,
    require_bin_fits,
)
from mbstudio.core.scan.grid import Grid
from mbstudio.core.scan.voxel_array import VoxelArray
from mbstudio.core.scan.voxel_blocks import block_means, is_mapped, region
from mbstudio.core.units import VoxelSize

__all__ = ["Scan", "VoxelArray"]


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
    excerpt : Excerpt or None
        Which of the file's voxels these are; None for all of them, as they are.
    """

    voxels: VoxelArray
    voxel_size: VoxelSize
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    path: Path | None = None
    metadata: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    grid: Grid | None = None
    notes: tuple[str, ...] = ()
    excerpt: Excerpt | None = None

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
        return is_mapped(self.voxels)

    @property
    def size(self) -> tuple[float, float, float]:
        """Edge lengths (x, y, z) of the whole box in `unit`."""
        nz, ny, nx = self.shape
        dx, dy, dz = self.voxel_size.xyz
        return nx * dx, ny * dy, nz * dz

    def load(self) -> Shaped[np.ndarray, "Z Y X"]:
        """Return all voxels as an array (a memory map is returned as it is)."""
        return self.voxels if isinstance(self.voxels, np.ndarray) else np.asarray(self.voxels)

    def cropped(self, crop: Crop) -> Scan:
        """Return a region of this scan, which lies in space where it lay.

        Parameters
        ----------
        crop : str, slice or sequence of slice
            In voxels of this scan, as Python slices them: ``"100:300,:,50:"`` or
            ``np.s_[100:300, :, 50:]`` (z, y, x).

        Returns
        -------
        Scan
            It shares the voxels that are in memory or mapped.

        Raises
        ------
        ScanError
            If the region cannot be read, is empty, or reaches beyond the scan.
        """
        block = read_crop(crop, self.shape)
        excerpt = self._present_excerpt.cropped(block)
        corner = self.voxel_size.positions(np.array([[part.start for part in block]]), self.origin)[0]
        grid = None
        if self.grid is not None:
            stop = tuple(count - part.stop for part, count in zip(block, self.shape, strict=True))
            grid = self.grid.region(tuple(part.start for part in block), stop)
        return replace(
            self,
            voxels=region(self.voxels, block),
            origin=(float(corner[0]), float(corner[1]), float(corner[2])),
            grid=grid,
            excerpt=None if excerpt.is_whole else excerpt,
        )

    def binned(self, factors: Bin) -> Scan:
        """Return this scan in voxels that are the means of blocks of its own.

        Parameters
        ----------
        factors : int, str or sequence of int
            Voxels that become one, along all axes (``2``) or along z, y, x (``"1,2,2"``). Those at the
            far end that fill no block are left out, with a note in `notes`.

        Returns
        -------
        Scan
            Its voxels are computed when they are read, in the type of this scan's: means of whole
            numbers are rounded. A block with a voxel outside the field of view is outside.

        Raises
        ------
        ScanError
            If there are not so many voxels, or the scan is binned already.
        """
        counts = read_bin(factors)
        if counts == (1, 1, 1):
            return self
        present = self._present_excerpt
        if present.is_binned:
            raise ScanError(
                f"{self.path or 'The scan'} is binned already, and means of rounded means are not those of "
                "the voxels: open it again, with the bin that is wanted."
            )
        require_bin_fits(counts, self.shape)
        excerpt = present.binned(counts)
        note = left_out_note(self.shape, counts)
        whole_blocks = self.cropped(
            [slice(0, count // factor * factor) for count, factor in zip(self.shape, counts, strict=True)]
        )
        size = self.voxel_size
        fz, fy, fx = counts
        middle = size.positions(np.array([[(factor - 1) / 2 for factor in counts]]), self.origin)[0]
        return replace(
            whole_blocks,
            voxels=block_means(whole_blocks.voxels, counts),
            voxel_size=VoxelSize(size.z * fz, size.y * fy, size.x * fx, size.unit),
            origin=(float(middle[0]), float(middle[1]), float(middle[2])),
            grid=whole_blocks.grid.in_blocks(counts) if whole_blocks.grid is not None else None,
            notes=self.notes if note is None else (*self.notes, f"{self.path or 'The scan'} {note}"),
            excerpt=excerpt,
        )

    @property
    def _present_excerpt(self) -> Excerpt:
        if self.excerpt is not None:
            return self.excerpt
        voxels = self.voxels
        return Excerpt.of_whole(self.shape, int(voxels.offset) if isinstance(voxels, np.memmap) else 0)
