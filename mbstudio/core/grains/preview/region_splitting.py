"""The grains of a region about a place, parted as a segmentation with the same settings would part them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import SegmentationWarning
from mbstudio.core.grains.classifying.voxel_classifier import VoxelClassifier
from mbstudio.core.grains.editing.label_volume import Box
from mbstudio.core.grains.segmentation import SegmentationSettings, part_scan
from mbstudio.core.scan.scan import Scan

EDGE = 96
"""Voxels to an edge of the region."""


@dataclass(frozen=True, eq=False)
class SplitRegion:
    """Grains of a region.

    Attributes
    ----------
    box : tuple of slice
        Where it lies in the scan.
    labels : int array
        0 outside all grains; what the region's faces cut may be parted otherwise in the whole.
    count : int
        Of grains.
    """

    box: Box
    labels: Int[np.ndarray, "z y x"]
    count: int


def split_region(
    scan: Scan,
    place: tuple[int, int, int],
    settings: SegmentationSettings,
    classifier: VoxelClassifier | None = None,
    edge: int = EDGE,
) -> SplitRegion:
    """Part the grains of a region about a place.

    Parameters
    ----------
    scan : Scan
    place : (z, y, x)
    settings : SegmentationSettings
        An automatic threshold is found in the region alone.
    classifier : VoxelClassifier, optional
    edge : int

    Raises
    ------
    ScanError, SegmentationError
        If nothing stands out in the region.
    """
    z, y, x = (
        slice(start, min(start + edge, count))
        for start, count in (
            (min(max(0, at - edge // 2), max(0, count - edge)), count)
            for at, count in zip(place, scan.shape, strict=True)
        )
    )
    box = (z, y, x)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SegmentationWarning)
        labels = part_scan(scan.cropped(box), settings, classifier)
    return SplitRegion(box, labels, int(labels.max(initial=0)))
