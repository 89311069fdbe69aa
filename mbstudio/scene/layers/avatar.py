"""The surface of the chosen grain's avatar."""

from __future__ import annotations

from mbstudio.core.translation import mark
from mbstudio.scene.layers.surface_layer import SurfaceLayer


class ChosenAvatar(SurfaceLayer):
    """One avatar, also while it is being fitted."""

    title = mark("Avatar")
    icon = "ph.circles-three"
    tip = mark("Surface of the selected grain's avatar")
    colour = "avatar"
    is_within_scan = True
    shows_one_grain = True
