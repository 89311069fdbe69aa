"""Readers of scans, one module for each family of files.

A new one is a module that ends with its ``FAMILY``, and a line here. Begin at `family`, then at `npy`, the
shortest.
"""

from __future__ import annotations

from pathlib import Path

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers import hdf5, meta_image, npy, nrrd, raw, slices, tiff
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions
from mbstudio.core.scan.readers.hdf5 import split_dataset

FAMILIES: tuple[Family, ...] = (
    tiff.FAMILY,
    slices.FAMILY,
    raw.FAMILY,
    npy.FAMILY,
    nrrd.FAMILY,
    meta_image.FAMILY,
    hdf5.FAMILY,
)

SUFFIXES = tuple(suffix for family in FAMILIES for suffix in family.suffixes)
"""Endings of all files that are read."""

# What people try to open as a scan, and what to do instead.
_OTHERS = {
    ".ilp": "is an ilastik project, which holds no volume of its own: export the results from ilastik",
    ".mbs": "is a project of mbstudio, no scan: open it as a project",
    ".log": "is a log beside slices: open the folder of the slices",
    ".png": "is a single image: open the folder of all slices",
    ".bmp": "is a single image: open the folder of all slices",
    ".jpg": "is a single image: open the folder of all slices",
    ".jpeg": "is a single image: open the folder of all slices",
    ".zip": "is an archive: unpack it first",
    ".gz": "is an archive: unpack it first",
    ".7z": "is an archive: unpack it first",
    ".npz": "is an archive of arrays: save the one array with numpy.save",
}  # fmt: skip


def family_of(path: Path, options: ReadOptions) -> Family:
    """Return the family that reads `path`: by folder, by ending, or RAW where a shape is stated.

    Raises
    ------
    ScanError
        If no family reads such a file.
    """
    suffix = path.suffix.lower()
    for family in FAMILIES:
        if family.reads_folders if path.is_dir() else suffix in family.suffixes:
            return family
    if options.shape is not None:
        return raw.FAMILY
    if suffix in _OTHERS:
        raise ScanError(f"{path} {_OTHERS[suffix]}.")
    endings = ", ".join(SUFFIXES)
    raise ScanError(
        f"{path} is not a scan that mbstudio can read ({endings}, or a folder of slices): "
        "for RAW voxels give shape and dtype."
    )


__all__ = ["FAMILIES", "SUFFIXES", "Family", "ReadOptions", "Reading", "family_of", "split_dataset"]
