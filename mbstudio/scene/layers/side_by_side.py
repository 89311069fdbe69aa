"""Bodies in columns next to each other, all seen by one camera."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyvista as pv
from jaxtyping import Float
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkTextActor

from mbstudio.scene import camera
from mbstudio.scene.layers.annotations import ScaleBar
from mbstudio.scene.layers.layer import Layer, Stage
from mbstudio.scene.surfaces import Surface
from mbstudio.scene.theme import SceneTheme, rgb


@dataclass(frozen=True, eq=False)
class Column:
    """One body of the comparison.

    Attributes
    ----------
    caption : str
        Above it.
    surface : Surface or None
        In the unit of the others; None where there is no such body.
    colour : str
        Name of one of the theme's colours.
    hint : str
        What to do where there is none.
    """

    caption: str
    surface: Surface | None
    colour: str
    hint: str = ""


class SideBySide(Layer[Sequence[Column]]):
    """The columns; while they are shown, the plotter's own renderer draws nothing.

    Attributes
    ----------
    unit : str
        Canonical unit of the surfaces, for the scale bar.
    """

    starts_shown = False
    is_switched_alone = True
    is_clipped = False

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self.unit = stage.unit
        self.pixel_ratio = 1.0
        self._columns: list[Column] = []
        self._renderers: list[Any] = []
        self._observers: list[int] = []
        self._actors: list[pv.Actor | None] = []
        self._texts: list[tuple[Any, Any]] = []
        self._bar: ScaleBar | None = None
        self._before: tuple[Any, ...] | None = None
        self._reach = np.ones(3)

    @property
    def actors(self) -> Sequence[Any]:
        """Nothing that the plotter's own renderer draws."""
        return []

    @property
    def holds_something(self) -> bool:
        return bool(self._columns)

    def show(self, on: bool) -> None:
        """Show the columns, or what the plotter showed before them, from where it was seen."""
        if on == self.is_shown:
            return
        self.is_shown = on
        main = self.stage.renderer
        if on:
            self._before = camera.pose(main)
            self._draw()
        else:
            self._erase()
            if self._before is not None:
                camera.set_pose(main, self._before)
        main.SetDraw(not on)

    def set(self, content: Sequence[Column] | None, unit: str | None = None) -> None:
        """Compare other bodies; the camera moves only if what there is to see has another size."""
        self._columns, self.unit = list(content or ()), unit or self.unit
        if self.is_shown:
            reach = self._reach
            self._draw()
            if not np.allclose(self._reach, reach, rtol=0.3):
                self.fit()

    def replace(self, place: int, surface: Surface) -> None:
        """Show another surface in one column: cheap, for what moves."""
        if not self.is_shown or place >= len(self._actors):
            return
        old = self._columns[place]
        self._columns[place] = Column(old.caption, surface, old.colour, old.hint)
        actor = self._actors[place]
        if actor is None:
            self._draw()
        else:
            actor.mapper.dataset = surface.poly_data()
            actor.position = tuple(-_middle(surface))

    def fit(self) -> None:
        """Bring every body into its column, without turning."""
        found = [points for points in self._centred_points() if len(points)]
        if found and self._renderers:
            camera.fit(self._renderers[0], np.concatenate(found))

    def recolour(self, theme: SceneTheme) -> None:
        if self.is_shown:
            self._draw()

    def set_pixel_ratio(self, ratio: float) -> None:
        self.pixel_ratio = ratio

    def close(self) -> None:
        self._erase()
        self._columns, self.is_shown = [], False

    # ---- inside ----------------------------------------------------------------------------------

    def _centred_points(self) -> list[Float[np.ndarray, "m 3"]]:
        return [
            np.zeros((0, 3)) if column.surface is None else column.surface.points - _middle(column.surface)
            for column in self._columns
        ]

    def _draw(self) -> None:
        first = not self._renderers
        self._erase()
        points = self._centred_points()
        self._reach = np.max([np.abs(p).max(axis=0) for p in points if len(p)] or [np.ones(3)], axis=0)
        count = max(1, len(self._columns))
        for place, column in enumerate(self._columns):
            renderer = vtkRenderer()
            renderer.SetViewport(place / count, 0, (place + 1) / count, 1)
            renderer.SetActiveCamera(self.stage.renderer.GetActiveCamera())
            renderer.SetGradientBackground(True)
            renderer.SetBackground(*_share(self.stage.theme.bottom))
            renderer.SetBackground2(*_share(self.stage.theme.top))
            for light in self.stage.renderer.GetLights():
                renderer.AddLight(light)
            self._actors.append(self._body(renderer, column))
            self._texts.append(self._words(renderer, column))
            self.stage.plotter.render_window.AddRenderer(renderer)
            self._renderers.append(renderer)
            self._observers.append(self._arrange_before_rendering(renderer, place))
        if self._renderers:
            self._bar = ScaleBar(self._renderers[-1], self.unit, self.stage.theme)
        if first:
            self.fit()

    def _body(self, renderer: Any, column: Column) -> pv.Actor | None:
        if column.surface is None:
            return None
        actor = pv.Actor(mapper=pv.DataSetMapper(dataset=column.surface.poly_data()))
        actor.mapper.scalar_visibility = False
        actor.prop.color = getattr(self.stage.theme, column.colour)
        actor.prop.interpolation = "Phong"
        actor.prop.specular, actor.prop.specular_power, actor.prop.ambient = 0.15, 25, 0.12
        actor.prop.culling = "back"
        actor.position = tuple(-_middle(column.surface))
        renderer.AddActor(actor)
        return actor

    def _words(self, renderer: Any, column: Column) -> tuple[Any, Any]:
        caption, hint = vtkTextActor(), vtkTextActor()
        caption.SetInput(column.caption)
        hint.SetInput(column.hint if column.surface is None else "")
        for text in (caption, hint):
            look = text.GetTextProperty()
            look.SetColor(*_share(self.stage.theme.ink))
            look.SetJustificationToCentered()
            look.SetVerticalJustificationToCentered()
            look.SetLineSpacing(1.3)
            renderer.AddViewProp(text)
        caption.GetTextProperty().SetBold(True)
        caption.GetTextProperty().SetVerticalJustificationToTop()
        return caption, hint

    def _arrange_before_rendering(self, renderer: Any, place: int) -> int:
        """Have words and camera arranged before each picture of a column; return the observer's number."""
        alive, column = weakref.ref(self), weakref.ref(renderer)

        def arrange(*_: object) -> None:
            present, there = alive(), column()
            if present is not None and there is not None:
                present._arrange(there, place)

        return int(renderer.AddObserver("StartEvent", arrange))

    def _arrange(self, renderer: Any, place: int) -> None:
        """Put the words to their places, and nothing of any body beyond the camera's range."""
        reach = 1.2 * self._reach
        renderer.ResetCameraClippingRange(-reach[0], reach[0], -reach[1], reach[1], -reach[2], reach[2])
        width, height = renderer.GetSize()
        caption, hint = self._texts[place]
        caption.SetPosition(width / 2, height - 18 * self.pixel_ratio)
        hint.SetPosition(width / 2, height / 2)
        caption.GetTextProperty().SetFontSize(round(15 * self.pixel_ratio))
        hint.GetTextProperty().SetFontSize(round(13 * self.pixel_ratio))
        if self._bar is not None:
            self._bar.pixel_ratio = self.pixel_ratio

    def _erase(self) -> None:
        if self._bar is not None:
            self._bar.remove()
            self._bar = None
        for renderer, observer in zip(self._renderers, self._observers, strict=True):
            renderer.RemoveObserver(observer)
            renderer.RemoveAllViewProps()
            if self.stage.plotter.render_window is not None:
                self.stage.plotter.render_window.RemoveRenderer(renderer)
        self._renderers, self._observers, self._actors, self._texts = [], [], [], []


def _middle(surface: Surface) -> Float[np.ndarray, "3"]:
    return np.asarray((surface.points.min(axis=0) + surface.points.max(axis=0)) / 2, dtype=float)


def _share(colour: str) -> tuple[float, ...]:
    return tuple(channel / 255 for channel in rgb(colour))
