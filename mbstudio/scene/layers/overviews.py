"""Many bodies as one surface each: all in their own colours, or a few brought out."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import numpy as np
import pyvista as pv
from jaxtyping import Float

from mbstudio.scene.layers.layers import Layer
from mbstudio.scene.surfaces import LABEL_ARRAY, Surface
from mbstudio.scene.theme import SceneTheme, label_colours, rgb


class Overviews:
    """The labelled surfaces on a plotter, and the chosen bodies that stand solid among them.

    Parameters
    ----------
    plotter : pyvista.BasePlotter
    """

    def __init__(self, plotter: Any) -> None:
        self._plotter = plotter
        # Not asked of the mapper: before the first rendering it may answer with an empty mesh.
        self._meshes: dict[Layer, pv.PolyData] = {}
        self.others: pv.Actor | None = None

    def add(self, layer: Layer, surface: Surface) -> pv.Actor:
        """Put a labelled surface into the plotter; it has no colours yet."""
        mesh = surface.poly_data()
        self._meshes[layer] = mesh
        mesh.cell_data["colour"] = np.zeros((mesh.n_cells, 3), dtype=np.uint8)
        actor = self._plotter.add_mesh(
            mesh, scalars="colour", rgb=True, smooth_shading=False, specular=0.1, specular_power=20,
            ambient=0.1, name=layer, reset_camera=False, render=False, show_scalar_bar=False,
        )  # fmt: skip
        actor.prop.interpolation = "Phong"
        actor.prop.culling = "back"
        return actor

    def forget(self, layer: Layer) -> None:
        """Let go of a surface whose actor was taken away."""
        self._meshes.pop(layer, None)

    def colour(self, layer: Layer, theme: SceneTheme, chosen: Collection[int]) -> None:
        """Give each body its colour; if some are chosen, the others lose theirs but for a trace."""
        surface = self._meshes.get(layer)
        if surface is None:
            return
        labels = surface.cell_data[LABEL_ARRAY]
        colours = label_colours(int(labels.max()))
        if chosen:
            bright = rgb(theme.grain if layer == "grains" else theme.avatar)
            colours = (0.78 * np.array(rgb(theme.muted)) + 0.22 * colours).astype(np.uint8)
            colours[[label for label in chosen if label < len(colours)]] = bright
        np.asarray(surface.cell_data["colour"])[:] = colours[labels]
        surface.GetCellData().GetArray("colour").Modified()
        surface.Modified()

    def set_others(self, surface: Surface | None, colour: str) -> None:
        """Show the surface of chosen bodies, solid within the overview, or take it away."""
        if self.others is not None:
            self._plotter.remove_actor(self.others, reset_camera=False, render=False)
            self.others = None
        if surface is None or not len(surface.triangles):
            return
        self.others = self._plotter.add_mesh(
            surface.poly_data(),
            color=colour, smooth_shading=False, specular=0.15, specular_power=25, ambient=0.12,
            name="chosen grains", pickable=False, reset_camera=False, render=False, show_scalar_bar=False,
            scalars=None,
        )  # fmt: skip
        self.others.prop.interpolation = "Phong"


def single_surface(plotter: Any, layer: Layer, mesh: pv.PolyData, colour: str, opacity: float) -> pv.Actor:
    """Add the surface of one body in one colour.

    Depth peeling loses see-through surfaces on OSMesa: they are blended, without their back faces.
    """
    actor = plotter.add_mesh(
        mesh, color=colour, smooth_shading=False, specular=0.15, specular_power=25,
        ambient=0.12, name=layer, pickable=layer != "points", reset_camera=False, render=False,
        show_scalar_bar=False,
    )  # fmt: skip
    actor.prop.interpolation = "Phong"
    actor.prop.opacity = opacity
    actor.prop.culling = "back"
    return actor


def draw_last(renderer: Any, actors: Iterable[pv.Actor]) -> None:
    """Let these surfaces be drawn after all others."""
    for actor in actors:
        renderer.RemoveActor(actor)
        renderer.AddActor(actor)


def some_points(actor: Any) -> Float[np.ndarray, "m 3"]:
    """Return points of a surface that span it, 20,000 or a few more at most."""
    points = np.asarray(actor.mapper.dataset.points)
    return points[:: max(1, len(points) // 20_000)]
