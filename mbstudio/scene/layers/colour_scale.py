"""A vertical scale of colours beside the picture: what colour is which length."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import UInt8
from vtkmodules.vtkCommonCore import vtkPoints, vtkUnsignedCharArray
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkTextActor

from mbstudio.core.units import METRES_PER_UNIT, unit_label
from mbstudio.scene.layers.annotations import update_before_rendering
from mbstudio.scene.theme import SceneTheme, rgb

COLOURS = 65
# Brewer's RdBu, from blue over a light grey to red: apart for every kind of colour-blindness, and its
# lightness falls alike on both sides of the middle.
_ANCHORS = (
    "#053061", "#2166ac", "#4393c3", "#92c5de", "#d1e5f0", "#f7f7f7", "#fddbc7", "#f4a582", "#d6604d",
    "#b2182b", "#67001f",
)  # fmt: skip


def diverging_colours(count: int = COLOURS) -> UInt8[np.ndarray, "count 3"]:
    """Return colours from blue (negative) over light grey (zero) to red (positive)."""
    return _between(_ANCHORS, count)


# Viridis: its lightness rises evenly, for every kind of colour-blindness and in grey print.
_SEQUENTIAL = (
    "#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b",
    "#fde725",
)  # fmt: skip


def sequential_colours(count: int = COLOURS) -> UInt8[np.ndarray, "count 3"]:
    """Return colours from dark violet (low) over green to yellow (high)."""
    return _between(_SEQUENTIAL, count)


def _between(colours: tuple[str, ...], count: int) -> UInt8[np.ndarray, "count 3"]:
    anchors = np.array([rgb(colour) for colour in colours], dtype=float)
    places = np.linspace(0, len(anchors) - 1, count)
    channels = [np.interp(places, np.arange(len(anchors)), anchors[:, channel]) for channel in range(3)]
    return np.round(np.column_stack(channels)).astype(np.uint8)


def round_range(length: float) -> float:
    """Return the smallest round number that is not below a length; 1 if that is 0.

    >>> round_range(0.0317)
    0.04
    """
    if not length > 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(length))
    steps = (1, 1.2, 1.6, 2, 2.4, 3, 4, 5, 6, 8, 10)
    step = next(step for step in steps if step * power >= length * (1 - 1e-9))
    return float(f"{step * power:.6g}")


def readable_unit(length: float, unit: str) -> tuple[float, str]:
    """Return by what lengths are multiplied for a short number of this size, and the unit's label."""
    metres = abs(length) * METRES_PER_UNIT[unit]
    name = next((n for n in ("m", "mm", "um", "nm") if metres >= 0.5 * METRES_PER_UNIT[n]), "nm")
    return METRES_PER_UNIT[unit] / METRES_PER_UNIT[name], unit_label(name)


class ColourScale:
    """Colours, five lengths beside them, a heading above and lines of text below.

    Parameters
    ----------
    renderer : vtkRenderer
    theme : SceneTheme
    colours : uint8 array, shape (65, 3), optional
        From below to above; blue over grey to red by default.
    """

    WIDTH, HEIGHT, MARGIN, TEXT = 14, 170, 22, 13  # pixels at scale 1

    def __init__(
        self, renderer: Any, theme: SceneTheme, colours: UInt8[np.ndarray, "c 3"] | None = None
    ) -> None:
        self.pixel_ratio = 1.0
        self._renderer = renderer
        self._points = vtkPoints()
        self._points.SetNumberOfPoints(2 * (COLOURS + 1))
        strip = vtkPolyData()
        strip.SetPoints(self._points)
        cells, painted = vtkCellArray(), vtkUnsignedCharArray()
        painted.SetNumberOfComponents(3)
        for row, colour in enumerate(diverging_colours() if colours is None else colours):
            cells.InsertNextCell(4, (2 * row, 2 * row + 1, 2 * row + 3, 2 * row + 2))
            painted.InsertNextTuple3(*(int(channel) for channel in colour))
        strip.SetPolys(cells)
        strip.GetCellData().SetScalars(painted)
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(strip)
        self._strip = vtkActor2D()
        self._strip.SetMapper(mapper)
        self.heading, self.foot = vtkTextActor(), vtkTextActor()
        self.ticks = [vtkTextActor() for _ in range(5)]
        for text in (self.heading, self.foot):
            text.GetTextProperty().SetJustificationToRight()
            text.GetTextProperty().SetLineSpacing(1.25)
        self.heading.GetTextProperty().SetVerticalJustificationToTop()
        self.foot.GetTextProperty().SetVerticalJustificationToTop()
        for text in self.ticks:
            text.GetTextProperty().SetJustificationToRight()
            text.GetTextProperty().SetVerticalJustificationToCentered()
        for actor in (self._strip, *self._texts):
            actor.PickableOff()
            renderer.AddViewProp(actor)
        self.recolour(theme)
        self.set_visible(False)
        self._observer = update_before_rendering(renderer, self)

    @property
    def _texts(self) -> list[Any]:
        return [self.heading, self.foot, *self.ticks]

    def show(self, heading: str, reach: float, unit: str, foot: str) -> None:
        """Tell what the colours from -`reach` to `reach` mean.

        Parameters
        ----------
        heading : str
            What is shown; its unit is added.
        reach : float
            In `unit`.
        unit : str
            Canonical unit; the numbers are in the one that makes them short.
        foot : str
            Below the scale.
        """
        factor, label = readable_unit(reach, unit)
        values = [share * reach * factor for share in (-1, -0.5, 0, 0.5, 1)]
        self.explain(f"{heading} ({label})", [f"{value:+.3g}" if value else "0" for value in values], foot)

    def explain(self, heading: str, ticks: Sequence[str], foot: str) -> None:
        """Write a heading, what five colours evenly from below to above mean, and lines below."""
        self.heading.SetInput(heading)
        self.foot.SetInput(foot)
        for told, text in zip(ticks, self.ticks, strict=True):
            text.SetInput(told.replace("-", "\N{MINUS SIGN}"))

    def recolour(self, theme: SceneTheme) -> None:
        """Write in a theme's ink."""
        for text in self._texts:
            text.GetTextProperty().SetColor(*(channel / 255 for channel in rgb(theme.ink)))

    def set_visible(self, visible: bool) -> None:
        """Show or hide it."""
        for actor in (self._strip, *self._texts):
            actor.SetVisibility(visible)

    def update(self) -> None:
        """Place it in a picture of the present size: in the upper right corner, where bodies leave room."""
        if not self._strip.GetVisibility():
            return
        width, height = self._renderer.GetSize()
        ratio = self.pixel_ratio
        tall = min(self.HEIGHT * ratio, 0.45 * height)
        right, top = width - self.MARGIN * ratio, height - self.MARGIN * ratio
        low = top - 30 * ratio - tall
        for row in range(COLOURS + 1):
            y = low + tall * row / COLOURS
            self._points.SetPoint(2 * row, right - self.WIDTH * ratio, y, 0)
            self._points.SetPoint(2 * row + 1, right, y, 0)
        self._points.Modified()
        for share, text in zip((0, 0.25, 0.5, 0.75, 1), self.ticks, strict=True):
            text.SetPosition(right - (self.WIDTH + 7) * ratio, low + share * tall)
        self.heading.SetPosition(right, top)
        self.foot.SetPosition(right, low - 12 * ratio)
        for text in self._texts:
            text.GetTextProperty().SetFontSize(round(self.TEXT * ratio))

    def remove(self) -> None:
        """Take it out of its renderer."""
        self._renderer.RemoveObserver(self._observer)
        for actor in (self._strip, *self._texts):
            self._renderer.RemoveViewProp(actor)
