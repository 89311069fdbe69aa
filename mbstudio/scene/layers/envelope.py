"""The avatar itself over what is exported."""

from __future__ import annotations

from mbstudio.core.translation import mark
from mbstudio.scene.layers.surface_layer import SurfaceLayer


class Envelope(SurfaceLayer):
    """The avatar over the shape that stands for it in an export."""

    title = mark("Avatar over it")
    icon = "ph.circle-half"
    tip = mark("The avatar itself, transparent")
    colour = "avatar"
    starts_opaque = 0.4
    is_drawn_last = True
