"""The control points of the chosen grain's avatar."""

from __future__ import annotations

from mbstudio.core.translation import mark
from mbstudio.scene.layers.surface_layer import SurfaceLayer


class ControlPoints(SurfaceLayer):
    """An avatar's control points (:func:`~mbstudio.scene.surfaces.control_points`)."""

    title = mark("Control points")
    icon = "ph.dots-nine"
    tip = mark("Control points of the avatar")
    colour = "points"
    is_pickable = False
    is_within_scan = True
