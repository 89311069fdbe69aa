"""All avatars at the positions of their grains, as one surface."""

from __future__ import annotations

from mbstudio.core.translation import mark
from mbstudio.scene.layers.surface_layer import OverviewLayer


class AllAvatars(OverviewLayer):
    """All avatars (:func:`~mbstudio.scene.surfaces.avatars_surface`)."""

    title = mark("All avatars")
    icon = "ph.selection-all"
    tip = mark("All avatars at the positions of their grains")
    colour = "avatar"
    is_within_scan = True
    picks_grains = True
