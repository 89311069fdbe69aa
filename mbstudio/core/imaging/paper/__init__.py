"""The method of Zhao et al. (2023): a gradient search on all voxels.

Begin at `gradient_search`.
"""
