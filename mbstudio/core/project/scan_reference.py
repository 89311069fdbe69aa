"""How a project remembers a scan, and finds it again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from mbstudio.core.errors import MbstudioError, ScanError
from mbstudio.core.project.state import ScanReference
from mbstudio.core.scan import Scan, open_scan, voxel_digest
from mbstudio.core.scan.opening import source_exists

HOW_TO_RELOCATE = "give its new place: project.relocate_scan(path), or --scan on the command line"


def refer_to(scan: Scan, *, embed: bool = False) -> ScanReference:
    """Return what a project keeps of a scan; this reads all voxels once for their digest.

    A scan that no file holds (the built-in sample) is always embedded.
    """
    dtype = np.dtype(scan.voxels.dtype)
    return ScanReference(
        path=scan.path,
        shape=scan.shape,
        dtype=dtype.name,
        voxel_size=scan.voxel_size,
        origin=scan.origin,
        digest=voxel_digest(scan),
        embedded=embed or scan.path is None,
        header_bytes=_header_bytes(scan),
        big_endian=dtype.str.startswith(">"),
        excerpt=scan.excerpt,
    )


def reopen_whole(reference: ScanReference) -> Scan:
    """Open all of the file that a project's scan is a part of, where it lies in space.

    Raises
    ------
    ScanError
        If the file is not there, cannot be read, or has another shape than it had.
    """
    excerpt = reference.excerpt
    if excerpt is None or reference.path is None:
        raise ScanError("The project's scan is not a part of a file: there is nothing more of it to show.")
    if not source_exists(reference.path):
        raise ScanError(
            f"The project's scan {reference.path} is not there. If it was moved, {HOW_TO_RELOCATE}."
        )
    size = excerpt.voxel_size_of_file(reference.voxel_size)
    scan = open_scan(
        reference.path, size, shape=excerpt.whole, dtype=reference.dtype,
        header_bytes=reference.header_bytes, big_endian=reference.big_endian,
    )  # fmt: skip
    if scan.shape != excerpt.whole:
        raise ScanError(
            f"{reference.path} holds other voxels than it did (shape {scan.shape}, expected "
            f"{excerpt.whole}): open it anew."
        )
    first = [[-start - (factor - 1) / 2 for start, factor in zip(excerpt.start, excerpt.bin, strict=True)]]
    x, y, z = (float(place) for place in size.positions(np.array(first), reference.origin)[0])
    return replace(scan, origin=(x, y, z))


def _header_bytes(scan: Scan) -> int:
    """Return the bytes before the first voxel of a mapped file."""
    if scan.excerpt is not None:
        return scan.excerpt.header_bytes
    return int(scan.voxels.offset) if isinstance(scan.voxels, np.memmap) else 0


def reopen(reference: ScanReference, path: Path | None = None) -> Scan:
    """Open the scan that a project refers to, at `path` or where it was.

    Raises
    ------
    ScanError
        If it is not there, cannot be read, or its voxels are not those of the project.
    """
    path = path or reference.path
    if path is None:
        raise ScanError("The project's scan is stored in the project file: open that file.")
    if not source_exists(path):
        raise ScanError(f"The project's scan {path} does not exist. If it was moved, {HOW_TO_RELOCATE}.")
    excerpt = reference.excerpt
    try:
        scan = open_scan(
            path,
            reference.voxel_size if excerpt is None else excerpt.voxel_size_of_file(reference.voxel_size),
            shape=reference.shape if excerpt is None else excerpt.whole,
            dtype=reference.dtype,
            header_bytes=reference.header_bytes,
            big_endian=reference.big_endian,
            crop=None if excerpt is None else excerpt.block,
            binning=None if excerpt is None else excerpt.bin,
        )
    except MbstudioError as error:
        raise ScanError(
            f"The project's scan cannot be opened: {error} If it is elsewhere, {HOW_TO_RELOCATE}."
        ) from error
    if scan.shape != reference.shape or scan.excerpt != excerpt or voxel_digest(scan) != reference.digest:
        raise ScanError(
            f"{path} is not the scan that the project was made with: its voxels differ (shape "
            f"{scan.shape}, expected {reference.shape}). If that scan is elsewhere, {HOW_TO_RELOCATE}."
        )
    return replace(scan, voxel_size=reference.voxel_size, origin=reference.origin)
