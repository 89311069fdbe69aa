"""Size and directions in a picture: a scale bar with its unit, and the axes in the corner."""

from __future__ import annotations

import math
import weakref
from typing import Any, Protocol

from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkTextActor

from mbstudio.core.units import METRES_PER_UNIT, unit_label
from mbstudio.scene.theme import SceneTheme, rgb


def round_length(length: float) -> float:
    """Return the largest of 1, 2 or 5 times a power of ten that is not above `length`."""
    power = 10.0 ** math.floor(math.log10(length))
    return next(step * power for step in (5, 2, 1) if step * power <= length * (1 + 1e-9))


def readable_length(length: float, unit: str) -> str:
    """Return a length in the unit that gives the shortest number: 0.5 mm becomes 500 µm.

    >>> readable_length(2000, "um")
    '2 mm'
    """
    metres = length * METRES_PER_UNIT[unit]
    for name in ("m", "mm", "um", "nm"):
        if metres >= METRES_PER_UNIT[name] * (1 - 1e-9):
            return f"{metres / METRES_PER_UNIT[name]:.4g} {unit_label(name)}"
    return f"{length:g} {unit_label(unit)}"


class Updated(Protocol):
    """What is drawn anew for each picture."""

    def update(self) -> None:
        """Follow the camera and the size of the picture."""


def update_before_rendering(renderer: Any, part: Updated) -> int:
    """Have a part follow the camera and the picture's size; return the observer's number."""
    # The renderer must not keep the part alive: VTK's observers and Python's references
    # would form a ring that outlives the window.
    known = weakref.ref(part)

    def update(*_: object) -> None:
        alive = known()
        if alive is not None:
            alive.update()

    return int(renderer.AddObserver("StartEvent", update))


class ScaleBar:
    """A bar of round length in the lower right corner; exact, as the projection is parallel.

    Parameters
    ----------
    renderer : vtkRenderer
    unit : str
        Canonical unit of the scene's coordinates.
    theme : SceneTheme
    """

    WIDEST = 0.22  # of the picture's width
    MARGIN = 22  # pixels at scale 1

    def __init__(self, renderer: Any, unit: str, theme: SceneTheme) -> None:
        self.unit = unit
        self.pixel_ratio = 1.0
        self.length = 0.0
        self._renderer = renderer
        self._points = vtkPoints()
        self._points.SetNumberOfPoints(4)
        line = vtkPolyData()
        line.SetPoints(self._points)
        cells = vtkCellArray()
        for first, second in ((0, 1), (0, 2), (1, 3)):
            cells.InsertNextCell(2)
            cells.InsertCellPoint(first)
            cells.InsertCellPoint(second)
        line.SetLines(cells)
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(line)
        self._line = vtkActor2D()
        self._line.SetMapper(mapper)
        self._text = vtkTextActor()
        properties = self._text.GetTextProperty()
        properties.SetJustificationToCentered()
        properties.SetVerticalJustificationToBottom()
        self.recolour(theme)
        for actor in (self._line, self._text):
            actor.PickableOff()
            self._renderer.AddViewProp(actor)
        self._observer = update_before_rendering(self._renderer, self)

    def recolour(self, theme: SceneTheme) -> None:
        """Draw bar and text in a theme's ink."""
        red, green, blue = (channel / 255 for channel in rgb(theme.ink))
        self._line.GetProperty().SetColor(red, green, blue)
        self._text.GetTextProperty().SetColor(red, green, blue)

    def set_visible(self, visible: bool) -> None:
        """Show or hide the bar."""
        self._line.SetVisibility(visible)
        self._text.SetVisibility(visible)

    def update(self) -> None:
        """Fit the bar to the camera and the size of the picture."""
        width, height = self._renderer.GetSize()
        scale = self._renderer.GetActiveCamera().GetParallelScale()
        if height < 2 or not (math.isfinite(scale) and scale > 0):
            return
        per_pixel = 2 * scale / height
        self.length = round_length(self.WIDEST * width * per_pixel)
        pixels, margin = self.length / per_pixel, self.MARGIN * self.pixel_ratio
        right, base, tick = width - margin, margin, 5 * self.pixel_ratio
        ends = (right - pixels, right)
        for number, (x, y) in enumerate(
            [(ends[0], base), (ends[1], base), (ends[0], base + tick), (ends[1], base + tick)]
        ):
            self._points.SetPoint(number, x, y, 0)
        self._points.Modified()
        self._line.GetProperty().SetLineWidth(2 * self.pixel_ratio)
        self._text.SetInput(readable_length(self.length, self.unit))
        self._text.GetTextProperty().SetFontSize(round(15 * self.pixel_ratio))
        self._text.SetPosition(right - pixels / 2, base + 3 * self.pixel_ratio)

    def remove(self) -> None:
        """Take the bar out of its renderer."""
        self._renderer.RemoveObserver(self._observer)
        for actor in (self._line, self._text):
            self._renderer.RemoveViewProp(actor)


class CornerAxes:
    """The directions of x, y and z in the lower left corner, of the same size in every window.

    Parameters
    ----------
    renderer : pyvista.Renderer
    """

    SIDE = 120  # pixels at scale 1
    SCALE = 1.5  # half that side, in lengths of an axis
    TEXT = 15

    def __init__(self, renderer: Any) -> None:
        self.pixel_ratio = 1.0
        self._renderer = renderer
        self._axes = self._renderer.add_axes(line_width=3)
        self._axes.SetNormalizedLabelPosition(1.45, 1.45, 1.45)
        for caption in self._captions():
            # By default the letters grow with the frame and stand off to the upper right.
            caption.GetTextActor().SetTextScaleModeToNone()
            look = caption.GetCaptionTextProperty()
            look.ItalicOff()
            look.ShadowOff()
            look.BoldOn()
            look.SetJustificationToCentered()
            look.SetVerticalJustificationToCentered()
        self._observer = update_before_rendering(self._renderer, self)

    def _captions(self) -> list[Any]:
        return [getattr(self._axes, f"Get{name}AxisCaptionActor2D")() for name in "XYZ"]

    def update(self) -> None:
        """Keep size and place whatever the size of the picture."""
        width, height = self._renderer.GetSize()
        if min(width, height) < 2:
            return
        side = self.SIDE * self.pixel_ratio
        widget = self._renderer.axes_widget
        widget.SetViewport(0, 0, min(side / width, 1), min(side / height, 1))
        # The widget chose its scale once, for the shape that the picture had then.
        widget.GetRenderer().GetActiveCamera().SetParallelScale(self.SCALE)
        for caption in self._captions():
            caption.GetCaptionTextProperty().SetFontSize(round(self.TEXT * self.pixel_ratio))
            caption.SetPosition(-3 * self.pixel_ratio, -3 * self.pixel_ratio)

    def recolour(self, theme: SceneTheme) -> None:
        """Draw axes and letters in a theme's colours."""
        ink = tuple(channel / 255 for channel in rgb(theme.ink))
        for name, colour in zip("XYZ", theme.axes, strict=True):
            share = tuple(channel / 255 for channel in rgb(colour))
            for part in ("Shaft", "Tip"):
                look = getattr(self._axes, f"Get{name}Axis{part}Property")()
                look.SetColor(*share)
                look.SetAmbient(0.0)
                look.LightingOff()
        for caption in self._captions():
            caption.GetCaptionTextProperty().SetColor(*ink)

    def remove(self) -> None:
        """Let go of the renderer, which removes the axes itself."""
        self._renderer.RemoveObserver(self._observer)
