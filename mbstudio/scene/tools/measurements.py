"""Distances and angles between points that were picked, drawn over the picture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkTextActor

from mbstudio.scene.layers.annotations import readable_length, update_before_rendering
from mbstudio.scene.layers.picking import to_display
from mbstudio.scene.theme import SceneTheme, rgb

Kind = Literal["distance", "angle"]
POINTS: dict[Kind, int] = {"distance": 2, "angle": 3}
"""How many points each takes."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """Points and what they are measured for.

    Attributes
    ----------
    kind : {'distance', 'angle'}
        An angle is that at the second of three points.
    points : float array, shape (m, 3)
        Fewer than the kind takes while they are being picked.
    """

    kind: Kind
    points: Float[np.ndarray, "m 3"]

    @property
    def is_complete(self) -> bool:
        return len(self.points) == POINTS[self.kind]

    @property
    def value(self) -> float:
        """The distance in the points' unit, or the angle in degrees; NaN while points are missing."""
        if not self.is_complete:
            return math.nan
        if self.kind == "distance":
            return float(np.linalg.norm(self.points[1] - self.points[0]))
        first, second = self.points[0] - self.points[1], self.points[2] - self.points[1]
        # Exact for flat and straight angles too, where arccos is not.
        return math.degrees(math.atan2(float(np.linalg.norm(np.cross(first, second))), float(first @ second)))

    def format_value(self, unit: str) -> str:
        """Return the value with its unit, empty while points are missing."""
        if not self.is_complete:
            return ""
        return readable_length(self.value, unit) if self.kind == "distance" else f"{self.value:.1f}°"


class Measurements:
    """The measurements of a scene and their drawing, which nothing hides.

    Parameters
    ----------
    renderer : vtkRenderer
    theme : SceneTheme
    unit : str
        Canonical unit of the scene's coordinates.
    """

    def __init__(self, renderer: Any, theme: SceneTheme, unit: str) -> None:
        self.unit = unit
        self.pixel_ratio = 1.0
        self.measured: list[Measurement] = []
        self._renderer, self._theme = renderer, theme
        self._places, self._lines = vtkPoints(), vtkPolyData()
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(self._lines)
        self._actor = vtkActor2D()
        self._actor.SetMapper(mapper)
        self._actor.PickableOff()
        renderer.AddViewProp(self._actor)
        self._texts: list[vtkTextActor] = []
        self._observer = update_before_rendering(renderer, self)

    def add_point(self, kind: Kind, point: Float[np.ndarray, "3"]) -> Measurement:
        """Add a point to the measurement under way, or begin one; return it."""
        row = np.asarray(point, dtype=float)[None]
        if self.measured and self.measured[-1].kind == kind and not self.measured[-1].is_complete:
            self.measured[-1] = Measurement(kind, np.concatenate([self.measured[-1].points, row]))
        else:
            self.drop_unfinished()
            self.measured.append(Measurement(kind, row))
        return self.measured[-1]

    def drop_unfinished(self) -> None:
        """Forget points of a measurement that was not ended."""
        self.measured = [given for given in self.measured if given.is_complete]

    def clear(self) -> None:
        """Forget all."""
        self.measured = []

    def recolour(self, theme: SceneTheme) -> None:
        """Take the colours of another theme."""
        self._theme = theme

    def update(self) -> None:
        """Draw everything where the camera sees it now."""
        while len(self._texts) < len(self.measured):
            text = vtkTextActor()
            text.PickableOff()
            self._renderer.AddViewProp(text)
            self._texts.append(text)
        while len(self._texts) > len(self.measured):
            self._renderer.RemoveViewProp(self._texts.pop())
        self._places, lines = vtkPoints(), vtkCellArray()
        ink = tuple(channel / 255 for channel in rgb(self._theme.ink))
        for measurement, text in zip(self.measured, self._texts, strict=True):
            seen = to_display(self._renderer, measurement.points)
            self._line(lines, seen)
            for place in seen:
                self._line(lines, place + 4.5 * self.pixel_ratio * _RING)
            self._write(text, measurement, seen, ink)
        self._lines.Initialize()
        self._lines.SetPoints(self._places)
        self._lines.SetLines(lines)
        self._actor.GetProperty().SetColor(*ink)
        self._actor.GetProperty().SetLineWidth(2 * self.pixel_ratio)

    def _line(self, lines: Any, places: Float[np.ndarray, "m 2"]) -> None:
        if len(places) > 1:
            lines.InsertNextCell(len(places))
            for x, y in places:
                lines.InsertCellPoint(self._places.InsertNextPoint(float(x), float(y), 0.0))

    def _write(
        self, text: Any, measurement: Measurement, seen: Float[np.ndarray, "m 2"], ink: tuple[float, ...]
    ) -> None:
        text.SetInput(measurement.format_value(self.unit))
        text.SetVisibility(measurement.is_complete)
        look = text.GetTextProperty()
        look.SetFontSize(round(15 * self.pixel_ratio))
        look.SetBold(True)
        look.SetColor(*ink)
        look.SetBackgroundColor(*(channel / 255 for channel in rgb(self._theme.bottom)))
        look.SetBackgroundOpacity(0.75)
        look.SetJustificationToLeft()
        look.SetVerticalJustificationToBottom()
        middle = seen.mean(axis=0) if measurement.kind == "distance" else seen[min(1, len(seen) - 1)]
        text.SetPosition(*(middle + 9 * self.pixel_ratio))

    def remove(self) -> None:
        """Take everything out of the renderer."""
        self._renderer.RemoveObserver(self._observer)
        for actor in (self._actor, *self._texts):
            self._renderer.RemoveViewProp(actor)


_turn = np.linspace(0, 2 * np.pi, 13)
_RING = np.column_stack([np.cos(_turn), np.sin(_turn)])
