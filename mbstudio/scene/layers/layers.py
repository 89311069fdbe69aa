"""The layers of a scene, and which of the theme's colours each has."""

from __future__ import annotations

from typing import Literal, get_args

Layer = Literal[
    "slices", "volume", "grains", "avatars", "grain", "avatar", "deviation", "points", "live", "ghost_a",
    "ghost_b", "shape", "envelope",
]  # fmt: skip
LAYERS: tuple[Layer, ...] = get_args(Layer)
LABELLED: tuple[Layer, ...] = ("grains", "avatars")
"""Layers of many bodies, each triangle with its body's label."""
SEE_THROUGH: tuple[Layer, ...] = ("grain", "ghost_a", "ghost_b", "envelope")
COLOURS: dict[Layer, str] = {
    "grain": "grain", "avatar": "avatar", "points": "points",
    "live": "avatar", "ghost_a": "grain", "ghost_b": "points", "shape": "grain", "envelope": "avatar",
}  # fmt: skip
"""Which of the theme's colours each single surface has."""
