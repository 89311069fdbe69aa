"""One scene: a scan, its grains, the chosen grain and its avatar, on any pyvista plotter.

The same class draws the window, the pictures of a headless run and the figures of a report.
Nothing here knows Qt; everything here must run in the thread that owns the plotter.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv
from jaxtyping import Float, UInt8

from mbstudio.scene import camera
from mbstudio.scene.camera import View
from mbstudio.scene.layers.annotations import CornerAxes, ScaleBar
from mbstudio.scene.layers.layer import Hit, Layer, Stage
from mbstudio.scene.layers.picking import sight
from mbstudio.scene.layers.registry import Layers
from mbstudio.scene.theme import LIGHT, SceneTheme
from mbstudio.scene.tools.clip_box import ClipBox
from mbstudio.scene.tools.measurements import Measurements

if TYPE_CHECKING:
    from mbstudio.core.scan import Scan


class Scene:
    """What is shown, as layers that can each be set, shown and hidden.

    Parameters
    ----------
    plotter : pyvista.BasePlotter
        Any plotter: off-screen, a Qt widget's, a subplot's.
    theme : SceneTheme
    unit : str
        Canonical unit of the coordinates, for the scale bar.

    Attributes
    ----------
    layers : Layers
        By name or as attributes: ``scene.layers.avatar.set(surface)``.
    clip : ClipBox
    measurements : Measurements
    selected : int or None
        Label of the grain that is looked at.
    """

    def __init__(self, plotter: pv.BasePlotter, theme: SceneTheme = LIGHT, unit: str = "um") -> None:
        self._stage = Stage(plotter, theme, unit)
        self.plotter: Any = self._stage.plotter
        self._renderer = self._stage.renderer
        self.selected: int | None = None
        self._drawn: list[Any] = []
        self._renderer.camera.SetParallelProjection(True)
        # Else the first rendering turns the camera to pyvista's own preset.
        self._renderer.camera_set = True
        self._bar = ScaleBar(self._renderer, unit, theme)
        self.layers = Layers(self._stage)
        self.measurements = Measurements(self._renderer, theme, unit)
        self.clip = ClipBox(self.plotter, theme)
        self._corner = CornerAxes(self._renderer)
        self._parts: tuple[Any, ...] = (self._bar, self.measurements, self.clip, self._corner)
        self._stage.update = self._update
        self.set_theme(theme)
        self._update()

    # ---- what is shown ------------------------------------------------------------------

    def set_scan(self, scan: Scan | None) -> None:
        """Show a scan by three slices in its outline, or take the present one away, with its volume."""
        self.layers.volume.set(None)
        self.layers.slices.set(scan)
        self.layers.outline.set(scan)

    def set_window(self, low: float, high: float) -> None:
        """Show grey value `low` of the scan black and `high` white, in slices and volume."""
        self.layers.slices.set_window(low, high)
        self.layers.volume.set_window(low, high)

    @property
    def unit(self) -> str:
        """Canonical unit of the coordinates."""
        return self._stage.unit

    def set_unit(self, unit: str | None) -> None:
        """Take another unit of the coordinates, for scale bar and measurements; None leaves it."""
        self._stage.set_unit(unit)
        self._update()

    @property
    def chosen(self) -> frozenset[int]:
        """Labels of the grains that are brought out."""
        return self._stage.chosen

    def select(self, label: int | None, others: Collection[int] = ()) -> None:
        """Bring out one grain where many are shown, and any others with it: the rest loses its colour."""
        self.selected = label
        self._stage.chosen = frozenset(others) | (frozenset() if label is None else {label})
        for layer in self.layers.values():
            layer.choose(self._stage.chosen)

    @property
    def isolated(self) -> bool:
        """Whether the grains that are brought out are shown alone."""
        return self._stage.isolated

    def isolate(self, on: bool) -> None:
        """Hide all grains but those that are brought out, or show them again."""
        self._stage.isolated = on
        for layer in self.layers.values():
            layer.choose(self._stage.chosen)
        self._update()

    # ---- how it is shown ----------------------------------------------------------------

    def show_layers(self, shown: Collection[str]) -> None:
        """Show exactly these layers (those that hold something).

        Layers that are switched alone, as the bodies side by side, stay as they are.

        Raises
        ------
        KeyError
            If the scene has no layer of such a name.
        """
        unknown = set(shown) - set(self.layers)
        if unknown:
            raise KeyError(f"The scene has no layer {', '.join(sorted(unknown))}.")
        for name, layer in self.layers.items():
            if not layer.is_switched_alone:
                layer.is_shown = name in shown
        self._update()

    @property
    def theme(self) -> SceneTheme:
        return self._stage.theme

    def set_theme(self, theme: SceneTheme) -> None:
        """Change all colours."""
        self._stage.theme = theme
        self._renderer.set_background(theme.bottom, top=theme.top)
        for part in self._parts:
            part.recolour(theme)
        for layer in self.layers.values():
            layer.recolour(theme)

    def set_pixel_ratio(self, ratio: float) -> None:
        """Tell how many pixels of the picture one of the screen's units is, for text and lines."""
        for part in self._parts:
            part.pixel_ratio = ratio
        for layer in self.layers.values():
            layer.set_pixel_ratio(ratio)

    def set_moving(self, moving: bool) -> None:
        """Tell that the camera is being turned by hand: the volume is drawn by fewer voxels."""
        for layer in self.layers.values():
            layer.set_moving(moving)

    # ---- camera -------------------------------------------------------------------------

    def fit(self) -> None:
        """Bring all that is shown into the picture, without turning."""
        points = self.points()
        if self.layers.side_by_side.is_shown:
            self.layers.side_by_side.fit()
        elif points is not None:
            camera.fit(self._renderer, points)

    def fit_if_cut(self) -> None:
        """Bring what is shown into the picture if a part of it lies outside."""
        points = self.points()
        if points is not None and not camera.shows(self._renderer, points):
            camera.fit(self._renderer, points)

    def frame(self, points: Float[np.ndarray, "m 3"], room: float = 1.0) -> None:
        """Bring points (x, y, z) into the picture, with `room` times their size around them."""
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        camera.fit(self._renderer, middle + room * (points - middle))

    def centre(self, point: Float[np.ndarray, "3"]) -> None:
        """Move a point (x, y, z) into the middle of the picture, from where one looks now."""
        camera.centre(self._renderer, point)

    def look_from(self, view: View) -> None:
        """Turn to one of the preset views and fit."""
        camera.turn(self._renderer, view)
        self.fit()

    def points(self) -> Float[np.ndarray, "m 3"] | None:
        """Return points that span all that is shown, or None."""
        found = [points for layer in self._spanning_layers() if (points := layer.points()) is not None]
        return np.concatenate(found).astype(float) if found else None

    # ---- asking the picture ---------------------------------------------------------------

    def pick(self, x: float, y: float) -> Hit | None:
        """Return what lies foremost under a pixel (from the lower left), or None."""
        return self._pick(self.layers.values(), x, y)

    def pick_grain(self, x: float, y: float) -> Hit | None:
        """Return what of a grain lies foremost under a pixel (from the lower left), or None.

        The hit is one of many grains or avatars, and has its label; or the grain that is looked at by itself;
        or a slice, in which a grain may lie.
        """
        layers = (layer for layer in self.layers.values() if layer.picks_grains or layer.shows_one_grain)
        return self._pick(layers, x, y)

    def label_at(self, x: float, y: float) -> int | None:
        """Return the label of the grain or avatar under a pixel (from the lower left), or None."""
        hit = self._pick((layer for layer in self.layers.values() if layer.picks_grains), x, y)
        return None if hit is None else hit.label

    def screenshot(self) -> UInt8[np.ndarray, "h w 3"]:
        """Render and return the picture."""
        self.plotter.render()
        return np.asarray(self.plotter.screenshot(return_img=True))

    def close(self) -> None:
        """Let go of the plotter's objects; the plotter itself is closed by its owner."""
        for layer in self.layers.values():
            layer.close()
        self._stage.update = lambda: None
        for part in self._parts:
            part.remove()

    # ---- inside ---------------------------------------------------------------------------

    def _pick(self, layers: Iterable[Layer[Any]], x: float, y: float) -> Hit | None:
        start, along = sight(self._renderer, x, y)
        hits = [hit for layer in layers if layer.is_visible and (hit := layer.pick(x, y)) is not None]
        return min(hits, key=lambda hit: float((hit.point - start) @ along)) if hits else None

    def _spanning_layers(self) -> list[Layer[Any]]:
        """Return the layers that span what is shown: the scan's outline stands for what lies inside it."""
        shown = [layer for layer in self.layers.values() if layer.is_shown and layer.holds_something]
        if self.layers.outline in shown:
            shown = [layer for layer in shown if not layer.is_within_scan]
        return shown

    def _update(self) -> None:
        """Bring everything in step with layers that were set, shown or hidden."""
        layers = list(self.layers.values())
        self.layers.outline.is_shown = any(layer.is_shown for layer in layers if layer.has_outline)
        for layer in layers:
            layer.refresh()
        self._draw_see_through_last()
        self.clip.cut([actor for layer in layers if layer.is_clipped for actor in layer.actors])
        self._bar.unit = self.measurements.unit = self._stage.unit
        self._bar.set_visible(bool(self._spanning_layers()))

    def _draw_see_through_last(self) -> None:
        """Have layers that one sees through drawn after all others, if an actor has come since."""
        before = {id(actor) for actor in self._drawn}
        self._drawn = [actor for layer in self.layers.values() for actor in layer.actors]
        if all(id(actor) in before for actor in self._drawn):
            return
        for layer in self.layers.values():
            if layer.is_drawn_last:
                for actor in layer.actors:
                    self._renderer.RemoveActor(actor)
                    self._renderer.AddActor(actor)
