"""A folder of slices: one TIFF, PNG, BMP or JPEG image a slice, in the order of their numbers."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers import picture, tiff
from mbstudio.core.scan.readers.family import (
    Family,
    Reading,
    ReadOptions,
    memory_refusal,
    require_grey_volume,
)
from mbstudio.core.scan.readers.side_cars.beside_slices import size_beside_slices
from mbstudio.core.scan.readers.skyscan import find_log
from mbstudio.core.scan.readers.slice_names import SliceOrder, order_slices
from mbstudio.core.scan.slice_stack import SliceStack

TIFF_SUFFIXES = (".tif", ".tiff")
_KINDS = {
    ".tif": "TIFF", ".tiff": "TIFF", ".png": "PNG", ".bmp": "BMP", ".jpg": "JPEG", ".jpeg": "JPEG",
}  # fmt: skip
# What scanners put beside the slices: a preview (SkyScan) and pictures of the settings.
_PREVIEWS = ("_spr", "_arc", "_tra", "_pseudo3d")


def read(path: Path, options: ReadOptions) -> Reading:
    """Read a folder of slices lazily; only the headers of all images are looked at.

    Raises
    ------
    ScanError
        If there are no images, or they differ in size or type, are in colour, are of two series,
        or some are missing.
    """
    files, notes = _slices(path)
    first, white_is_zero = _read_image(files[0], options.numbers)
    require_grey_volume((len(files), *first.shape), first.dtype, path)

    def read_slice(index: int) -> np.ndarray:
        image, _ = _read_image(files[index], options.numbers)
        if image.shape != first.shape:
            raise ScanError(
                f"The slice {files[index]} has changed since the folder was opened: open it again."
            )
        if image.dtype != first.dtype:
            raise ScanError(
                f"The slice {files[index]} contains {image.dtype}, but {files[0].name} contains "
                f"{first.dtype}: export all with the same type."
            )
        return image

    ny, nx = first.shape
    stack = SliceStack(read_slice, (len(files), ny, nx), first.dtype)
    log = find_log(path, files[0])
    if log is not None:
        fields = {**log.fields, "log": log.path.name}
        return Reading(
            stack,
            log.spacing,
            "um",
            metadata=fields,
            notes=(*notes, *log.notes),
            white_is_zero=white_is_zero,
        )
    beside = size_beside_slices(path, stack.shape)
    if beside is not None:
        notes = (*notes, *beside.notes)
        if beside.spacing is not None:
            return Reading(
                stack, beside.spacing, beside.unit, beside.unit_word, metadata=beside.metadata, notes=notes,
                white_is_zero=white_is_zero,
            )  # fmt: skip
    if files[0].suffix.lower() not in TIFF_SUFFIXES:
        return Reading(stack, notes=notes, white_is_zero=white_is_zero)
    size = tiff.stated_size_of(files[0])
    size_notes = size.notes
    if size.spacing is not None and not size.notes and "spacing" not in size.metadata:
        size_notes = tiff.note_assumed_spacing(size)
    return Reading(
        stack, size.spacing, size.unit, size.unit_word, metadata=size.metadata, notes=notes,
        size_notes=size_notes, doubt=size.doubt, white_is_zero=white_is_zero,
    )  # fmt: skip


def _slices(folder: Path) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Return the slices of a folder in their order, and what was taken for granted."""
    images = _image_files(folder)
    described = {file: _described(file) for file in images}
    sizes = Counter(size for size, _ in described.values())
    usual = max(sizes, key=lambda size: sizes[size])
    order = order_slices(images, folder)
    notes = list(order.notes)
    _require_strays(order, described, usual, folder)
    if order.left_out:
        names = ", ".join(file.name for file in order.left_out)
        notes.append(f"contains images with other names and sizes, which were left out: {names}.")
    head = described[order.files[0]]
    for file in order.files[1:]:
        shape, kind = described[file]
        if shape != head[0]:
            raise ScanError(
                f"The slice {file} has {shape[0]} x {shape[1]} pixels, but {order.files[0].name} has "
                f"{head[0][0]} x {head[0][1]}: all slices of a folder must have the same size; "
                "remove images that are not slices (previews, projections)."
            )
        if kind != head[1]:
            raise ScanError(
                f"The pixels of the slice {file} ({kind}) differ from those of {order.files[0].name} "
                f"({head[1]}): export all with the same type."
            )
    return order.files, tuple(notes)


def _require_strays(
    order: SliceOrder,
    described: dict[Path, tuple[tuple[int, int], str]],
    usual: tuple[int, int],
    folder: Path,
) -> None:
    """Refuse images of other names that could be slices, being of the size of slices."""
    for file in order.left_out:
        if described[file][0] == usual and not file.stem.lower().endswith(_PREVIEWS):
            raise ScanError(
                f"The folder {folder} contains {file.name} among slices such as {order.files[0].name}, of "
                "the same "
                "size but numbered differently: remove it, or rename it like the other slices."
            )


def _image_files(folder: Path) -> list[Path]:
    """Return the images of the folder; hidden files are left out."""
    images = [
        entry
        for entry in folder.iterdir()
        if entry.is_file() and entry.suffix.lower() in _KINDS and not entry.name.startswith(".")
    ]
    there = {_KINDS[entry.suffix.lower()] for entry in images}
    kinds = [kind for kind in dict.fromkeys(_KINDS.values()) if kind in there]
    if not images:
        raise ScanError(
            f"The folder {folder} contains no slices: it needs TIFF, PNG, BMP or JPEG images, one per slice."
        )
    if len(kinds) > 1:
        raise ScanError(
            f"The folder {folder} contains both {' and '.join(kinds)} images: keep one kind of slice in it."
        )
    return images


def _read_image(file: Path, numbers: bool) -> tuple[np.ndarray, bool]:
    """Read one grey image; whether white is zero."""
    try:
        if file.suffix.lower() in TIFF_SUFFIXES:
            image, white_is_zero = tiff.read_image(file, numbers)
        else:
            image, white_is_zero = picture.read_picture(file, numbers), False
    except ScanError:
        raise
    except MemoryError as error:
        raise memory_refusal(file) from error
    except Exception as error:  # the codecs raise errors of many unrelated types
        raise ScanError(f"The slice {file} cannot be read ({error}): copy or export it again.") from error
    if image.ndim != 2:
        raise ScanError(f"The slice {file} has {image.ndim} axes: export each slice as one image (y, x).")
    return np.asarray(image), white_is_zero


def _described(file: Path) -> tuple[tuple[int, int], str]:
    """Return size and kind of pixels of an image from its header alone."""
    try:
        if file.suffix.lower() in TIFF_SUFFIXES:
            return tiff.describe_image(file)
        return picture.describe_picture(file)
    except ScanError:
        raise
    except Exception as error:  # as in _read_image
        raise ScanError(f"The slice {file} cannot be read ({error}): copy or export it again.") from error


FAMILY = Family("folder of slices", (), read, reads_folders=True)
