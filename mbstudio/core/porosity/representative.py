"""The representative elementary volume: how large a box must be to have the porosity of the whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.porosity.profiles import Specimen, solid_slices

TOLERANCE = 0.05
BOXES = 200
_BLOCKS = 128
_SIZES = 14
_MOST_SHARE = 0.5
"""Longest edge over that of the specimen at which boxes still differ in what they hold."""


@dataclass(frozen=True, eq=False)
class RepresentativeVolume:
    """Porosity of boxes that grow.

    Attributes
    ----------
    edges : float array, shape (sizes,)
        Of the boxes, rising, in `unit`.
    mean, deviation : float array, shape (sizes,)
        Of the porosity over the boxes of that edge.
    boxes : int array, shape (sizes,)
        How many.
    edge : float or None
        Smallest edge from which on the deviation stays within the tolerance of the mean; None if the scan
        is too small to show one.
    tolerance : float
    unit : str
    """

    edges: Float[np.ndarray, " sizes"]
    mean: Float[np.ndarray, " sizes"]
    deviation: Float[np.ndarray, " sizes"]
    boxes: Int[np.ndarray, " sizes"]
    edge: float | None
    tolerance: float
    unit: str


def representative_volume(
    grains: GrainSet,
    specimen: Specimen | None = None,
    *,
    tolerance: float = TOLERANCE,
    boxes: int = BOXES,
    seed: int = 0,
) -> RepresentativeVolume:
    """Return how the porosity of boxes in the specimen depends on their edge.

    Boxes lie at random places wholly within the specimen. Above half of the specimen's narrowest width they
    overlap so much that their porosity must be alike, so that no edge beyond it is taken for representative.

    Parameters
    ----------
    grains : GrainSet
    specimen : Specimen, optional
        All that the scan has seen by default.
    tolerance : float
        Standard deviation of the boxes' porosity over its mean.
    boxes : int
        Of each edge.
    seed : int
        Of their places.

    Raises
    ------
    MeasureError
        If the grains are bodies of mesh files, or the specimen is less than eight voxels wide.

    References
    ----------
    Bear (1972), Dynamics of Fluids in Porous Media, Elsevier; Al-Raoush & Papadopoulos (2010), Representative
    elementary volume analysis of porous media using X-ray computed tomography, Powder Technology 200, 69-77.
    """
    if grains.is_of_meshes:
        raise MeasureError("Bodies of mesh files have no pores between them: porosity needs a scan.")
    if not 0 < tolerance < 1 or boxes < 10:
        raise MeasureError(
            "The tolerance lies between 0 and 1, and at least 10 boxes of each edge are needed."
        )
    specimen = specimen or Specimen.of_scan(grains)
    solid, counted, widths = _block_sums(grains, specimen)
    narrowest = float(min(size * width for size, width in zip(solid.shape, widths, strict=True)))
    least = max(widths)
    if narrowest < 8 * least:
        raise MeasureError("The specimen is less than eight voxels wide: it holds no boxes that could grow.")
    table, whole = _sums(solid), _sums(counted)
    full = counted.max()
    rng = np.random.default_rng(seed)
    rows = []
    for edge in np.geomspace(2 * least, 0.8 * narrowest, _SIZES):
        sides = [max(1, round(edge / width)) for width in widths]
        starts = [rng.integers(0, size - side + 1, 20 * boxes)
                  for size, side in zip(solid.shape, sides, strict=True)]  # fmt: skip
        inside = _box_sums(whole, starts, sides) == full * np.prod(sides)
        found = (_box_sums(table, starts, sides) / (full * np.prod(sides)))[inside][:boxes]
        if len(found) >= boxes // 10:
            rows.append((float(np.prod([s * w for s, w in zip(sides, widths, strict=True)])) ** (1 / 3),
                         1 - float(found.mean()), float(found.std(ddof=1)), len(found)))  # fmt: skip
    if not rows:
        raise MeasureError("No box lies wholly within the specimen: give a larger one.")
    edges, mean, deviation, counts = (np.array(column) for column in zip(*rows, strict=True))
    return RepresentativeVolume(
        edges, mean, deviation, counts.astype(np.int64),
        _first_within(edges, mean, deviation, tolerance, _MOST_SHARE * narrowest), tolerance, grains.unit,
    )  # fmt: skip


def _first_within(
    edges: np.ndarray, mean: np.ndarray, deviation: np.ndarray, tolerance: float, most: float
) -> float | None:
    within = deviation <= tolerance * mean
    for place, edge in enumerate(edges.tolist()):
        if within[place:].all():
            return float(edge) if edge <= most else None
    return None


def _block_sums(
    grains: GrainSet, specimen: Specimen
) -> tuple[Int[np.ndarray, "a b c"], Int[np.ndarray, "a b c"], tuple[float, float, float]]:
    """Return solid voxels and voxels of the specimen by blocks, and the blocks' widths; axis first."""
    footprint, (low, high) = specimen.footprint, specimen.bounds
    block = max(1, int(np.ceil(max(high - low, *footprint.shape) / _BLOCKS)))
    rows, columns = (size // block for size in footprint.shape)
    cut = (slice(0, rows * block), slice(0, columns * block))
    shape = (rows, block, columns, block)
    area = footprint[cut].reshape(shape).sum(axis=(1, 3))
    layers, kept = [], np.zeros((0, *footprint[cut].shape), dtype=bool)
    for part in solid_slices(grains, specimen):
        kept = np.concatenate([kept, (part & footprint)[:, cut[0], cut[1]]])
        while len(kept) >= block:
            layers.append(kept[:block].sum(axis=0).reshape(shape).sum(axis=(1, 3)))
            kept = kept[block:]
    if not layers:
        raise MeasureError("The specimen is less than eight voxels wide: it holds no boxes that could grow.")
    solid = np.stack(layers).astype(np.int64)
    counted = np.broadcast_to(area * block, solid.shape).astype(np.int64)
    edges = grains.voxel_size.zyx
    others = [edges[place] for place in range(3) if place != specimen.axis]
    return solid, counted, (edges[specimen.axis] * block, others[0] * block, others[1] * block)


def _sums(values: Int[np.ndarray, "a b c"]) -> Int[np.ndarray, "a1 b1 c1"]:
    sums: np.ndarray = np.pad(values, ((1, 0),) * 3).cumsum(axis=0).cumsum(axis=1).cumsum(axis=2)
    return sums


def _box_sums(
    sums: Int[np.ndarray, "a b c"], starts: list[np.ndarray], sides: list[int]
) -> Int[np.ndarray, " n"]:
    (z, y, x), (Z, Y, X) = starts, (s + d for s, d in zip(starts, sides, strict=True))
    found: np.ndarray = (
        sums[Z, Y, X] - sums[z, Y, X] - sums[Z, y, X] - sums[Z, Y, x]
        + sums[z, y, X] + sums[z, Y, x] + sums[Z, y, x] - sums[z, y, x]
    )  # fmt: skip
    return found
