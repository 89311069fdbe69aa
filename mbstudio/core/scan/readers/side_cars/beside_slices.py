"""The voxel size of slices whose scanner left its description of the whole volume beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.side_cars import nikon, phoenix
from mbstudio.core.scan.readers.side_cars.key_values import read_key_values
from mbstudio.core.scan.readers.side_cars.layout import RawLayout
from mbstudio.core.scan.readers.tiff_lengths import Spacing

_DESCRIPTIONS: dict[str, Callable[[Path, Path], RawLayout]] = {
    ".vgi": nikon.describe_vgi,
    ".xtekct": nikon.describe_xtek,
    ".xtekvolume": nikon.describe_xtek,
    ".pcr": phoenix.describe,
}


@dataclass(frozen=True)
class SizeOfSlices:
    """What descriptions beside slices say about their voxels; as in `Reading`."""

    spacing: Spacing | None = None
    unit: str | None = None
    unit_word: str | None = None
    metadata: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def size_beside_slices(folder: Path, shape: tuple[int, int, int]) -> SizeOfSlices | None:
    """Return the voxel size that a description in the folder of slices states, None if there is none.

    It is taken if it describes as many voxels as there are; cubic voxels may be counted in another order.

    Raises
    ------
    ScanError
        If several descriptions of as many voxels state different sizes.
    """
    files = sorted(
        entry
        for entry in folder.iterdir()
        if entry.suffix.lower() in _DESCRIPTIONS and entry.is_file() and not entry.name.startswith(".")
    )
    if not files:
        return None
    fitting: list[tuple[Path, RawLayout]] = []
    notes: list[str] = []
    for file in files:
        if _of_projections(file, shape):
            notes.append(
                f"has a description ({file.name}) by which these images are projections: open the folder "
                f"of the "
                "reconstructed slices instead."
            )
            continue
        try:
            layout = _DESCRIPTIONS[file.suffix.lower()](file, file)
        except ScanError as error:
            notes.append(f"has a description beside it that cannot be taken ({error})")
            continue
        if layout.spacing is not None and _counts_the_same(layout, shape):
            fitting.append((file, layout))
        elif layout.spacing is not None:
            notes.append(
                f"has a description ({file.name}) of {' x '.join(map(str, layout.shape))} voxels (z, y, "
                f"x), while "
                f"these are {' x '.join(map(str, shape))}: its voxel size was not taken."
            )
    if not fitting:
        return SizeOfSlices(notes=tuple(notes))
    first, layout = fitting[0]
    for file, other in fitting[1:]:
        same = np.allclose(layout.spacing or 0, other.spacing or 0, rtol=1e-3, atol=0)
        if not same or layout.unit != other.unit:
            raise ScanError(
                f"The folder {folder} holds {first.name} and {file.name}, which give different voxel "
                f"sizes: keep "
                "the one of these slices."
            )
    metadata = {**{key: str(value) for key, value in layout.metadata.items()}, "side-car": first.name}
    return SizeOfSlices(layout.spacing, layout.unit, layout.unit_word, metadata, tuple(notes))


def _counts_the_same(layout: RawLayout, shape: tuple[int, int, int]) -> bool:
    if layout.shape == shape:
        return True
    edges = layout.spacing or (0.0, 1.0, 2.0)
    return sorted(layout.shape) == sorted(shape) and max(edges) <= min(edges) * (1 + 1e-6)


def _of_projections(file: Path, shape: tuple[int, int, int]) -> bool:
    """Return whether the images are what CT Pro's scan recorded, by number and size."""
    if file.suffix.lower() not in nikon.XTEK_SUFFIXES:
        return False
    try:
        said = read_key_values(file)
        counts = [said.count(key) for key in ("Projections", "DetectorPixelsY", "DetectorPixelsX")]
        voxels = [said.count(f"Voxels{axis}") for axis in "ZYX"]
    except ScanError:
        return False
    return tuple(counts) == shape and tuple(voxels) != shape
