"""From labels to a grain set: consecutive numbers, whole pieces, and the table."""

from __future__ import annotations

import fill_voids
import numpy as np
from jaxtyping import Bool, Int

from mbstudio.core.compiled import compiled
from mbstudio.core.grains.editing.label_volume import LabelVolume
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.units import VoxelSize


def build_grain_set(
    labels: Int[np.ndarray, "Z Y X"],
    voxel_size: VoxelSize,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rim: Bool[np.ndarray, "Z Y X"] | None = None,
) -> GrainSet:
    """Return the grain set of a label volume with labels 1..N, each one piece.

    Parameters
    ----------
    labels : int32 array, shape (Z, Y, X)
        Made read-only.
    rim : bool array, shape (Z, Y, X), optional
        Where a scan cuts grains off; the box's faces by default.
    """
    counts, boxes, sums, cut = statistics(labels, rim)
    centroids = voxel_size.positions(sums / np.maximum(counts, 1)[:, None], origin)
    import pandas as pd  # imported late: it takes a third of a second

    table = pd.DataFrame(
        {
            "label": np.arange(1, len(counts) + 1),
            "voxels": counts,
            "volume": counts * voxel_size.volume,
            **{name: boxes[:, column] for column, name in enumerate(("z0", "z1", "y0", "y1", "x0", "x1"))},
            **{name: centroids[:, column] for column, name in enumerate("xyz")},
            "touches_border": cut,
        }
    )
    return GrainSet(LabelVolume(labels), table, voxel_size, origin)


def statistics(
    labels: Int[np.ndarray, "Z Y X"], rim: Bool[np.ndarray, "Z Y X"] | None = None
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n 6"], Int[np.ndarray, "n 3"], Bool[np.ndarray, "n"]]:
    """Return per label: voxels, box (z0, z1, y0, y1, x0, x1), sums of indices, cut off or not."""
    count = int(labels.max(initial=0))
    voxels = np.zeros(count + 1, np.int64)
    boxes = np.zeros((count + 1, 6), np.int64)
    boxes[:, ::2] = np.iinfo(np.int64).max
    sums = np.zeros((count + 1, 3), np.int64)
    cut = np.zeros(count + 1, np.bool_)
    has_rim = rim is not None
    _gather(
        labels, rim if rim is not None else np.zeros((1, 1, 1), np.bool_), has_rim, voxels, boxes, sums, cut
    )
    boxes[voxels == 0] = 0
    return voxels[1:], boxes[1:], sums[1:], cut[1:]


@compiled()
def _gather(
    labels: np.ndarray,
    rim: np.ndarray,
    has_rim: bool,
    voxels: np.ndarray,
    boxes: np.ndarray,
    sums: np.ndarray,
    cut: np.ndarray,
) -> None:
    nz, ny, nx = labels.shape
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                label = labels[z, y, x]
                if label == 0:
                    continue
                voxels[label] += 1
                place = (z, y, x)
                for axis in range(3):
                    sums[label, axis] += place[axis]
                    boxes[label, 2 * axis] = min(boxes[label, 2 * axis], place[axis])
                    boxes[label, 2 * axis + 1] = max(boxes[label, 2 * axis + 1], place[axis] + 1)
                if has_rim:
                    cut[label] |= rim[z, y, x]
                else:
                    cut[label] |= z == 0 or y == 0 or x == 0 or z == nz - 1 or y == ny - 1 or x == nx - 1


def widened_box(row: Int[np.ndarray, "6"], margin: int = 0) -> tuple[slice, slice, slice]:
    """Return a bounding box as slices, widened by a margin (cut at zero)."""
    z0, z1, y0, y1, x0, x1 = (int(value) for value in row)
    return (
        slice(max(z0 - margin, 0), z1 + margin),
        slice(max(y0 - margin, 0), y1 + margin),
        slice(max(x0 - margin, 0), x1 + margin),
    )


def renumber_kept(labels: Int[np.ndarray, "Z Y X"], keep: Bool[np.ndarray, "n"]) -> int:
    """Drop the labels 1..n that are not kept and number the others 1..N in place; return N."""
    numbers = np.zeros(len(keep) + 1, labels.dtype)
    numbers[1:][keep] = np.arange(1, int(keep.sum()) + 1)
    for part in labels:
        np.take(numbers, part, out=part)
    return int(keep.sum())


def fill_label_cavities(labels: Int[np.ndarray, "Z Y X"]) -> int:
    """Give the empty voxels that a grain encloses to the grain, in place; return how many."""
    _, boxes, _, _ = statistics(labels)
    filled_voxels = 0
    for label, row in enumerate(boxes, start=1):
        part = labels[widened_box(row)]
        inside = part == label
        filled = fill_voids.fill(inside).astype(bool)
        gained = filled & (part == 0)
        count = int(np.count_nonzero(gained))
        if count:
            part[gained] = label
            filled_voxels += count
    return filled_voxels
