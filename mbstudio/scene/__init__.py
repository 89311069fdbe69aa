"""pyvista scenes on any plotter; no Qt. The same code draws the window and the figures."""

from mbstudio.scene.scene import LAYERS, VIEWS, Layer, Scene, View
from mbstudio.scene.theme import DARK, LIGHT, SceneTheme

__all__ = ["DARK", "LAYERS", "LIGHT", "VIEWS", "Layer", "Scene", "SceneTheme", "View"]
