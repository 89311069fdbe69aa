"""What a DICOM file says of its frames: pixels, place, and series; read by pydicom, without the pixels."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.text import one_line

_DEFLATED = "1.2.840.10008.1.2.1.99"
_BIG_ENDIAN = "1.2.840.10008.1.2.2"
_SEGMENTATIONS = ("1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7")
_PIXELS = {"PixelData": "iu", "FloatPixelData": "f4", "DoubleFloatPixelData": "f8"}
_ABSURD = 1e30


@dataclass(frozen=True, eq=False)
class Frame:
    """One slice.

    Attributes
    ----------
    position : array, shape (3,), or None
        Of the centre of its first pixel, in mm.
    orientation : array, shape (2, 3), or None
        Directions in which columns and rows go on.
    spacing : tuple of float or None
        Distance of rows, and of columns, in mm.
    slope, intercept : float
    """

    position: Float[np.ndarray, "3"] | None
    orientation: Float[np.ndarray, "2 3"] | None
    spacing: tuple[float, float] | None
    slope: float = 1.0
    intercept: float = 0.0


@dataclass(frozen=True, eq=False)
class Header:
    """One file.

    Attributes
    ----------
    path : Path
    series : str
        By which files of one series know each other.
    title : str
        What the series is called, for messages.
    number : int or None
        Which one of the series it is.
    syntax : str
        The transfer syntax: how pixels are packed.
    rows, columns, samples : int
    dtype : numpy dtype
        Of the stored numbers.
    bits : int
        How many bits of a number count.
    planar : bool
        Whether the samples of a pixel lie in planes of their own.
    white_is_zero : bool
    offset, length : int
        Where the pixels begin in the file, and how many bytes they take; -1 where that is not said.
    frames : tuple of Frame
    between : float or None
        The distance of slices that the file states, in mm.
    metadata : dict
    """

    path: Path
    series: str
    title: str
    number: int | None
    syntax: str
    rows: int
    columns: int
    samples: int
    dtype: np.dtype[Any]
    bits: int
    planar: bool
    white_is_zero: bool
    offset: int
    length: int
    frames: tuple[Frame, ...]
    between: float | None
    metadata: dict[str, Any]

    @property
    def frame_bytes(self) -> int:
        return self.rows * self.columns * self.samples * self.dtype.itemsize


def is_dicom(path: Path) -> bool:
    """Return whether a file begins as DICOM files do."""
    try:
        with path.open("rb") as stream:
            return stream.read(132)[128:] == b"DICM"
    except OSError:
        return False


def read_header(path: Path) -> Header:
    """Return what a file says of its frames.

    Raises
    ------
    ScanError
        If it is no DICOM file, damaged, or holds no grey image.
    """
    import pydicom
    from pydicom.filereader import read_file_meta_info

    if not is_dicom(path):
        raise ScanError(
            f"{path} does not begin as DICOM files do (DICM behind 128 bytes), although its name "
            "ends so: export it "
            "again, or give it that beginning, for example with dcmconv."
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about values that are not as the standard writes them
            syntax = str(read_file_meta_info(path).get("TransferSyntaxUID", ""))
            if syntax == _DEFLATED:
                raise ScanError(
                    f"{path} is deflated as a whole ({name_of(syntax)}), and what it would unpack "
                    "to is not told: "
                    "save it uncompressed, for example with dcmconv +te."
                )
            dataset = pydicom.dcmread(path, defer_size=256)
            return _header(dataset, syntax, path)
    except ScanError:
        raise
    except Exception as error:  # pydicom raises errors of many types, MemoryError too
        raise ScanError(
            f"{path} cannot be read as DICOM ({type(error).__name__}: {one_line(error)}): it is "
            "damaged or cut off; "
            "copy or export it again."
        ) from error


def name_of(uid: str) -> str:
    """Return what the standard calls a unique identifier, itself if it has no name."""
    from pydicom.uid import UID_dictionary

    return UID_dictionary[uid][0] if uid in UID_dictionary else uid


def _header(dataset: Any, syntax: str, path: Path) -> Header:
    kind = str(dataset.get("SOPClassUID", ""))
    if kind in _SEGMENTATIONS:
        raise ScanError(
            f"{path} is a DICOM segmentation, whose segments are frames of their own: export it as a label "
            "map, for example in Slicer as NRRD or NIfTI."
        )
    keyword = next((name for name in _PIXELS if name in dataset), None)
    if keyword is None and not kind:  # pydicom hands out nothing of what ends too early
        raise ScanError(f"{path} is cut off or damaged: copy or export it again.")
    if keyword is None:
        raise ScanError(f"{path} holds no image ({name_of(kind)}): open the folder of the slices.")
    dtype, bits = _numbers(dataset, keyword, syntax, path)
    rows, columns = _count(dataset, "Rows", path), _count(dataset, "Columns", path)
    samples = _count(dataset, "SamplesPerPixel", path, 1)
    photometric = str(dataset.get("PhotometricInterpretation", "MONOCHROME2")).strip().upper()
    if photometric not in ("MONOCHROME1", "MONOCHROME2", "RGB") or samples != (
        3 if photometric == "RGB" else 1
    ):
        raise ScanError(
            f"{path} is stored in the colours {photometric}: convert it to grey values (MONOCHROME2) first."
        )
    if "ModalityLUTSequence" in dataset:
        raise ScanError(
            f"{path} is rescaled by a table (Modality LUT), which is not read: export it with slope "
            "and intercept."
        )
    pixels = dataset.get_item(keyword, keep_deferred=True)
    offset = getattr(pixels, "value_tell", None) or getattr(pixels, "file_tell", None)
    if offset is None:
        raise ScanError(f"{path} does not tell where its pixels begin: export it again.")
    length = getattr(pixels, "length", None)
    if length is None:
        length = len(pixels.value)
    frames = _frames(dataset, _count(dataset, "NumberOfFrames", path, 1), path)
    return Header(
        path=path,
        series=str(dataset.get("SeriesInstanceUID", "")),
        title=_title(dataset),
        number=_whole(dataset.get("InstanceNumber")),
        syntax=syntax,
        rows=rows,
        columns=columns,
        samples=samples,
        dtype=dtype,
        bits=bits,
        planar=samples > 1 and _whole(dataset.get("PlanarConfiguration")) == 1,
        white_is_zero=photometric == "MONOCHROME1",
        offset=int(offset),
        length=-1 if length == 0xFFFFFFFF else int(length),
        frames=frames,
        between=_positive(dataset.get("SpacingBetweenSlices")),
        metadata=_metadata(dataset, syntax),
    )


def _title(dataset: Any) -> str:
    words = str(dataset.get("SeriesDescription") or "").strip()
    number = str(dataset.get("SeriesNumber") or "").strip()
    return words or (f"series {number}" if number else "a series without a name")


def _metadata(dataset: Any, syntax: str) -> dict[str, Any]:
    names = ("Modality", "Manufacturer", "ManufacturerModelName", "SeriesDescription", "SliceThickness",
             "KVP", "StudyDate")  # fmt: skip
    facts = {name: str(dataset[name].value) for name in names if name in dataset}
    return {**facts, "TransferSyntax": name_of(syntax) if syntax else "not said"}


def _numbers(dataset: Any, keyword: str, syntax: str, path: Path) -> tuple[np.dtype[Any], int]:
    """Return the type of the stored numbers, and how many of their bits count."""
    order = ">" if syntax == _BIG_ENDIAN else "<"
    if keyword != "PixelData":
        dtype = np.dtype(order + _PIXELS[keyword])
        return dtype, 8 * dtype.itemsize
    allocated = _count(dataset, "BitsAllocated", path)
    stored = _count(dataset, "BitsStored", path, allocated)
    high = _whole(dataset.get("HighBit"))
    if allocated not in (8, 16, 32) or not 2 <= stored <= allocated or high not in (None, stored - 1):
        raise ScanError(
            f"{path} stores pixels of {stored} in {allocated} bits, up to bit {high}, which is not read: "
            "export it with 8, 16 or 32 bits a pixel."
        )
    if order == ">" and allocated == 8:
        raise ScanError(f"{path} stores bytes in big-endian words: save it as little-endian.")
    kind = "i" if _whole(dataset.get("PixelRepresentation")) == 1 else "u"
    return np.dtype(f"{order}{kind}{allocated // 8}"), stored


def _count(dataset: Any, name: str, path: Path, default: int | None = None) -> int:
    number = _whole(dataset.get(name))
    if number is None and name not in dataset:
        number = default
    if number is None or number < 1:
        raise ScanError(f"{path} does not say its {name}, or says what cannot be: export it again.")
    return number


def _whole(value: Any) -> int | None:
    try:
        return int(value)
    except (TypeError, ValueError, OverflowError):
        return None


def _positive(value: Any) -> float | None:
    numbers = _floats(value, 1)
    return float(numbers[0]) if numbers is not None and numbers[0] > 0 else None


def _floats(value: Any, count: int) -> np.ndarray | None:
    """Return so many numbers, None if they are not there or none."""
    if value is None:
        return None
    try:
        numbers = [float(part) for part in (value if count > 1 else [value])]
    except (TypeError, ValueError, OverflowError):
        return None
    if len(numbers) != count or not all(math.isfinite(part) and abs(part) < _ABSURD for part in numbers):
        return None
    return np.array(numbers)


# Frames -----------------------------------------------------------------------------------------------


def _frames(dataset: Any, count: int, path: Path) -> tuple[Frame, ...]:
    """Return each frame's place and scale: of its own group, of the shared one, or of the whole file."""
    shared = _first(dataset.get("SharedFunctionalGroupsSequence"))
    groups = list(dataset.get("PerFrameFunctionalGroupsSequence") or ())
    if groups and len(groups) != count:
        raise ScanError(
            f"{path} states {count} frames, but describes {len(groups)}: it is damaged; copy or "
            "export it again."
        )
    if not groups:
        whole = _frame((shared, dataset), path)
        # What lies at one place is one slice: of several frames the place of the first is not theirs.
        if count > path.stat().st_size:
            raise ScanError(f"{path} states {count:,} frames, more than it has bytes: export it again.")
        rest = Frame(None, whole.orientation, whole.spacing, whole.slope, whole.intercept)
        return (whole, *((rest,) * (count - 1)))
    return tuple(_frame((group, shared, dataset), path) for group in groups)


def _first(sequence: Any) -> Any:
    return sequence[0] if sequence else None


def _found(places: tuple[Any, ...], sequence: str, name: str) -> Any:
    """Return a value of the first of some groups that has it, in its sequence or by itself."""
    for place in places:
        if place is None:
            continue
        inside = _first(place.get(sequence))
        for holder in (inside, place):
            if holder is not None and holder.get(name) is not None:
                return holder.get(name)
    return None


def _frame(places: tuple[Any, ...], path: Path) -> Frame:
    position = _floats(_found(places, "PlanePositionSequence", "ImagePositionPatient"), 3)
    directions = _floats(_found(places, "PlaneOrientationSequence", "ImageOrientationPatient"), 6)
    edges = _floats(_found(places, "PixelMeasuresSequence", "PixelSpacing"), 2)
    scale = "PixelValueTransformationSequence"
    slope, intercept = (_found(places, scale, name) for name in ("RescaleSlope", "RescaleIntercept"))
    factors = (
        _floats(1.0 if slope is None else slope, 1),
        _floats(0.0 if intercept is None else intercept, 1),
    )
    if factors[0] is None or factors[1] is None or factors[0][0] == 0:
        raise ScanError(
            f"{path} rescales its values by {slope} and {intercept} (RescaleSlope, "
            "RescaleIntercept), which cannot "
            "be meant: correct it or export it again."
        )
    return Frame(
        position,
        None if directions is None else directions.reshape(2, 3),
        None if edges is None else (float(edges[0]), float(edges[1])),
        float(factors[0][0]),
        float(factors[1][0]),
    )
