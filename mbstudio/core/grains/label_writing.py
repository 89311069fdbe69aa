"""Writing grains as a label image that other programs read, with the voxel size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import SegmentationError
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.replacement import replacing
from mbstudio.core.scan.grid import Grid
from mbstudio.core.units import VoxelSize

ENDINGS = (".tif", ".tiff", ".nrrd", ".mha", ".mhd")


def write_label_image(path: Path, grains: GrainSet, grid: Grid | None = None) -> None:
    """Write the labels of grains as a file of whole numbers, 0 outside all grains.

    Parameters
    ----------
    path : Path
        ``.tif`` is written as ImageJ does, with unit and slice distance; ``.nrrd``, ``.mha`` and
        ``.mhd`` as ITK does, in millimetres and with the origin.
    grains : GrainSet
    grid : Grid, optional
        How the scan's file places its voxels: labels are written in the order in which that
        stores them, so that they lie on the scan in other programs as well.

    Raises
    ------
    SegmentationError
        If the ending is of no format that is written.
    """
    suffix = require_ending(path)
    numbers = np.uint16 if grains.labels.max(initial=0) < 2**16 else np.uint32
    labels = grains.labels.astype(numbers)
    if suffix in (".tif", ".tiff"):
        _write_tiff(path, labels if grid is None else grid.as_stored(labels), grains.voxel_size)
    else:
        _write_by_itk(path, labels, grains, grid)


def require_ending(path: Path) -> str:
    """Return the ending of a label image's name; SegmentationError if it is of no format that is written."""
    suffix = path.suffix.lower()
    if suffix not in ENDINGS:
        raise SegmentationError(
            f"{path} cannot be written as a label image: let its name end in {', '.join(ENDINGS)}."
        )
    return suffix


def _write_tiff(path: Path, labels: Int[np.ndarray, "Z Y X"], size: VoxelSize) -> None:
    """Write a TIFF stack whose description gives ImageJ the unit and the slice distance."""
    import tifffile

    micrometres = size.to("um")
    # Written by hand: tifffile's own ImageJ files have no 32-bit whole numbers.
    description = "\n".join(
        (
            "ImageJ=1.11a",
            f"images={len(labels)}",
            f"slices={len(labels)}",
            "unit=um",
            f"spacing={micrometres.z!r}",
            f"min=0\nmax={int(labels.max(initial=0))}\n",
        )
    )
    with (
        replacing(path) as temporary,
        tifffile.TiffWriter(temporary, bigtiff=labels.nbytes > 3 * 2**30) as out,
    ):
        for number, image in enumerate(labels):
            out.write(
                np.ascontiguousarray(image),
                compression="zlib",
                photometric="minisblack",
                resolution=(1 / micrometres.x, 1 / micrometres.y),
                resolutionunit="NONE",
                description=description if number == 0 else None,
                metadata=None,
                contiguous=False,
            )


def _write_by_itk(path: Path, labels: Int[np.ndarray, "Z Y X"], grains: GrainSet, grid: Grid | None) -> None:
    """Write NRRD or MetaImage with spacing, directions and origin in millimetres."""
    import SimpleITK as sitk

    size = grains.voxel_size
    factor = size.to("mm").x / size.x
    placed = grid if grid is not None and _is_rigid(grid) else None
    image: Any = sitk.GetImageFromArray(
        np.ascontiguousarray(labels if placed is None else placed.as_stored(labels))
    )
    image.SetSpacing([edge * factor for edge in size.xyz])
    if placed is None:
        image.SetOrigin([coordinate * factor for coordinate in grains.origin])
    else:
        edges = np.linalg.norm(placed.steps, axis=1)
        # ITK's columns are the directions of the axes; the caller's voxel size may not be the file's.
        image.SetDirection((placed.steps / edges[:, None]).T.ravel().tolist())
        image.SetOrigin((placed.origin * (np.array(size.xyz) * factor / edges)).tolist())
    if path.suffix.lower() == ".mhd":
        sitk.WriteImage(image, str(path), True)
        return
    with replacing(path) as temporary:
        named = temporary.with_name(temporary.name + path.suffix.lower())
        sitk.WriteImage(image, str(named), True)
        named.replace(temporary)


def _is_rigid(grid: Grid) -> bool:
    edges = np.linalg.norm(grid.steps, axis=1)
    units = grid.steps / edges[:, None]
    return bool(np.allclose(units @ units.T, np.eye(3), atol=1e-3))
