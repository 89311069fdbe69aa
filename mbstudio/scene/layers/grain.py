"""The surface of the chosen grain."""

from __future__ import annotations

from mbstudio.core.translation import mark
from mbstudio.scene.layers.surface_layer import SurfaceLayer


class ChosenGrain(SurfaceLayer):
    """One grain, through which its avatar is to be seen."""

    title = mark("Grain")
    icon = "ph.circle-half"
    tip = mark("Surface of the selected grain")
    colour = "grain"
    starts_opaque = 0.6
    # Drawn after the avatar inside it plain blending is right.
    is_drawn_last = True
    is_within_scan = True
    shows_one_grain = True
