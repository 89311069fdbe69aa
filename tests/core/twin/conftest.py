"""Two ellipsoids that touch and a ball apart from them, scanned by code that knows no metaballs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage

from mbstudio.core.grains import load_labels
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize

VOID, TONE = 1000.0, 2000.0
# Middle (x, y, z), semi-axes; the first two touch at x = 16.3 (their axes lie along x, y, z).
BODIES = (
    (np.array([9.3, 12.2, 12.4]), np.array([7.0, 6.0, 6.5])),
    (np.array([23.3, 12.2, 12.4]), np.array([7.0, 6.6, 5.6])),
    (np.array([16.1, 27.4, 12.7]), np.array([6.4, 6.4, 6.4])),
)
CONTACT = np.array([16.3, 12.2, 12.4])
SHAPE = (26, 40, 36)


def fill(shape=SHAPE, bodies=BODIES, steps: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """Return the share of each voxel that bodies fill, by counting subsamples, and whose it is mostly."""
    ticks = (np.arange(steps) + 0.5) / steps - 0.5
    shares = []
    for middle, axes in bodies:
        share = np.zeros(shape)
        for dz in ticks:
            for dy in ticks:
                for dx in ticks:
                    z, y, x = np.ogrid[: shape[0], : shape[1], : shape[2]]
                    inside = ((x + dx - middle[0]) / axes[0]) ** 2 + ((y + dy - middle[1]) / axes[1]) ** 2
                    share += inside + ((z + dz - middle[2]) / axes[2]) ** 2 <= 1
        shares.append(share / steps**3)
    filled = np.array(shares)
    return filled.sum(axis=0), np.where(filled.max(axis=0) > 0.5, filled.argmax(axis=0) + 1, 0)


@pytest.fixture(scope="session")
def phantom():
    """The scan of the three bodies with a little noise, and its grains."""
    share, labels = fill()
    image = VOID + (TONE - VOID) * ndimage.gaussian_filter(share, 0.7, truncate=6)
    image += 30 * np.random.default_rng(3).standard_normal(SHAPE)
    scan = Scan(image.astype(np.float32), VoxelSize.parse("20 um"), origin=(100.0, -40.0, 7.0))
    grains = load_labels(labels.astype(np.int32), scan)
    volumes = [float(4 / 3 * np.pi * axes.prod()) for _, axes in BODIES]
    return SimpleNamespace(scan=scan, grains=grains, labels=labels, volumes=volumes, share=share)
