"""A folder of slices: one TIFF or PNG image a slice, in natural order of their names."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers import tiff
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions
from mbstudio.core.scan.slice_stack import SliceStack

TIFF_SUFFIXES = (".tif", ".tiff")
IMAGE_SUFFIXES = (*TIFF_SUFFIXES, ".png")


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Return a sorting key in which ``slice2`` comes before ``slice10``."""
    parts = re.split(r"(\d+)", name.lower())
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts]


def _image_files(folder: Path) -> list[Path]:
    """Return the images of the folder in natural order; hidden files are left out."""
    images = [
        entry
        for entry in folder.iterdir()
        if entry.is_file() and entry.suffix.lower() in IMAGE_SUFFIXES and not entry.name.startswith(".")
    ]
    kinds = {"TIFF" if entry.suffix.lower() in TIFF_SUFFIXES else "PNG" for entry in images}
    if not images:
        raise ScanError(f"The folder {folder} holds no slices: it needs TIFF or PNG images, one per slice.")
    if len(kinds) > 1:
        raise ScanError(f"The folder {folder} holds both TIFF and PNG images: keep one kind of slice in it.")
    return sorted(images, key=lambda entry: (natural_key(entry.stem), entry.name))


def _read_image(file: Path) -> np.ndarray:
    """Read one grey image."""
    import imageio.v3 as iio
    import tifffile

    try:
        image = tifffile.imread(file) if file.suffix.lower() in TIFF_SUFFIXES else iio.imread(file)
    except Exception as error:  # the codecs raise errors of many unrelated types
        raise ScanError(f"The slice {file} cannot be read ({error}): copy or export it again.") from error
    if image.ndim == 3 and image.shape[-1] in (3, 4):
        raise ScanError(f"The slice {file} is a colour image: convert the slices to grey values first.")
    if image.ndim != 2:
        raise ScanError(f"The slice {file} has {image.ndim} axes: export each slice as one image (y, x).")
    return np.asarray(image)


def read(path: Path, options: ReadOptions) -> Reading:
    """Read a folder of slices lazily; only the sizes of all images are looked at.

    Raises
    ------
    ScanError
        If there are no images, or they differ in size or type, or are in colour.
    """
    files = _image_files(path)
    first = _read_image(files[0])
    for file in files[1:]:
        shape, dtype = _declared(file)
        if shape != first.shape:
            raise ScanError(
                f"The slice {file} has {shape[0]} x {shape[1]} pixels, but {files[0].name} has "
                f"{first.shape[0]} x {first.shape[1]}: all slices of a folder must be of one size; "
                "remove images that are not slices (previews, projections)."
            )
        if dtype is not None and dtype != first.dtype:
            raise ScanError(
                f"The slice {file} holds {dtype}, but {files[0].name} holds {first.dtype}: "
                "export all with one type."
            )

    def read_slice(index: int) -> np.ndarray:
        image = _read_image(files[index])
        if image.shape != first.shape or image.dtype != first.dtype:
            raise ScanError(
                f"The slice {files[index]} has changed since the folder was opened: open it again."
            )
        return image

    stack = SliceStack(read_slice, (len(files), *first.shape), first.dtype)
    if files[0].suffix.lower() not in TIFF_SUFFIXES:
        return Reading(stack)
    spacing, unit, metadata = tiff.voxel_size_of(files[0])
    return Reading(stack, spacing, unit, metadata=metadata)


def _declared(file: Path) -> tuple[tuple[int, ...], np.dtype | None]:
    """Return shape and dtype (None: unknown) of an image from its header alone."""
    import tifffile
    from PIL import Image

    try:
        if file.suffix.lower() in TIFF_SUFFIXES:
            with tifffile.TiffFile(file) as document:
                return document.pages[0].shape, document.pages[0].dtype
        with Image.open(file) as image:
            return image.size[::-1], None
    except Exception as error:  # as in _read_image
        raise ScanError(f"The slice {file} cannot be read ({error}): copy or export it again.") from error


FAMILY = Family("folder of slices", (), read, reads_folders=True)
