"""Volume rendering of a scan, thinned to what the graphics memory takes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pyvista as pv

if TYPE_CHECKING:
    from mbstudio.core.scan import Scan


def volume_image(scan: Scan, longest: int = 256) -> pv.ImageData:
    """Return the scan as image data, thinned until no side is longer than `longest` voxels.

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
    image = pv.ImageData(
        dimensions=grey.shape[::-1],
        spacing=tuple(np.array(scan.voxel_size.xyz) * step),
        origin=tuple(scan.origin),
    )
    image.point_data["grey"] = grey.ravel()
    return image


def add_volume(
    plotter: pv.BasePlotter, image: pv.ImageData, window: tuple[float, float], name: str
) -> pv.plotting.volume.Volume:
    """Add image data as a cloud: clear below the middle of the window, dense at its top."""
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
