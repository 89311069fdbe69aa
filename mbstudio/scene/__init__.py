"""pyvista scenes on any plotter; no Qt. The same code draws the window and the figures.

What a scene shows are its layers (`layers`, one module each, named in `layers.registry`).
Begin at `scene`, which sets, shows, fits and picks them; `surfaces` makes what most of them take.
"""

from mbstudio.scene.camera import VIEWS, View
from mbstudio.scene.layers.layer import Hit, Layer
from mbstudio.scene.layers.registry import LAYERS, switched_layers
from mbstudio.scene.scene import Scene
from mbstudio.scene.theme import DARK, LIGHT, SceneTheme

__all__ = [
    "DARK", "LAYERS", "LIGHT", "VIEWS", "Hit", "Layer", "Scene", "SceneTheme", "View", "switched_layers",
]  # fmt: skip
