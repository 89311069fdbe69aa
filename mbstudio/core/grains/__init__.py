"""Grains: field of view, segmentation, labels and single grains."""

from mbstudio.core.grains.grain import Grain

__all__ = ["Grain"]
