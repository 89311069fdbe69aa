"""Volume rendering of a scan, thinned to what the graphics memory takes, coarser while it is turned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv
from jaxtyping import Float, Float32
from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction
from vtkmodules.vtkRenderingOpenGL2 import vtkTextureObject
from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkSmartVolumeMapper

from mbstudio.core.translation import mark
from mbstudio.scene.layers.layer import Layer, Stage
from mbstudio.scene.theme import rgb

if TYPE_CHECKING:
    from mbstudio.core.scan import Scan

MOVING = 2.5
"""By how much coarser the cloud is while it is turned, along each side: a fifteenth of the voxels."""
# From the void's end of the window to the grains' end.
_SHADES = ((0.0, "#4d4a48"), (0.4, "#8f8579"), (0.65, "#d8cbb6"), (1.0, "#ffffff"))
_OPACITIES = ((0.0, 0.0), (0.43, 0.0), (0.78, 0.85), (1.0, 0.9))


@dataclass(frozen=True, eq=False)
class VolumeVoxels:
    """Grey values [z, y, x] with the spacing and origin (x, y, z) that they have after thinning."""

    grey: Float32[np.ndarray, "z y x"]
    spacing: tuple[float, float, float]
    origin: tuple[float, float, float]

    @cached_property
    def ends(self) -> tuple[float, float]:
        """The smallest and the largest grey value."""
        low, high = float(self.grey.min()), float(self.grey.max())
        return low, high if high > low else low + 1.0

    def thinned(self, factor: float) -> VolumeVoxels:
        """Return every k-th voxel, k at least `factor`."""
        step = max(1, math.ceil(factor))
        x, y, z = (edge * step for edge in self.spacing)
        return VolumeVoxels(self.grey[::step, ::step, ::step], (x, y, z), self.origin)


def volume_voxels(scan: Scan, longest: int = 256) -> VolumeVoxels:
    """Return the scan, thinned until no side is longer than `longest` voxels.

    Parameters
    ----------
    longest : int
        At most the largest 3-D texture of the graphics card (:func:`largest_texture`); 256 is quick even
        in software.

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


def largest_texture(render_window: Any) -> int:
    """Return how many voxels a side of a volume may have on this graphics card; 0 if it does not say.

    Parameters
    ----------
    render_window : vtkRenderWindow
        That has drawn something: before, it has no graphics to ask.
    """
    if not render_window.IsA("vtkOpenGLRenderWindow") or not render_window.GetInitialized():
        return 0
    return max(0, int(vtkTextureObject.GetMaximumTextureSize3D(render_window)))


class VolumeCloud:
    """A scan as a cloud: clear below the middle of the grey window, dense at its top.

    Parameters
    ----------
    plotter : pyvista.BasePlotter
    voxels : VolumeVoxels
    window : tuple of float
        Grey values shown black and white.
    """

    def __init__(self, plotter: Any, voxels: VolumeVoxels, window: tuple[float, float]) -> None:
        self._plotter, self._ends = plotter, voxels.ends
        self.opacity = 1.0
        self.actor = self._volume("volume", voxels)
        self.coarse = self._volume("volume in motion", voxels.thinned(MOVING))
        self.set_window(*window)

    def set_window(self, low: float, high: float) -> None:
        """Show grey value `low` black and clear, `high` white and dense."""
        start, end = self._ends
        scale = 255 / (end - start)
        first, width = (low - start) * scale, max((high - low) * scale, 1e-6)
        colours, opacities = vtkColorTransferFunction(), vtkPiecewiseFunction()
        for share, colour in _SHADES:
            colours.AddRGBPoint(first + share * width, *(channel / 255 for channel in rgb(colour)))
        for share, opacity in _OPACITIES:
            opacities.AddPoint(first + share * width, opacity * self.opacity)
        for volume in (self.actor, self.coarse):
            volume.GetProperty().SetColor(colours)
            volume.GetProperty().SetScalarOpacity(opacities)

    def set_visible(self, visible: bool, moving: bool) -> None:
        """Show or hide it; while it is turned, by fewer voxels."""
        self.actor.SetVisibility(visible and not moving)
        self.coarse.SetVisibility(visible and moving)

    def remove(self) -> None:
        """Take it out of the plotter."""
        for volume in (self.actor, self.coarse):
            self._plotter.remove_actor(volume, reset_camera=False, render=False)

    def _volume(self, name: str, voxels: VolumeVoxels) -> Any:
        image = pv.ImageData(dimensions=voxels.grey.shape[::-1], spacing=voxels.spacing, origin=voxels.origin)
        # 0 to 255 is a quarter of the graphics memory; one range for both levels.
        low, high = self._ends
        shades = np.round((voxels.grey - low) * (255 / (high - low))).astype(np.uint8)
        image.point_data["grey"] = shades.ravel()
        mapper = vtkSmartVolumeMapper()
        mapper.SetInputData(image)
        mapper.SetBlendModeToComposite()
        if self._plotter.render_window.IsA("vtkOSOpenGLRenderWindow"):
            # Without a graphics card the processor's own rays are ten times as fast as those of its OpenGL.
            mapper.SetRequestedRenderModeToRayCast()
            mapper.SetAutoAdjustSampleDistances(False)
            mapper.SetInteractiveAdjustSampleDistances(False)
            mapper.SetSampleDistance(float(np.mean(voxels.spacing)))
        volume = pv.plotting.volume.Volume()
        volume.SetMapper(mapper)
        prop = volume.GetProperty()
        prop.SetInterpolationTypeToLinear()
        prop.ShadeOn()
        prop.SetAmbient(0.3)
        prop.SetDiffuse(0.9)
        prop.SetScalarOpacityUnitDistance(float(np.mean(voxels.spacing)) * 2)
        volume.PickableOff()
        self._plotter.add_actor(volume, name=name, reset_camera=False, render=False)
        return volume


class Volume(Layer[VolumeVoxels]):
    """The scan as a cloud, in the grey window of the slices."""

    title = mark("Volume")
    icon = "ph.cube"
    tip = mark("The whole scan as a translucent volume")
    has_outline = True
    is_within_scan = True

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self.cloud: VolumeCloud | None = None
        self._moving = False

    @property
    def actors(self) -> Sequence[Any]:
        return [] if self.cloud is None else [self.cloud.actor, self.cloud.coarse]

    def set(self, content: VolumeVoxels | None, unit: str | None = None) -> None:
        """Show the voxels of the scan (:func:`volume_voxels`); without a scan there is nothing to show."""
        self.stage.set_unit(unit)
        if self.cloud is not None:
            self.cloud.remove()
        self.cloud = None
        if content is not None and self.stage.grey_window is not None:
            self.cloud = VolumeCloud(self.stage.plotter, content, self.stage.grey_window)
            self._dilute(self.cloud)
        self.stage.update()

    def set_window(self, low: float, high: float) -> None:
        """Show grey value `low` of the scan clear and `high` dense."""
        if self.cloud is not None:
            self.cloud.set_window(low, high)

    def set_opacity(self, opacity: float) -> None:
        self.opacity = float(opacity)
        if self.cloud is not None:
            self._dilute(self.cloud)
        self.stage.update()

    def set_moving(self, moving: bool) -> None:
        self._moving = moving
        self.refresh()

    def refresh(self) -> None:
        if self.cloud is not None:
            self.cloud.set_visible(self.is_visible, self._moving)

    def points(self) -> Float[np.ndarray, "m 3"] | None:
        """Return the corners of its box, shape (8, 3), or None."""
        if self.cloud is None:
            return None
        return np.asarray(pv.Box(bounds=self.cloud.actor.GetBounds()).points, dtype=float)

    def _dilute(self, cloud: VolumeCloud) -> None:
        if cloud.opacity != self.opacity and self.stage.grey_window is not None:
            cloud.opacity = self.opacity
            cloud.set_window(*self.stage.grey_window)
