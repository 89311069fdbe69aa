"""Volume rendering of a scan, thinned to what the graphics memory takes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv
from jaxtyping import Float32

if TYPE_CHECKING:
    from mbstudio.core.scan import Scan


@dataclass(frozen=True, eq=False)
class VolumeVoxels:
    """Grey values [z, y, x] with the spacing and origin (x, y, z) that they have after thinning."""

    grey: Float32[np.ndarray, "z y x"]
    spacing: tuple[float, float, float]
    origin: tuple[float, float, float]


def volume_voxels(scan: Scan, longest: int = 256) -> VolumeVoxels:
    """Return the scan, thinned until no side is longer than `longest` voxels.

    Parameters
    ----------
    longest : int
        At most the largest 3-D texture of the graphics card; 256 is quick even in software.

    Notes
    -----
    Every k-th voxel is taken, not a mean: a thinned scan of a gigabyte is read in one pass
    without a copy of the whole, and CT noise at this size does not show.
    """
    step = max(1, math.ceil(max(scan.shape) / longest))
    voxels = np.stack([np.asarray(scan.voxels[z])[::step, ::step] for z in range(0, scan.shape[0], step)])
    grey = np.nan_to_num(voxels.astype(np.float32), nan=0.0)
    x, y, z = (edge * step for edge in scan.voxel_size.xyz)
    return VolumeVoxels(grey, (x, y, z), scan.origin)


def add_volume(plotter: pv.BasePlotter, voxels: VolumeVoxels, window: tuple[float, float], name: str) -> Any:
    """Add a scan as a cloud: clear below the middle of the window, dense at its top."""
    image = pv.ImageData(dimensions=voxels.grey.shape[::-1], spacing=voxels.spacing, origin=voxels.origin)
    image.point_data["grey"] = voxels.grey.ravel()
    # pyvista reads an array as 0 to 255 over the grey window.
    opacity = 255 * np.concatenate([np.zeros(110), np.linspace(0, 0.85, 90), np.full(56, 0.9)])
    return plotter.add_volume(
        image,
        scalars="grey",
        clim=window,
        cmap="bone",
        opacity=opacity,
        opacity_unit_distance=float(np.mean(image.spacing)) * 2,
        shade=True,
        show_scalar_bar=False,
        name=name,
        pickable=False,
        reset_camera=False,
        render=False,
    )
