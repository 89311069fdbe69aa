"""Telling voxels by strokes: a person paints some of each kind, a random forest finds the others.

Begin at :class:`~mbstudio.core.grains.classifying.voxel_classifier.VoxelClassifier`. `stroke` is what was
painted, `grey_levels` and `features` are what a voxel is told by, `forest` votes, and `classifier_file` keeps
a classifier as plain arrays.
"""

from mbstudio.core.grains.classifying.stroke import Stroke
from mbstudio.core.grains.classifying.voxel_classifier import VoxelClassifier, load_classifier

__all__ = ["Stroke", "VoxelClassifier", "load_classifier"]
