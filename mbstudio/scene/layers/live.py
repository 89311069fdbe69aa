"""The grain that is being shaped by hand."""

from __future__ import annotations

from mbstudio.core.translation import mark
from mbstudio.scene.layers.surface_layer import SurfaceLayer


class LiveGrain(SurfaceLayer):
    """The grain at the sliders, whose surface changes many times a second."""

    title = mark("Live grain")
    icon = "ph.hand"
    tip = mark("The grain that is being shaped")
    colour = "avatar"
