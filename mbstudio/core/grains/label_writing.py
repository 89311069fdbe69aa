"""Writing grains as a label image that other programs read, with the voxel size."""

from __future__ import annotations

import json
import zlib
from pathlib import Path

import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import SegmentationError
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.replacement import replacing, replacing_folder
from mbstudio.core.scan.grid import Grid
from mbstudio.core.units import VoxelSize

ENDINGS = (".tif", ".tiff", ".nrrd", ".mha", ".mhd", ".zarr")
# Voxels a side of the chunks of OME-Zarr.
_CHUNK = 128


def write_label_image(path: Path, grains: GrainSet, grid: Grid | None = None) -> None:
    """Write the labels of grains as a file of whole numbers, 0 outside all grains.

    Parameters
    ----------
    path : Path
        ``.tif`` is written as ImageJ does, with unit and slice distance; ``.nrrd``, ``.mha`` and
        ``.mhd`` as ITK does, in millimetres and with the origin; ``.zarr`` as a folder of OME-Zarr
        (NGFF 0.5), in micrometres and with the origin.
    grains : GrainSet
    grid : Grid, optional
        How the scan's file places its voxels: labels are written in the order in which that
        stores them, so that they lie on the scan in other programs as well.

    Raises
    ------
    SegmentationError
        If the ending is of no format that is written, a folder of that name was not written by
        mbstudio, or OME-Zarr cannot tell how the scan's axes are turned.
    """
    suffix = require_ending(path)
    numbers = np.uint16 if grains.labels.max(initial=0) < 2**16 else np.uint32
    labels = grains.labels.astype(numbers)
    if suffix in (".tif", ".tiff"):
        _write_tiff(path, labels if grid is None else grid.as_stored(labels), grains.voxel_size)
    elif suffix == ".zarr":
        _write_zarr(path, labels, grains, grid)
    else:
        _write_in_space(path, labels, grains, grid)


def require_ending(path: Path) -> str:
    """Return the ending of a label image's name; SegmentationError if it cannot be written there."""
    suffix = path.suffix.lower()
    if suffix not in ENDINGS:
        raise SegmentationError(
            f"{path} cannot be written as a label image: use a name ending in {', '.join(ENDINGS)}."
        )
    if path.exists() and path.is_dir() != (suffix == ".zarr"):
        what = "folder" if path.is_dir() else "file"
        raise SegmentationError(f"{path} is a {what}: give the label image another name.")
    if suffix == ".zarr" and path.exists() and not _is_ours(path):
        raise SegmentationError(
            f"{path} is there already, and was not written by mbstudio: give the label image another name."
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


def _write_zarr(path: Path, labels: Int[np.ndarray, "Z Y X"], grains: GrainSet, grid: Grid | None) -> None:
    """Write a label image of NGFF 0.5, along the axes of space, in micrometres."""
    import zarr

    if grid is not None and not _is_along_axes(grid):
        raise SegmentationError(
            f"{path} cannot be written: the scan's axes are turned in space, which OME-Zarr does not tell. "
            "Write the labels as NRRD or MHA."
        )
    size = grains.voxel_size.to("um")
    origin = np.array(grains.origin) * size.x / grains.voxel_size.x
    if grid is not None:
        # As below, the place grows with a voxel size that is the caller's. Axes run forwards here.
        origin = grid.origin * size.xyz / np.linalg.norm(grid.steps, axis=1)
        last = np.array(labels.shape[::-1]) - 1
        origin = origin - np.where(np.diag(grid.steps) < 0, last * size.xyz, 0)
    image = {
        "name": path.name.removesuffix(path.suffix).removesuffix(".ome"),
        "axes": [{"name": axis, "type": "space", "unit": "micrometer"} for axis in "zyx"],
        "datasets": [
            {
                "path": "0",
                "coordinateTransformations": [
                    {"type": "scale", "scale": list(size.zyx)},
                    {"type": "translation", "translation": origin[::-1].tolist()},
                ],
            }
        ],
    }
    facts = {"version": "0.5", "multiscales": [image], "image-label": {"version": "0.5"}}
    with replacing_folder(path) as temporary:
        group = zarr.create_group(temporary, zarr_format=3, attributes={"ome": facts, "mbstudio": "labels"})
        array = group.create_array(
            "0",
            shape=labels.shape,
            dtype=labels.dtype,
            chunks=tuple(min(_CHUNK, count) for count in labels.shape),
            dimension_names=list("zyx"),
            fill_value=0,
        )
        for start in range(0, len(labels), _CHUNK):
            array[start : start + _CHUNK] = labels[start : start + _CHUNK]


def _is_ours(path: Path) -> bool:
    """Return whether a folder is a label image that mbstudio wrote."""
    try:
        facts = json.loads((path / "zarr.json").read_bytes())
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(facts, dict) and (facts.get("attributes") or {}).get("mbstudio") == "labels"


def _is_along_axes(grid: Grid) -> bool:
    """Return whether each axis of a grid runs along its own axis of space, forwards or backwards."""
    units = grid.steps / np.linalg.norm(grid.steps, axis=1)[:, None]
    return bool(np.allclose(np.abs(units), np.eye(3), atol=1e-3))


def _is_rigid(grid: Grid) -> bool:
    edges = np.linalg.norm(grid.steps, axis=1)
    units = grid.steps / edges[:, None]
    return bool(np.allclose(units @ units.T, np.eye(3), atol=1e-3))
