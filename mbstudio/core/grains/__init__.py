"""Grains: segmentation, labels and single grains.

`interfaces`, `phases` and `thresholding` find what is grain, `flooding` parts what touches, `verdict` says
how well the scan bears it out. Begin at
:func:`~mbstudio.core.grains.segmentation.segment`.
"""

from mbstudio.core.grains.grain import Grain
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.grains.label_image import load_labels
from mbstudio.core.grains.segmentation import SegmentationSettings, segment
from mbstudio.core.scan.field_of_view import FieldOfView, find_field_of_view

__all__ = [
    "FieldOfView",
    "Grain",
    "GrainSet",
    "SegmentationSettings",
    "find_field_of_view",
    "load_labels",
    "segment",
]
