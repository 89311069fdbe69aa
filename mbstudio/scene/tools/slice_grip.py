"""Slices dragged through the scan by their frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from mbstudio.scene.layers.picking import distance_to_segments, length_of_drag, to_display
from mbstudio.scene.layers.slices import AXES, Axis

if TYPE_CHECKING:
    from mbstudio.scene.scene import Scene

REACH = 6.0  # pixels at scale 1 between mouse and frame


class SliceGrip:
    """Grabs the frame of a slice and moves the slice along its axis.

    Parameters
    ----------
    scene : Scene
    moved : callable
        Told the axis, and the voxel at which to cut.
    """

    def __init__(self, scene: Scene, moved: Callable[[Axis, int], object]) -> None:
        self._scene, self._moved = scene, moved
        self.pixel_ratio = 1.0
        self._held: tuple[Axis, int, Float[np.ndarray, "2"]] | None = None

    def scale(self, ratio: float) -> None:
        """Tell how many pixels of the picture one of the screen's units is."""
        self.pixel_ratio = ratio

    def over(self, x: float, y: float) -> Axis | None:
        """Return the axis of the slice whose frame lies under a pixel (from the lower left), or None."""
        slices = self._scene.slices
        if slices is None:
            return None
        best, found = REACH * self.pixel_ratio, None
        for axis in AXES:
            if slices.is_seen(axis):
                shown = to_display(self._scene.plotter.renderer, slices.corners(axis))
                away = distance_to_segments(np.array([x, y]), shown, np.roll(shown, -1, axis=0)).min()
                if away <= best:
                    best, found = float(away), axis
        return found

    def grab(self, x: float, y: float) -> bool:
        """Take hold of the frame under a pixel; return whether there is one."""
        axis = self.over(x, y)
        if axis is None or self._scene.slices is None:
            return False
        self._held = axis, self._scene.slices.index[axis], np.array([x, y])
        return True

    def drag(self, x: float, y: float) -> None:
        """Move the slice with the mouse."""
        slices = self._scene.slices
        if self._held is None or slices is None:
            return
        axis, index, start = self._held
        length = length_of_drag(
            self._scene.plotter.renderer,
            slices.corners(axis).mean(axis=0),
            np.eye(3)[AXES.index(axis)],
            np.array([x, y]) - start,
        )
        wanted = index + round(length / slices.spacing(axis))
        self._moved(axis, int(np.clip(wanted, 0, slices.counts[axis] - 1)))

    def drop(self) -> None:
        """Let go."""
        self._held = None
