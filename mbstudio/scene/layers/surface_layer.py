"""Surfaces as layers: of one body in one colour, and of many bodies each with its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
import pyvista as pv
from jaxtyping import Float

from mbstudio.scene.layers.layer import Layer, Stage, sample_points
from mbstudio.scene.surfaces import LABEL_ARRAY, Surface
from mbstudio.scene.theme import SceneTheme, label_colours, rgb


def add_surface(stage: Stage, name: str, mesh: pv.PolyData, **look: Any) -> pv.Actor:
    """Put a mesh with normals into the plotter.

    Depth peeling loses see-through surfaces on OSMesa: they are blended, without their back faces.
    """
    shine = {"specular": 0.15, "specular_power": 25, "ambient": 0.12}
    actor = stage.plotter.add_mesh(
        mesh, name=name, smooth_shading=False, reset_camera=False, render=False, show_scalar_bar=False,
        **(shine | look),
    )  # fmt: skip
    actor.prop.interpolation = "Phong"
    actor.prop.culling = "back"
    return actor


def remove_plane(mapper: Any, plane: Any) -> None:
    """Let a plane cut no longer what a mapper draws, if it does."""
    planes = mapper.GetClippingPlanes()
    if planes is not None and planes.IsItemPresent(plane):
        mapper.RemoveClippingPlane(plane)


class SurfaceLayer(Layer[Surface]):
    """The surface of one body.

    Attributes
    ----------
    colour : str
        Which of the theme's colours it has.
    is_pickable : bool
    content : Surface or None
        What is shown.
    """

    colour: ClassVar[str]
    is_pickable: ClassVar[bool] = True

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self.content: Surface | None = None
        self._actor: pv.Actor | None = None
        # Not asked of the mapper: before the first rendering it may answer with an empty mesh.
        self._mesh: pv.PolyData | None = None

    @property
    def actors(self) -> Sequence[Any]:
        return [] if self._actor is None else [self._actor]

    def set(self, content: Surface | None, unit: str | None = None) -> None:
        self.stage.set_unit(unit)
        self.content = content
        if content is None or not len(content.triangles):
            self._remove()
        elif self._mesh is not None:
            # While a slider moves this happens thirty times a second: only the mesh's arrays change.
            content.fill(self._mesh)
        else:
            self._mesh = content.poly_data()
            self._actor = self._add(self._mesh)
        self.stage.update()

    def recolour(self, theme: SceneTheme) -> None:
        if self._actor is not None:
            self._actor.prop.color = getattr(theme, self.colour)

    def points(self) -> Float[np.ndarray, "m 3"] | None:
        return None if self._mesh is None else sample_points(self._mesh)

    def _add(self, mesh: pv.PolyData) -> pv.Actor:
        colour = getattr(self.stage.theme, self.colour)
        actor = add_surface(self.stage, self.name, mesh, color=colour, pickable=self.is_pickable)
        actor.prop.opacity = self.opacity
        return actor

    def _remove(self) -> None:
        if self._actor is not None:
            self.stage.remove(self._actor)
        self._actor = self._mesh = None


class OverviewLayer(SurfaceLayer):
    """Many bodies as one surface, each triangle with the label of its body.

    Attributes
    ----------
    colour : str
        Which of the theme's colours the chosen bodies have.
    """

    shine: ClassVar[dict[str, float]] = {"specular": 0.1, "specular_power": 20, "ambient": 0.1}

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self._content: Surface | None = None
        self._alone: frozenset[int] | None = None  # the only labels that are drawn; None for all

    def set(self, content: Surface | None, unit: str | None = None) -> None:
        self.stage.set_unit(unit)
        self._content = content
        self._draw()
        self.stage.update()

    def choose(self, labels: frozenset[int]) -> None:
        if self._alone_now != self._alone:
            self._draw()
        else:
            self.recolour(self.stage.theme)

    @property
    def _alone_now(self) -> frozenset[int] | None:
        """Labels of the only bodies that are to be drawn; None for all."""
        return self.stage.chosen if self.stage.shows_chosen_alone else None

    def _draw(self) -> None:
        self._remove()
        self._alone, content = self._alone_now, self._content
        if content is not None and self._alone is not None:
            content = content.only(self._alone)
        if content is None or not len(content.triangles):
            return
        self._mesh = content.poly_data()
        self._mesh.cell_data["colour"] = np.zeros((self._mesh.n_cells, 3), dtype=np.uint8)
        self._actor = add_surface(self.stage, self.name, self._mesh, scalars="colour", rgb=True, **self.shine)
        self._actor.prop.opacity = self.opacity
        self.recolour(self.stage.theme)

    def recolour(self, theme: SceneTheme) -> None:
        """Give each body its colour; if some are chosen, the others lose theirs but for a trace."""
        if self._mesh is None:
            return
        labels = np.asarray(self._mesh.cell_data[LABEL_ARRAY])
        np.asarray(self._mesh.cell_data["colour"])[:] = self._colours(labels, theme)
        self._mesh.GetCellData().GetArray("colour").Modified()
        self._mesh.Modified()

    def _colours(self, labels: np.ndarray, theme: SceneTheme) -> np.ndarray:
        """Return the colour, shape (t, 3), of each triangle by its label, shape (t,)."""
        colours, chosen = self._own_colours(int(labels.max()), theme), self.stage.chosen
        if chosen:
            colours = (0.78 * np.array(rgb(theme.muted)) + 0.22 * colours).astype(np.uint8)
            colours[[label for label in chosen if label < len(colours)]] = rgb(getattr(theme, self.colour))
        return np.asarray(colours[labels])

    def _own_colours(self, largest: int, theme: SceneTheme) -> np.ndarray:
        """Return the colour, shape (k, 3), of each label up to the largest while none is chosen."""
        return label_colours(largest)
