"""NIfTI (.nii, .nii.gz): memory-mapped where it is uncompressed; header and affine by nibabel."""

from __future__ import annotations

import gzip
import math
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.grid import Grid
from mbstudio.core.scan.readers.family import (
    Family,
    Reading,
    ReadOptions,
    require_grey_volume,
    require_memory,
)
from mbstudio.core.scan.readers.orientation import along_axes, impossible, lengths_of
from mbstudio.core.scan.readers.pixels import PixelMeaning, decode
from mbstudio.core.scan.readers.text import plain_text
from mbstudio.core.scan.readers.unpacking import unpacked
from mbstudio.core.scan.scan import VoxelArray
from mbstudio.core.scan.slice_stack import SliceStack
from mbstudio.core.units import conversion_factor

# Bytes of the header of NIfTI-1 and NIfTI-2, by which files of both begin.
_HEADERS = {348: (b"n+1\0", b"ni1\0", 344), 540: (b"n+2\0", b"ni2\0", 4)}
_UNITS = {1: "m", 2: "mm", 3: "um"}
# A mapped volume whose numbers must be rescaled is decoded at once up to this size, else slice by slice.
DECODE_AT_ONCE_BYTES = 2 << 30
# Millimetres are believed below this, as in MetaImage: ITK writes them for whatever it was given.
_PLAIN_MILLIMETRES = 1.0
# Numbers of a header from here on are no lengths and no scales.
_ABSURD = 1e30
# What some programs leave behind the voxels.
_SPARE = 2**20
_EXPORT = "copy or export it again."


@dataclass(frozen=True, eq=False)
class _Contents:
    """The stored voxels of a file, as its header describes them."""

    shape: tuple[int, int, int]
    dtype: np.dtype[Any]
    offset: int
    meaning: PixelMeaning


def read(path: Path, options: ReadOptions) -> Reading:
    """Read a NIfTI-1 or NIfTI-2 file of one volume.

    The affine (``sform``, else ``qform``) places the voxels; its right-anterior-superior axes are
    brought to the left-posterior-superior ones of ITK, so that a scan is the same in either
    format. Without an affine there are only edges. The unit is that of ``xyzt_units``.

    Raises
    ------
    ScanError
        If the file is damaged, cut off, or no grey volume.
    """
    packed = _is_packed(path)
    header = _header(path, packed)
    contents = _contents(header, path)
    raw = _unpacked(path, contents) if packed else _mapped(path, contents)
    voxels = _decoded(raw, contents, path, options.numbers)
    metadata = {
        "description": plain_text(bytes(header["descrip"])).strip("\0 "),
        "intent_code": int(header["intent_code"]),
        "sform_code": int(header["sform_code"]),
        "qform_code": int(header["qform_code"]),
    }
    unit_code = int(header["xyzt_units"]) & 7
    unit = _UNITS.get(unit_code)
    unit_word = None if unit is not None or unit_code == 0 else f"code {unit_code} of NIfTI"
    steps, origin, is_placed = _steps(header)
    wrong = impossible(steps)
    if wrong is not None:
        return Reading(voxels, metadata=metadata, doubt=wrong)
    doubt = _doubt(header, steps, unit)
    grid = Grid(steps, origin, unit) if is_placed else None
    if grid is not None:
        grid = grid.turned_half_about_z()
        steps, origin = grid.steps, grid.origin
    voxels, spacing, corner, flipped = along_axes(voxels, steps, origin, path)
    if grid is not None:
        grid = None if grid.is_placeholder else replace(grid, flipped=flipped)
    return Reading(voxels, spacing, unit, unit_word, corner, metadata, grid=grid, doubt=doubt)


def _is_packed(path: Path) -> bool:
    """Return whether a file is gzipped, whatever its name says."""
    with path.open("rb") as stream:
        return stream.read(2) == b"\x1f\x8b"


def _opened(path: Path, packed: bool) -> BinaryIO:
    return gzip.open(path, "rb") if packed else path.open("rb")  # type: ignore[return-value]


def _read_bytes(path: Path, packed: bool, count: int) -> bytes:
    """Return so many bytes from the beginning of what is stored; no more is unpacked."""
    try:
        with _opened(path, packed) as stream:
            return stream.read(count)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ScanError(
            f"{path} cannot be unpacked ({error}): it is damaged or cut off; {_EXPORT}"
        ) from error


def _header(path: Path, packed: bool) -> Any:
    """Return nibabel's header."""
    import nibabel

    block = _read_bytes(path, packed, 540)
    for order in ("little", "big"):
        size = int.from_bytes(block[:4], order)
        if size not in _HEADERS or len(block) < size:
            continue
        single, pair, place = _HEADERS[size]
        magic = block[place : place + 4]
        if magic == pair:
            raise ScanError(
                f"{path} keeps its voxels in a file of their own (.img): save both as one file, "
                ".nii or .nii.gz."
            )
        if magic != single:
            break
        kind = nibabel.Nifti1Header if size == 348 else nibabel.Nifti2Header
        return kind(block[:size], "<" if order == "little" else ">", check=False)  # type: ignore[no-untyped-call]
    raise ScanError(f"{path} is not a NIfTI file, although its name ends so: {_EXPORT}")


def _contents(header: Any, path: Path) -> _Contents:
    """Return what the header says of the voxels; ScanError if they are no grey volume."""
    from nibabel.spatialimages import HeaderDataError

    counts = [int(count) for count in header["dim"][1 : 1 + max(int(header["dim"][0]), 0)]]
    while len(counts) > 3 and counts[-1] == 1:
        counts.pop()
    counts += [1] * (3 - len(counts) if len(counts) == 2 else 0)
    if len(counts) > 3:
        raise ScanError(
            f"{path} contains more than one volume ({' x '.join(map(str, counts))} along x, y, z, t and "
            "further axes): save one channel and one time step as its own file."
        )
    if len(counts) < 3 or min(counts) < 1:
        raise ScanError(
            f"{path} does not say how many voxels it holds (dim = {header['dim'].tolist()}): export it again."
        )
    try:
        dtype = np.dtype(header.get_data_dtype())
    except (HeaderDataError, KeyError) as error:
        code = int(header["datatype"])
        raise ScanError(
            f"{path} contains values of a type that NIfTI does not know (code {code}): export it again."
        ) from error
    samples = len(dtype.names) if dtype.names else 1
    x, y, z = counts
    require_grey_volume((z, y, x), dtype[0] if dtype.names else dtype, path)
    if dtype.kind == "f" and dtype.itemsize > 8:
        raise ScanError(f"{path} contains values of type {dtype}: export them in single or double precision.")
    bits = 8 * (dtype[0] if dtype.names else dtype).itemsize
    slope, intercept = _scaling(header, path)
    offset = float(header["vox_offset"])
    if not math.isfinite(offset) or offset != int(offset):
        raise ScanError(f"{path} says that its voxels begin at byte {offset}: export it again.")
    smallest = int(header["sizeof_hdr"])
    meaning = PixelMeaning(bits=bits, samples=samples, slope=slope, intercept=intercept)
    return _Contents((z, y, x), dtype, max(int(offset), smallest), meaning)


def _scaling(header: Any, path: Path) -> tuple[float, float]:
    """Return slope and intercept of the values; a slope of zero means that there are none."""
    slope, intercept = float(header["scl_slope"]), float(header["scl_inter"])
    if slope == 0 or (math.isnan(slope) and math.isnan(intercept)):
        return 1.0, 0.0
    if not (abs(slope) < _ABSURD and abs(intercept) < _ABSURD):
        raise ScanError(
            f"{path} rescales its values by {slope:g} and {intercept:g} (scl_slope, scl_inter), which "
            "cannot be meant: correct it or export it again."
        )
    return slope, intercept


def _require_bytes(path: Path, contents: _Contents, there: int) -> None:
    needed = math.prod(contents.shape) * contents.dtype.itemsize
    if contents.offset + needed > there:
        raise ScanError(
            f"{path} states {' x '.join(map(str, contents.shape))} voxels (z, y, x) of {contents.dtype}, "
            f"{needed:,} bytes behind byte {contents.offset:,}, but holds {there:,}: "
            "it is cut off, or the header is wrong."
        )


def _mapped(path: Path, contents: _Contents) -> np.ndarray:
    _require_bytes(path, contents, path.stat().st_size)
    return np.memmap(path, contents.dtype, "r", contents.offset, contents.shape)


def _unpacked(path: Path, contents: _Contents) -> np.ndarray:
    """Unpack as many bytes as the header states, and no more."""
    needed = math.prod(contents.shape) * contents.dtype.itemsize
    stored = path.stat().st_size
    require_memory((contents.offset + needed,), 1, path, stored)
    require_memory(contents.shape, contents.dtype.itemsize, path, stored)
    with path.open("rb") as stream:
        block = unpacked(stream, "gzip", contents.offset + needed, path, spare=_SPARE)
    return block[contents.offset :].view(contents.dtype).reshape(contents.shape)


def _decoded(raw: np.ndarray, contents: _Contents, path: Path, numbers: bool) -> VoxelArray:
    """Return the values; of a mapped volume that must be rescaled, slice by slice where it is large."""
    meaning = contents.meaning
    if meaning.samples > 1:
        require_memory(contents.shape, contents.dtype.itemsize, path)
        raw = raw.view(raw.dtype[0]).reshape((*contents.shape, meaning.samples))
    if not meaning.is_rescaled or not isinstance(raw, np.memmap) or raw.nbytes <= DECODE_AT_ONCE_BYTES:
        return decode(raw, meaning, path, numbers=numbers)

    def read_slice(index: int) -> np.ndarray:
        return decode(np.asarray(raw[index]), meaning, path, numbers=numbers)

    return SliceStack(read_slice, contents.shape, read_slice(0).dtype)


def _steps(header: Any) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"], bool]:
    """Return the steps along x, y, z, the first voxel's place, and whether the file places its voxels."""
    affine = None
    if int(header["sform_code"]) > 0:
        affine = np.asarray(header.get_sform(), dtype=float)
    elif int(header["qform_code"]) > 0:
        affine = _qform(header)
    edges = _edges_of_header(header)
    if affine is not None and not (np.abs(affine) < _ABSURD).all():
        return np.full((3, 3), np.nan), np.zeros(3), False
    if affine is None:
        return np.diag(edges), np.zeros(3), False
    steps, origin = affine[:3, :3].T, np.array([_decimal(part) for part in affine[:3, 3]])
    lengths = lengths_of(steps)
    if lengths.min() > 0 and np.allclose(lengths, edges, rtol=1e-5, atol=0):
        steps = steps * (edges / lengths)[:, None]
    return steps, origin, True


def _edges_of_header(header: Any) -> Float[np.ndarray, "3"]:
    edges = np.array([abs(_decimal(edge)) for edge in header["pixdim"][1:4]])
    return np.where(edges < _ABSURD, edges, np.nan)


def _decimal(number: Any) -> float:
    """Return a number as it was written: 0.014, where single precision makes it 0.014000000432."""
    value = float(number)
    if not abs(value) < _ABSURD:
        return value
    return float(str(np.float32(value))) if np.float32(value) == value else value


def _qform(header: Any) -> Float[np.ndarray, "4 4"]:
    """Return the affine of the quaternion, not numbers where that is none."""
    from nibabel.spatialimages import HeaderDataError

    try:
        return np.asarray(header.get_qform(), dtype=float)
    except (HeaderDataError, ValueError):
        return np.full((4, 4), np.nan)


def _doubt(header: Any, steps: Float[np.ndarray, "3 3"], unit: str | None) -> str | None:
    """Return why the edges are not believed: two that differ, or millimetres that programs write unasked."""
    edges = lengths_of(steps)
    said = _edges_of_header(header)
    if not np.allclose(edges, said, rtol=1e-3, atol=0):
        return f"gives two voxel sizes: {_listed(edges)} (x, y, z) by its affine, {_listed(said)} by pixdim"
    if unit is not None and edges.max() * conversion_factor(unit, "mm") >= _PLAIN_MILLIMETRES:
        return (
            f"gives a voxel size of {_listed(edges[::-1])} {unit} (z, y, x), as large as programs write "
            "where they know none or mean micrometres"
        )
    return None


def _listed(edges: Float[np.ndarray, "3"]) -> str:
    return " x ".join(f"{edge:g}" for edge in edges)


FAMILY = Family("NIfTI volume", (".nii", ".nii.gz"), read)
