"""CT scans: readers by file family, the lazy voxel array, and the synthetic sample.

Begin at :func:`~mbstudio.core.scan.opening.open_scan`.
"""

from mbstudio.core.scan.opening import open_scan, voxel_digest
from mbstudio.core.scan.phantom import Phantom, PhantomRecipe, make_phantom, sample_recipe, sample_scan
from mbstudio.core.scan.scan import Scan

__all__ = [
    "Phantom",
    "PhantomRecipe",
    "Scan",
    "make_phantom",
    "open_scan",
    "sample_recipe",
    "sample_scan",
    "voxel_digest",
]
