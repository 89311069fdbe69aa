"""Which layers of the view belong to which station."""

from __future__ import annotations

from mbstudio.scene import Layer

# Layers that can be switched at each station.
STATION_LAYERS: dict[str, tuple[Layer, ...]] = {
    "scan": ("slices", "volume"),
    "grains": ("slices", "volume", "grains"),
    "fit": ("slices", "grain", "avatar", "points"),
    "populations": ("slices", "grains", "avatars"),
    "style": (),
    "latent": ("live", "ghost_a", "ghost_b"),
    "export": ("slices", "grains", "avatars", "shape", "envelope"),
}
FIRST_LAYERS: dict[str, tuple[Layer, ...]] = {
    "scan": ("slices",),
    "grains": ("grains",),
    "fit": ("grain", "avatar"),
    "populations": ("grains",),
    "style": (),
    "latent": ("live",),
    "export": ("avatars", "shape", "envelope"),
}
"""What each station shows unless told otherwise."""
