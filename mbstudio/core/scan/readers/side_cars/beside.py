"""Finding what describes a file of bare voxels, beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers import meta_image, nrrd
from mbstudio.core.scan.readers.family import Reading, ReadOptions, require_beside, require_file
from mbstudio.core.scan.readers.side_cars import envi, esrf, nikon, phoenix, voreen
from mbstudio.core.scan.readers.side_cars.layout import RawLayout, open_layout
from mbstudio.core.units import METRES_PER_UNIT

# By their ending: whether a file of that name describes voxels at all, and what it says about those beside.
_DESCRIPTIONS: dict[str, tuple[Callable[[Path], bool] | None, Callable[[Path, Path], RawLayout | None]]] = {
    ".vgi": (None, nikon.describe_vgi),
    ".xtekct": (None, nikon.describe_xtek),
    ".xtekVolume": (None, nikon.describe_xtek),
    ".pcr": (None, phoenix.describe),
    ".info": (esrf.is_pyhst, esrf.describe),
    ".hdr": (envi.is_envi, envi.describe),
    ".dat": (voreen.is_description, voreen.describe),
}
_OF_SCANNERS = (".vgi", ".xtekct", ".xtekVolume", ".pcr")
# Headers that name their file of voxels themselves.
_HEADERS = {".mhd": meta_image, ".nhdr": nrrd}
# Sizes in side-cars are rounded.
_SAME_SIZE = 1e-3


def is_described(data: Path) -> bool:
    """Return whether something beside a file seems to describe it."""
    return next(_beside(data), None) is not None


def read_beside(data: Path, options: ReadOptions) -> Reading | None:
    """Read voxels as the side-cars beside them say, None if there are none.

    Raises
    ------
    ScanError
        If a side-car is incomplete or does not fit, or two say different things.
    """
    found = [
        (path, reading)
        for path, ending in _beside(data)
        if (reading := _read(path, ending, data, options)) is not None
    ]
    if not found:
        return None
    first, reading = found[0]
    for path, other in found[1:]:
        if reading.voxels.shape != other.voxels.shape or reading.voxels.dtype != other.voxels.dtype:
            raise ScanError(
                f"{first} and {path.name} describe the voxels in {data.name} differently "
                f"({_told(reading)}; {_told(other)}): keep the right one."
            )
        mine, its = _metres(reading), _metres(other)
        if mine is None and its is not None:
            first, reading = path, other
        elif mine is not None and its is not None and not np.allclose(mine, its, rtol=_SAME_SIZE, atol=0):
            raise ScanError(
                f"{first} and {path.name} give different voxel sizes ({_edges(reading)} and "
                f"{_edges(other)}): keep the right one."
            )
    return reading


def _beside(data: Path) -> Iterator[tuple[Path, str]]:
    """Yield what lies beside a file under its name and the ending of a side-car, with that ending."""
    # What scanners write describes their .vol, and not another file of its name.
    is_other = data.suffix.lower() != ".vol" and any(
        data.with_suffix(end).exists() for end in (".vol", ".VOL")
    )
    for ending in (*_DESCRIPTIONS, *_HEADERS):
        if is_other and ending in _OF_SCANNERS:
            continue
        for name in dict.fromkeys(
            stem + end for stem in (data.stem, data.name) for end in (ending, ending.lower(), ending.upper())
        ):
            path = data.with_name(name)
            if path == data or not path.exists() or path.is_dir():
                continue
            is_one = _DESCRIPTIONS[ending][0] if ending in _DESCRIPTIONS else None
            require_file(path)
            if is_one is None or is_one(path):
                yield path, ending
                break


def _read(path: Path, ending: str, data: Path, options: ReadOptions) -> Reading | None:
    require_beside(data, path)
    if ending in _HEADERS:
        header = _HEADERS[ending]
        return header.read(path, options) if header.name_of_data(path) == data.name else None
    layout = _DESCRIPTIONS[ending][1](path, data)
    return open_layout(layout, options) if layout is not None else None


def _told(reading: Reading) -> str:
    return f"{' x '.join(map(str, reading.voxels.shape))} of {reading.voxels.dtype}"


def _edges(reading: Reading) -> str:
    edges = " x ".join(f"{edge:g}" for edge in reading.spacing or ())
    return f"{edges} {reading.unit}"


def _metres(reading: Reading) -> tuple[float, ...] | None:
    if reading.spacing is None or reading.unit is None or reading.doubt is not None:
        return None
    return tuple(edge * METRES_PER_UNIT[reading.unit] for edge in reading.spacing)
