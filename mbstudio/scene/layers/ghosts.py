"""The two grains between which the live one lies, to be seen through."""

from __future__ import annotations

from mbstudio.core.translation import mark
from mbstudio.scene.layers.surface_layer import SurfaceLayer


class GhostA(SurfaceLayer):
    """Grain A."""

    title = mark("Ghost of A")
    icon = "mdi6.alpha-a-circle-outline"
    tip = mark("Grain A, transparent")
    colour = "grain"
    starts_opaque = 0.22
    is_drawn_last = True


class GhostB(SurfaceLayer):
    """Grain B."""

    title = mark("Ghost of B")
    icon = "mdi6.alpha-b-circle-outline"
    tip = mark("Grain B, transparent")
    colour = "points"
    starts_opaque = 0.22
    is_drawn_last = True
