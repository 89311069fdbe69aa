"""Writing grains as a label image that other programs read, with the voxel size."""

from __future__ import annotations

import zlib
from pathlib import Path

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
        _write_in_space(path, labels, grains, grid)


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


def _write_in_space(
    path: Path, labels: Int[np.ndarray, "Z Y X"], grains: GrainSet, grid: Grid | None
) -> None:
    """Write NRRD or MetaImage with spacing, directions and origin in millimetres, as ITK reads them."""
    size = np.array(grains.voxel_size.to("mm").xyz)
    factor = size[0] / grains.voxel_size.x
    directions, origin = np.eye(3), np.array(grains.origin) * factor
    if grid is not None and _is_rigid(grid):
        labels = grid.as_stored(labels)
        edges = np.linalg.norm(grid.steps, axis=1)
        # The caller's voxel size may not be the file's: the place grows with it.
        directions, origin = grid.steps / edges[:, None], grid.origin * size / edges
    with replacing(path) as temporary:
        if path.suffix.lower() == ".nrrd":
            _write_nrrd(temporary, labels, directions * size[:, None], origin)
            return
        _write_meta_image(temporary, path, labels, directions, size, origin)


def _write_nrrd(path: Path, labels: Int[np.ndarray, "Z Y X"], steps: np.ndarray, origin: np.ndarray) -> None:
    """Write NRRD with its units, which ITK leaves out."""
    import nrrd

    header = {
        "space": "left-posterior-superior",
        "space directions": steps,
        "space origin": origin,
        "space units": ["mm"] * 3,
        "kinds": ["domain"] * 3,
        "encoding": "gzip",
    }
    nrrd.write(str(path), np.ascontiguousarray(labels), header, index_order="C")


def _write_meta_image(
    temporary: Path,
    path: Path,
    labels: Int[np.ndarray, "Z Y X"],
    directions: np.ndarray,
    size: np.ndarray,
    origin: np.ndarray,
) -> None:
    """Write MHA, or MHD whose compressed data lies beside it."""
    voxels = zlib.compress(np.ascontiguousarray(labels, labels.dtype.newbyteorder("<")).tobytes(), 6)
    beside = path.with_suffix(".zraw")
    is_one = path.suffix.lower() == ".mha"
    lines = (
        "ObjectType = Image",
        "NDims = 3",
        "BinaryData = True",
        "BinaryDataByteOrderMSB = False",
        "CompressedData = True",
        f"CompressedDataSize = {len(voxels)}",
        "TransformMatrix = " + " ".join(f"{part:.12g}" for part in directions.ravel()),
        "Offset = " + " ".join(f"{part:.12g}" for part in origin),
        "CenterOfRotation = 0 0 0",
        "ElementSpacing = " + " ".join(f"{edge:.12g}" for edge in size),
        "DimSize = " + " ".join(str(count) for count in labels.shape[::-1]),
        f"ElementType = {'MET_USHORT' if labels.dtype.itemsize == 2 else 'MET_UINT'}",
        f"ElementDataFile = {'LOCAL' if is_one else beside.name}",
    )
    header = ("\n".join(lines) + "\n").encode()
    temporary.write_bytes(header + voxels if is_one else header)
    if not is_one:
        with replacing(beside) as data:
            data.write_bytes(voxels)


def _is_rigid(grid: Grid) -> bool:
    edges = np.linalg.norm(grid.steps, axis=1)
    units = grid.steps / edges[:, None]
    return bool(np.allclose(units @ units.T, np.eye(3), atol=1e-3))
