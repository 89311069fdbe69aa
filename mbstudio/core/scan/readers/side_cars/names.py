"""What the name of a file of bare voxels says: `core_1000x1000x500_16bit_le.raw`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.family import Reading, ReadOptions, require_file
from mbstudio.core.scan.readers.side_cars.layout import RawLayout, open_layout

_THREE = re.compile(r"(?<![\d.x×])(\d{1,6})[x×](\d{1,6})[x×](\d{1,6})(?![\d.]*[x×]?\d)", re.IGNORECASE)
_TYPE = re.compile(
    r"(?<![a-z0-9])(?:(?P<numpy>u?int(?:8|16|32|64)|float(?:32|64))|(?P<bits>8|16|32)[-_ ]?bits?"
    r"(?P<real>[-_ ]?(?:float|real))?|(?P<word>u8|u16|uchar|ushort|short|byte|float|double))(?![a-z0-9])",
    re.IGNORECASE,
)
_WORDS = {
    "u8": "u1", "u16": "u2", "uchar": "u1", "byte": "u1", "ushort": "u2", "short": "i2", "float": "f4",
    "double": "f8",
}  # fmt: skip
_SIGNED = re.compile(r"(?<![a-z])signed(?![a-z])", re.IGNORECASE)
_LITTLE = re.compile(r"(?<![a-z])(?:le|lsb|little[-_ ]?endian|little)(?![a-z])", re.IGNORECASE)
_BIG = re.compile(r"(?<![a-z])(?:be|msb|big[-_ ]?endian|big)(?![a-z])", re.IGNORECASE)
# Runs of so many voxels are looked at, to see which order of axes and bytes makes neighbours alike.
_RUNS, _RUN = 96, 256
# The right order must be so much smoother than any other.
_CLEARLY = 0.8


def says_shape(path: Path) -> bool:
    """Return whether the name of a file has three numbers as in ``1000x1000x500``."""
    return _THREE.search(path.stem) is not None


def read_by_name(path: Path, options: ReadOptions) -> Reading | None:
    """Read voxels as the name of their file describes them, None if it does not.

    The numbers are those of voxels along x, y, z, as ImageJ, Open SciVis Datasets and the Digital
    Rocks Portal write them, or along z, y, x: which of them, the voxels must show, since neighbours are
    alike. So they must for the order of bytes, where the name does not say it. The length
    of the file must be exactly that of the voxels.

    Raises
    ------
    ScanError
        If the name does not fit the file, or could be meant in several ways.
    """
    if not says_shape(path):
        return None
    require_file(path)
    held = path.stat().st_size - options.header_bytes
    fitting = {
        (numbers, kind)
        for match in _THREE.finditer(path.stem)
        if min(numbers := (int(match[1]), int(match[2]), int(match[3]))) > 0
        for kind in _types(path, options)
        if math.prod(numbers) * np.dtype(kind).itemsize == held
    }
    kinds = ", ".join(np.dtype(kind).name for kind in _types(path, options))
    if not fitting:
        said = ", ".join(match[0] for match in _THREE.finditer(path.stem))
        raise ScanError(
            f"The name of {path} says {said} voxels, but it holds {held:,} bytes, which is not their length "
            f"as {kinds}: state shape and dtype, or copy it again if it is cut off."
        )
    if len(fitting) > 1:
        ways = " or ".join(sorted(f"{numbers[0]}x{numbers[1]}x{numbers[2]} of {np.dtype(kind).name}"
                                  for numbers, kind in fitting))  # fmt: skip
        raise ScanError(
            f"The name of {path} can be meant as {ways}: state shape and dtype, for example "
            f"shape=(400, 512, 512), dtype='uint16'."
        )
    numbers, kind = fitting.pop()
    order = _order(path, options, numbers, kind)
    layout = RawLayout(
        path,
        f"The name of {path}",
        order.shape,
        order.dtype,
        options.header_bytes,
        notes=(order.told,),
    )
    return open_layout(layout, ReadOptions())


def _types(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the types that the name of a file, or else the caller, allows."""
    if options.dtype is not None:
        return (options.dtype.str.lstrip("<>=|"),)
    signed = _SIGNED.search(path.stem) is not None
    kinds = []
    for match in _TYPE.finditer(path.stem):
        if match["numpy"]:
            kinds.append(np.dtype(match["numpy"].lower()).str.lstrip("<>=|"))
        elif match["word"]:
            kinds.append(_WORDS[match["word"].lower()])
        elif match["bits"] == "32":
            kinds.append(
                "i4" if signed and not match["real"] else "f4"
            )  # ImageJ's 32-bit images are real numbers
        else:
            kinds.append(("i" if signed else "u") + str(int(match["bits"]) // 8))
    # Of four bytes, real and whole numbers are as likely.
    return tuple(dict.fromkeys(kinds)) or ("u1", "u2")


@dataclass(frozen=True)
class _Order:
    shape: tuple[int, int, int]
    dtype: np.dtype
    told: str


def _order(path: Path, options: ReadOptions, numbers: tuple[int, int, int], kind: str) -> _Order:
    """Return in which order axes and bytes are, as the name and the voxels say."""
    first, second, third = numbers
    shapes = dict.fromkeys(((third, second, first), (first, second, third)))
    if np.dtype(kind).itemsize == 1:
        signs = ["|"]
    elif options.big_endian or (_BIG.search(path.stem) and not _LITTLE.search(path.stem)):
        signs = [">"]
    else:
        signs = ["<"] if _LITTLE.search(path.stem) and not _BIG.search(path.stem) else ["<", ">"]
    ways = [(shape, np.dtype(sign + kind)) for shape in shapes for sign in signs]
    shown = ""
    if len(ways) > 1:
        roughness = [_roughness(path, options.header_bytes, shape, dtype) for shape, dtype in ways]
        best = int(np.argmin(roughness))
        others = [value for index, value in enumerate(roughness) if index != best]
        if not np.isfinite(roughness[best]) or roughness[best] > _CLEARLY * min(others):
            asked = " and ".join(
                [*(["of its axes (shape)"] if len(shapes) > 1 else []),
                 *(["of its bytes (big_endian)"] if len(signs) > 1 else [])]
            )  # fmt: skip
            raise ScanError(
                f"The name of {path} says {first}x{second}x{third} voxels of {np.dtype(kind).name}, but "
                f"neither "
                f"it nor the voxels say the order {asked}: state shape=(z, y, x) and dtype."
            )
        ways = [ways[best]]
        shown = "; neighbouring voxels are alike only so"
    (shape, dtype), ending = ways[0], ""
    if dtype.itemsize > 1:
        ending = ", big-endian" if dtype.byteorder == ">" else ", little-endian"
    nz, ny, nx = shape
    return _Order(
        shape,
        dtype,
        f"is described by its name alone: taken as {nz} slices of {ny} rows of {nx} voxels of {dtype.name}"
        f"{ending}, which is exactly its length{shown}. State shape and dtype where that is wrong.",
    )


def _roughness(path: Path, header: int, shape: tuple[int, int, int], dtype: np.dtype) -> float:
    """Return how much neighbours differ, in standard deviations, if voxels are in this order."""
    nz, ny, nx = shape
    flat = np.memmap(path, dtype, "r", header, (nz * ny * nx,))
    steps = [step for step, count in ((1, nx), (nx, ny), (nx * ny, nz)) if count > 1]
    last = len(flat) - max(steps, default=0) - _RUN
    if not steps or last <= 0:
        return float("inf")
    starts = np.unique(np.linspace(0.1 * last, 0.9 * last, _RUNS).astype(np.int64))
    with np.errstate(all="ignore"):
        here = np.stack([flat[start : start + _RUN] for start in starts]).astype(float)
        spread = float(here.std())
        apart = [
            float(
                np.abs(np.stack([flat[start + step : start + step + _RUN] for start in starts]) - here).mean()
            )
            for step in steps
        ]
    total = sum(apart) / spread if spread > 0 else float("inf")
    return total if np.isfinite(total) and total > 0 else float("inf")
