"""Readers, one module a file family: a new family is a new module and one line here."""

from __future__ import annotations

from pathlib import Path

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers import meta_image, npy, nrrd, raw, slices, tiff
from mbstudio.core.scan.readers.family import Family, Reading, ReadOptions

FAMILIES: tuple[Family, ...] = (
    tiff.FAMILY,
    slices.FAMILY,
    raw.FAMILY,
    npy.FAMILY,
    nrrd.FAMILY,
    meta_image.FAMILY,
)


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
    endings = ", ".join(suffix for family in FAMILIES for suffix in family.suffixes)
    raise ScanError(
        f"{path} is not a scan that mbstudio can read ({endings}, or a folder of slices): "
        "for RAW voxels give shape and dtype."
    )


__all__ = ["FAMILIES", "Family", "ReadOptions", "Reading", "family_of"]
