from __future__ import annotations

import numpy as np

from mbstudio.core.grains import load_labels
from mbstudio.core.metrics.voxel_surface import voxel_outline


def test_voxels_of_any_length_are_outlined_without_filling_the_memory() -> None:
    """A thousand cells to a voxel and more were made of such voxels, 116 GB of them."""
    mask = np.zeros((9, 9, 9), np.int32)
    mask[2:7, 2:7, 2:7] = 1
    for edges in ((46.0, 46.0, 0.05), (0.05, 46.0, 46.0)):
        grain = load_labels(mask, voxel_size=edges, unit="um").grain(1)
        vertices, faces = voxel_outline(grain)
        assert len(faces) < 2000
        assert np.isfinite(vertices).all()
