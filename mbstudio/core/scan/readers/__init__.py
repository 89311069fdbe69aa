"""Readers of scans, one module for each family of files.

A new one is a module that ends with its ``FAMILY``, and a line here. Begin at `family`, then at `npy`, the
shortest.
"""

from __future__ import annotations

from pathlib import Path

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers import meta_image, nifti, npy, nrrd, raw, slices, tiff, xradia
from mbstudio.core.scan.readers.amira import volume as amira
from mbstudio.core.scan.readers.dicom import reading as dicom
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions
from mbstudio.core.scan.readers.hdf5 import volume as hdf5
from mbstudio.core.scan.readers.ome_zarr import reading as ome_zarr
from mbstudio.core.scan.readers.side_cars import nikon, phoenix
from mbstudio.core.scan.readers.vtk_image import reading as vtk_image

FAMILIES: tuple[Family, ...] = (
    tiff.FAMILY,
    slices.FAMILY,
    raw.FAMILY,
    npy.FAMILY,
    nrrd.FAMILY,
    meta_image.FAMILY,
    hdf5.FAMILY,
    nifti.FAMILY,
    nikon.FAMILY,
    phoenix.FAMILY,
    xradia.FAMILY,
    ome_zarr.FAMILY,
    amira.FAMILY,
    dicom.FAMILY,
    vtk_image.FAMILY,
)

SUFFIXES = tuple(suffix for family in FAMILIES for suffix in family.suffixes)
"""Endings of all files that are read."""

# What people try to open as a scan, and what to do instead.
_OTHERS = {
    ".ilp": "is an ilastik project, which contains no volume: export the results from ilastik",
    ".mbs": "is an mbstudio project, not a scan: open it as a project",
    ".log": "is the log of a folder of slices: open the folder",
    ".png": "is a single image: open the folder of all slices",
    ".bmp": "is a single image: open the folder of all slices",
    ".jpg": "is a single image: open the folder of all slices",
    ".jpeg": "is a single image: open the folder of all slices",
    ".zip": "is an archive: unpack it first",
    ".gz": "is an archive: unpack it first",
    ".7z": "is an archive: unpack it first",
    ".npz": "is an archive of arrays: save the array of the scan with numpy.save",
}  # fmt: skip


def family_of(path: Path, options: ReadOptions) -> Family:
    """Return the family that reads `path`: by folder, by ending, or RAW where a shape is stated.

    Raises
    ------
    ScanError
        If no family reads such a file.
    """
    suffix = path.suffix.lower()
    family = _by_contents(path) if path.is_dir() else _by_ending(path) or _by_contents(path)
    if family is not None:
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


def _by_ending(path: Path) -> Family | None:
    """Return the family of the longest ending that a file's name has."""
    name = path.name.lower()
    fitting = [
        (len(suffix), family) for family in FAMILIES for suffix in family.suffixes if name.endswith(suffix)
    ]
    return max(fitting, key=lambda pair: pair[0])[1] if fitting else None


def _by_contents(path: Path) -> Family | None:
    """Return the family of a folder, or of a file that has no known ending, by what it holds."""
    is_folder = path.is_dir()
    fitting = [family for family in FAMILIES if family.reads_folders or not is_folder]
    for family in fitting:
        if family.recognises is not None and family.recognises(path):
            return family
    return next((family for family in fitting if is_folder and family.recognises is None), None)


def split_dataset(path: Path) -> tuple[Path, str | None]:
    """Part ``scan.h5:/entry/data`` (or ``scan.h5/entry/data``) into the file and the name inside it."""
    text = str(path)
    endings = [(suffix, family) for family in FAMILIES if family.holds_several for suffix in family.suffixes]
    for sign in (":", "/", "\\"):
        for suffix, family in endings:
            # A folder within a folder that is a container (scan.zarr/0) is a part of that.
            if path.exists() and not (family.reads_folders and path.is_dir()):
                continue
            place = text.lower().find(suffix + sign)
            if place < 0:
                continue
            end = place + len(suffix)
            file, name = Path(text[:end]), text[end + 1 :].replace("\\", "/").strip("/")
            if name and (file.is_file() or (family.reads_folders and file.is_dir())):
                return file, name
    start, colon, name = text.rpartition(":")
    folder = Path(start)
    if colon and name and len(start) > 1 and folder.is_dir() and not path.exists():
        found = _by_contents(folder)
        if found is not None and found.holds_several:
            return folder, name.replace("\\", "/").strip("/")
    return path, None


def names_folder(path: Path) -> bool:
    """Return whether a path, which need not be there, stands for a folder by its name."""
    text = str(path).lower()
    if text.endswith(ome_zarr.FOLDER_SUFFIX) or f"{ome_zarr.FOLDER_SUFFIX}:" in text:
        return True
    containers = (suffix for family in FAMILIES if family.holds_several for suffix in family.suffixes)
    return not path.suffix and not any(f"{suffix}:" in text for suffix in containers)


__all__ = [
    "FAMILIES",
    "SUFFIXES",
    "Family",
    "ReadOptions",
    "Reading",
    "family_of",
    "names_folder",
    "split_dataset",
]
