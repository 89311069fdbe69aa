"""Slices dragged through the scan by their frames."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from mbstudio.scene.layers.picking import distance_to_segments, length_of_drag, to_display
from mbstudio.scene.layers.slices import AXES, Axis, Slices

REACH = 6.0  # pixels at scale 1 between mouse and frame


class SliceGrip:
    """Grabs the frame of a slice and moves the slice along its axis.

    Parameters
    ----------
    slices : Slices
    moved : callable
        Told the axis, and the voxel at which to cut.
    """

    def __init__(self, slices: Slices, moved: Callable[[Axis, int], object]) -> None:
        self._slices, self._moved = slices, moved
        self.pixel_ratio = 1.0
        self._held: tuple[Axis, int, Float[np.ndarray, "2"]] | None = None

    def scale(self, ratio: float) -> None:
        """Tell how many pixels of the picture one of the screen's units is."""
        self.pixel_ratio = ratio

    def over(self, x: float, y: float) -> Axis | None:
        """Return the axis of the slice whose frame lies under a pixel (from the lower left), or None."""
        planes = self._slices.planes
        if planes is None:
            return None
        best, found = REACH * self.pixel_ratio, None
        for axis in AXES:
            if planes.is_seen(axis):
                shown = to_display(self._slices.stage.renderer, planes.corners(axis))
                away = distance_to_segments(np.array([x, y]), shown, np.roll(shown, -1, axis=0)).min()
                if away <= best:
                    best, found = float(away), axis
        return found

    def grab(self, x: float, y: float) -> bool:
        """Take hold of the frame under a pixel; return whether there is one."""
        axis = self.over(x, y)
        if axis is None or self._slices.planes is None:
            return False
        self._held = axis, self._slices.planes.index[axis], np.array([x, y])
        return True

    def drag(self, x: float, y: float) -> None:
        """Move the slice with the mouse."""
        planes = self._slices.planes
        if self._held is None or planes is None:
            return
        axis, index, start = self._held
        length = length_of_drag(
            self._slices.stage.renderer,
            planes.corners(axis).mean(axis=0),
            np.eye(3)[AXES.index(axis)],
            np.array([x, y]) - start,
        )
        wanted = index + round(length / planes.spacing(axis))
        self._moved(axis, int(np.clip(wanted, 0, planes.counts[axis] - 1)))

    def drop(self) -> None:
        """Let go."""
        self._held = None
