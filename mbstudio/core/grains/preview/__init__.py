"""What a segmentation would find, shown before it is made: in a slice, or in a region.

Begin at :class:`~mbstudio.core.grains.preview.slice_foreground.SliceForeground`, which tells grain from void
in one slice; `region_splitting` parts the grains of a region.
"""
