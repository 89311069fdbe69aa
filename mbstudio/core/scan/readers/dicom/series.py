"""The slices of a DICOM series in their order along its normal, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.dicom.headers import Frame, Header, is_dicom, read_header
from mbstudio.core.scan.readers.orientation import lengths_of

SUFFIXES = (".dcm", ".dicom", ".dic", ".ima")
_IMAGES = (".tif", ".tiff", ".png", ".bmp", ".jpg", ".jpeg")
# Files without a telling name that are looked into to find out what a folder holds.
_LOOKED_INTO = 30
# Distances that differ by so much are not those of one series: a missing slice makes twice the usual.
_UNEVEN = 0.05
# So far, in pixels, slices may be shifted sideways.
_SHIFTED = 0.1


@dataclass(frozen=True, eq=False)
class Slice:
    """One frame of one file."""

    header: Header
    index: int

    @property
    def frame(self) -> Frame:
        return self.header.frames[self.index]

    @property
    def name(self) -> str:
        several = len(self.header.frames) > 1
        return f"{self.header.path.name}{f' frame {self.index + 1}' if several else ''}"


@dataclass(frozen=True, eq=False)
class Series:
    """Slices in their order.

    Attributes
    ----------
    slices : tuple of Slice
    steps : array, shape (3, 3), or None
        Row i is the step in mm along x, y, z (i = 0, 1, 2); None where the files do not say it.
    origin : array, shape (3,)
        Of the first pixel of the first slice.
    is_placed : bool
        Whether the files say where the slices lie.
    doubt : str or None
        Why there are no steps; a sentence's end.
    notes, size_notes : tuple of str
    """

    slices: tuple[Slice, ...]
    steps: Float[np.ndarray, "3 3"] | None
    origin: Float[np.ndarray, "3"]
    is_placed: bool
    doubt: str | None = None
    notes: tuple[str, ...] = ()
    size_notes: tuple[str, ...] = ()


def holds_dicom(folder: Path) -> bool:
    """Return whether a folder holds more DICOM files than images of other kinds."""
    dicom = images = looked = 0
    for entry in folder.iterdir():
        suffix = entry.suffix.lower()
        if suffix in _IMAGES:
            images += 1
        elif suffix in SUFFIXES:
            dicom += 1
        elif looked < _LOOKED_INTO and not entry.name.startswith(".") and entry.is_file():
            looked += 1
            dicom += is_dicom(entry)
    return dicom > images


def headers_of_folder(folder: Path) -> tuple[list[Header], tuple[str, ...]]:
    """Return the files of the one series of a folder, and what was left out.

    Raises
    ------
    ScanError
        If there is none, or there are several.
    """
    files, others = _files(folder)
    if not files:
        raise ScanError(
            f"The folder {folder} holds no DICOM slices: open the folder below it that holds them."
        )
    headers = [read_header(file) for file in files]
    series: dict[str, list[Header]] = {}
    for header in headers:
        series.setdefault(header.series, []).append(header)
    if len(series) > 1:
        told = "; ".join(
            f"{len(group)} like {group[0].path.name} ({group[0].title})"
            for group in list(series.values())[:5]
        )
        raise ScanError(
            f"The folder {folder} holds {len(series)} series ({told}): open a file of the one that is meant, "
            "or keep each in a folder of its own."
        )
    notes: tuple[str, ...] = ()
    if others:
        names = ", ".join(file.name for file in others[:5]) + (", ..." if len(others) > 5 else "")
        notes = (f"holds files that are not DICOM, which were left out: {names}.",)
    return headers, notes


def headers_like(path: Path) -> list[Header]:
    """Return the file alone if it has several frames, else the files of its series in its folder."""
    header = read_header(path)
    if len(header.frames) > 1:
        return [header]
    files, _ = _files(path.parent)
    beside = [read_header(file) for file in files if not file.samefile(path)]
    return [header, *(other for other in beside if other.series == header.series)]


def _files(folder: Path) -> tuple[list[Path], list[Path]]:
    """Return the DICOM files of a folder, and those that are none; hidden ones and directories left out."""
    entries = sorted(
        entry
        for entry in folder.iterdir()
        if entry.is_file() and not entry.name.startswith(".") and entry.name.upper() != "DICOMDIR"
    )
    files = [entry for entry in entries if entry.suffix.lower() in SUFFIXES or is_dicom(entry)]
    known = set(files)
    return files, [entry for entry in entries if entry not in known]


def in_order(headers: Sequence[Header], path: Path) -> Series:
    """Put the frames of one series in their order.

    They are sorted along the normal of their planes by ``ImagePositionPatient``, whose distances
    are those of the slices; where there are no positions, by ``InstanceNumber``.

    Raises
    ------
    ScanError
        If slices are missing, doubled, or do not belong together.
    """
    slices = [Slice(header, index) for header in headers for index in range(len(header.frames))]
    _require_alike(slices, path)
    there = [one.frame.position is not None for one in slices]
    if all(there) and slices[0].frame.orientation is not None:
        return _by_position(slices, path)
    if any(there[1:]) and len(headers) > 1:
        lacking = slices[there.index(False)] if False in there else slices[0]
        raise ScanError(
            f"{path} holds slices with and without a place ({lacking.name} has none): "
            "export all of them in the same way."
        )
    return _by_number(slices, path)


def _require_alike(slices: Sequence[Slice], path: Path) -> None:
    """Raise ScanError unless all slices are of one size, type, plane and pixel."""
    first = slices[0]
    for one in slices[1:]:
        mine, its = first.header, one.header
        if (mine.rows, mine.columns) != (its.rows, its.columns):
            raise ScanError(
                f"{path} holds slices of different sizes: {its.path.name} has {its.rows} x "
                f"{its.columns} pixels, "
                f"{mine.path.name} has {mine.rows} x {mine.columns}. Remove images that are no "
                "slices (localizers)."
            )
        if (mine.dtype, mine.samples, mine.white_is_zero) != (its.dtype, its.samples, its.white_is_zero):
            raise ScanError(
                f"{path} holds slices of different pixels: {its.path.name} and {mine.path.name}: "
                "export all with the same type."
            )
        for name, tolerance in (("orientation", 1e-3), ("spacing", 1e-6)):
            here, there = getattr(first.frame, name), getattr(one.frame, name)
            same = here is None and there is None
            if here is not None and there is not None:
                scale = float(np.abs(here).max())
                same = bool(np.allclose(here, there, rtol=0, atol=tolerance * scale))
            if not same:
                what = "planes" if name == "orientation" else "pixel sizes"
                raise ScanError(
                    f"{path} holds slices of different {what} ({first.name} and {one.name}): "
                    "keep the slices of one stack in a folder of their own."
                )


def _by_position(slices: Sequence[Slice], path: Path) -> Series:
    across = slices[0].frame.orientation
    assert across is not None
    lengths = lengths_of(across)
    if not np.allclose(lengths, 1, atol=1e-2) or abs(across[0] @ across[1]) > 1e-2:
        raise ScanError(
            f"{path} gives directions of rows and columns that are not at right angles: "
            "resample it to a rectangular grid first."
        )
    across = across / lengths[:, None]
    normal = np.cross(across[0], across[1])
    places = np.array([one.frame.position for one in slices])
    heights = places @ normal
    order = np.argsort(heights, kind="stable")
    ordered, heights, places = [slices[index] for index in order], heights[order], places[order]
    spacing = slices[0].frame.spacing
    size_notes: tuple[str, ...] = ()
    if len(ordered) > 1:
        _require_even([float(height) for height in heights], ordered, path)
        distance: float | None = float(heights[-1] - heights[0]) / (len(ordered) - 1)
        sideways = places - np.outer(heights, normal)
        shift = float(lengths_of(sideways - sideways[0]).max())
        pixel = min(spacing) if spacing is not None else distance
        if shift > _SHIFTED * float(pixel or 1):
            raise ScanError(
                f"{path} holds slices that are shifted sideways by up to {shift:g} mm, as of a "
                "tilted gantry: "
                "resample it to a rectangular grid first."
            )
    else:
        distance, size_notes = _stated_distance(ordered)
    if spacing is None or distance is None:
        return Series(tuple(ordered), None, places[0], True, _missing(spacing, distance))
    steps = np.array([across[0] * spacing[1], across[1] * spacing[0], normal * distance])
    return Series(tuple(ordered), steps, places[0], True, size_notes=size_notes)


def _by_number(slices: Sequence[Slice], path: Path) -> Series:
    """Put slices without places in the order of their numbers; frames of a file stay as they are."""
    notes: tuple[str, ...] = ()
    ordered = list(slices)
    if len({one.header.path for one in slices}) > 1:
        numbers = [one.header.number for one in slices]
        if None in numbers:
            lacking = slices[numbers.index(None)]
            raise ScanError(
                f"{path} holds slices without place or number ({lacking.name}): "
                "export them with ImagePositionPatient, or as images with numbered names."
            )
        ordered = sorted(slices, key=lambda one: (one.header.number or 0, one.index))
        _require_even([float(one.header.number or 0) for one in ordered], ordered, path)
        notes = ("says nothing of the places of its slices: they were put in the order of InstanceNumber.",)
    frame = slices[0].frame
    distance, size_notes = _stated_distance(ordered)
    if frame.spacing is None or distance is None:
        doubt = _missing(frame.spacing, distance)
        return Series(tuple(ordered), None, np.zeros(3), False, doubt, notes)
    steps = np.diag([frame.spacing[1], frame.spacing[0], distance])
    return Series(tuple(ordered), steps, np.zeros(3), False, None, notes, size_notes)


def _stated_distance(slices: Sequence[Slice]) -> tuple[float | None, tuple[str, ...]]:
    """Return the distance of slices that the files state, where their places do not tell it."""
    distance = slices[0].header.between
    if distance is None or any(one.header.between != distance for one in slices):
        return None, ()
    return distance, (
        f"says nothing of the places of its slices: they are taken to be {distance:g} mm apart, "
        "as SpacingBetweenSlices says.",
    )


def _missing(spacing: tuple[float, float] | None, distance: float | None) -> str | None:
    """Return what a series says of half of the voxel's edges, None if it says nothing."""
    if spacing is not None:
        return f"gives pixels of {spacing[0]:g} x {spacing[1]:g} mm, but not how far its slices are apart"
    return None if distance is None else f"gives slices {distance:g} mm apart, but no size of its pixels"


def _require_even(heights: Sequence[float], slices: Sequence[Slice], path: Path) -> None:
    """Raise ScanError if slices are missing or lie at one place."""
    steps = [after - before for before, after in pairwise(heights)]
    usual = float(np.median([step for step in steps if step > 0] or [0.0]))
    doubled = [index for index, step in enumerate(steps) if step <= _UNEVEN * usual]
    if doubled:
        one, two = slices[doubled[0]], slices[doubled[0] + 1]
        raise ScanError(
            f"{path} holds {len(doubled)} slices at the place of another, such as {one.name} and "
            f"{two.name}: keep "
            "one of each; if they are times or channels, keep each in a folder of its own."
        )
    gaps = [index for index, step in enumerate(steps) if abs(step - usual) > _UNEVEN * usual]
    if gaps:
        told = "; ".join(
            f"between {slices[index].name} and {slices[index + 1].name}"
            + (f" ({round(steps[index] / usual) - 1} missing)" if steps[index] > 1.5 * usual else "")
            for index in gaps[:3]
        )
        more = f" and at {len(gaps) - 3} more places" if len(gaps) > 3 else ""
        raise ScanError(
            f"{path} has gaps in its slices {told}{more}: copy the missing slices, or resample it "
            "to even distances."
        )
