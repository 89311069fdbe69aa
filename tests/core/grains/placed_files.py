"""Volumes that lie somewhere in space, as files."""

from __future__ import annotations

from pathlib import Path

import nrrd
import numpy as np


def write_nrrd(path: Path, voxels: np.ndarray, steps: np.ndarray, origin: tuple[float, ...]) -> Path:
    """Write voxels (z, y, x) with the steps of their axes and an origin, in mm."""
    nrrd.write(str(path), voxels, {"space": "left-posterior-superior", "space directions": steps,
               "space origin": list(origin), "space units": ["mm"] * 3}, index_order="C")  # fmt: skip
    return path
