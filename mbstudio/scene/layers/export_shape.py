"""What stands for an avatar in an export."""

from __future__ import annotations

import pyvista as pv

from mbstudio.core.translation import mark
from mbstudio.scene.layers.layer import Stage
from mbstudio.scene.layers.surface_layer import SurfaceLayer
from mbstudio.scene.theme import SceneTheme


class ExportShape(SurfaceLayer):
    """Spheres, or a mesh whose edges can be drawn (:mod:`~mbstudio.scene.export_preview`)."""

    title = mark("Export")
    icon = "ph.circles-four"
    tip = mark("Spheres or mesh that represent the avatar in the export")
    colour = "grain"

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self._edges = False

    def set_edges(self, shown: bool) -> None:
        """Draw the edges of the triangles, or draw them no longer."""
        self._edges = shown
        if self._actor is not None:
            self._draw_edges(self._actor, self.stage.theme)

    def recolour(self, theme: SceneTheme) -> None:
        super().recolour(theme)
        if self._actor is not None:
            self._draw_edges(self._actor, theme)

    def _add(self, mesh: pv.PolyData) -> pv.Actor:
        actor = super()._add(mesh)
        self._draw_edges(actor, self.stage.theme)
        return actor

    def _draw_edges(self, actor: pv.Actor, theme: SceneTheme) -> None:
        actor.prop.show_edges, actor.prop.edge_color = self._edges, theme.ink
