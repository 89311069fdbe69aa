"""Grains of known shape, and what must hold of every grain set after any edit."""

from __future__ import annotations

import numpy as np

from mbstudio.core.grains import GrainSet
from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.grains.pieces import label_pieces
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize

SIZE = VoxelSize(2.0, 2.0, 2.0, "um")
ORIGIN = (5.0, 7.0, 9.0)


def ball(shape: tuple[int, int, int], middle: tuple[float, float, float], radius: float) -> np.ndarray:
    z, y, x = np.ogrid[tuple(slice(0, count) for count in shape)]
    return (z - middle[0]) ** 2 + (y - middle[1]) ** 2 + (x - middle[2]) ** 2 <= radius**2


def placed_labels() -> np.ndarray:
    """Return four balls: 1 and 2 touch, 3 is two balls fused at a neck, 4 is alone and cut by the border."""
    shape = (40, 48, 72)
    labels = np.zeros(shape, np.int32)
    labels[ball(shape, (12, 12, 14), 9)] = 1
    labels[ball(shape, (12, 12, 31), 9) & (labels == 0)] = 2
    labels[ball(shape, (25, 33, 20), 9) | ball(shape, (25, 33, 34), 9)] = 3
    labels[ball(shape, (22, 24, 68), 8)] = 4
    return labels


def placed_grains() -> GrainSet:
    return build_grain_set(placed_labels(), SIZE, ORIGIN)


def scan_of(labels: np.ndarray, seed: int = 3) -> Scan:
    """Return a scan in which grains are bright, with noise, and darker where two of them meet."""
    rng = np.random.default_rng(seed)
    grey = 100.0 + 100.0 * (labels > 0) + rng.normal(0, 5, labels.shape)
    return Scan(grey.astype(np.float32), SIZE, ORIGIN)


def require_sound(grains: GrainSet) -> None:
    """Hold a grain set against its labels, measured anew as a whole."""
    labels = grains.labels
    found = np.unique(labels)
    found = found[found > 0]
    assert grains.table["label"].tolist() == found.tolist()
    for label in found.tolist():
        assert len(label_pieces(labels == label)[1]) == 1, f"grain {label} is in several pieces"
    numbered = np.searchsorted(np.r_[0, found], labels).astype(np.int32)
    rim = grains.view.rim_cutting(labels) if grains.view is not None else None
    anew = build_grain_set(numbered, grains.voxel_size, grains.origin, rim).table
    for name in anew.columns.drop("label"):
        np.testing.assert_allclose(
            grains.table[name].to_numpy().astype(float), anew[name].to_numpy().astype(float), err_msg=name
        )
    assert grains.last_label >= int(found.max())
