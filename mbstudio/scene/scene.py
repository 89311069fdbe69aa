"""One scene: a scan, its grains, the chosen grain and its avatar, on any pyvista plotter.

The same class draws the window, the pictures of a headless run and the figures of a report.
Nothing here knows Qt; everything here must run in the thread that owns the plotter.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pyvista as pv
from jaxtyping import Float, UInt8

from mbstudio.scene import camera
from mbstudio.scene.camera import VIEWS, View
from mbstudio.scene.layers.annotations import CornerAxes, ScaleBar
from mbstudio.scene.layers.deviation_map import DeviationMap, DeviationSurface
from mbstudio.scene.layers.gallery import Gallery
from mbstudio.scene.layers.layers import COLOURS, LABELLED, LAYERS, SEE_THROUGH, Layer
from mbstudio.scene.layers.overviews import Overviews, draw_last, single_surface, some_points
from mbstudio.scene.layers.picking import foremost_point, label_under
from mbstudio.scene.layers.side_by_side import SideBySide
from mbstudio.scene.layers.slices import SlicePlanes, scan_box
from mbstudio.scene.layers.volume import VolumeCloud, VolumeVoxels
from mbstudio.scene.surfaces import Surface
from mbstudio.scene.theme import LIGHT, SceneTheme
from mbstudio.scene.tools.clip_box import ClipBox
from mbstudio.scene.tools.measurements import Measurements

if TYPE_CHECKING:
    from mbstudio.core.scan import Scan

__all__ = ["LAYERS", "VIEWS", "Layer", "Scene", "View"]


class Scene:
    """What is shown, as layers that can each be set, shown and hidden.

    Parameters
    ----------
    plotter : pyvista.BasePlotter
        Any plotter: off-screen, a Qt widget's, a subplot's.
    theme : SceneTheme
    unit : str
        Canonical unit of the coordinates, for the scale bar.
    """

    def __init__(self, plotter: pv.BasePlotter, theme: SceneTheme = LIGHT, unit: str = "um") -> None:
        # pyvista's wrappers hide the methods' types.
        self.plotter: Any = cast(Any, plotter)
        self.theme = theme
        self.unit = unit
        self.slices: SlicePlanes | None = None
        self.selected: int | None = None
        self.chosen: frozenset[int] = frozenset()
        self._actors: dict[Layer, pv.Actor] = {}
        self._opacity: dict[Layer, float] = {
            "grain": 0.6, "avatar": 1.0, "points": 1.0, "ghost_a": 0.22, "ghost_b": 0.22, "envelope": 0.4
        }  # fmt: skip
        self._visible: dict[Layer, bool] = dict.fromkeys(LAYERS, True)
        self._box: pv.Actor | None = None
        # Not asked of the mappers: before the first rendering they may answer with an empty mesh.
        self._meshes: dict[Layer, pv.PolyData] = {}
        self._cloud: VolumeCloud | None = None
        self._moving = False
        self._renderer: Any = plotter.renderer
        self._overviews = Overviews(self.plotter)
        self.gallery = Gallery(self.plotter, theme)
        plotter.renderer.camera.SetParallelProjection(True)
        # Else the first rendering turns the camera to pyvista's own preset.
        plotter.renderer.camera_set = True
        self._bar = ScaleBar(plotter, unit, theme.ink)
        self._bar.set_visible(False)
        self._deviation = DeviationMap(self.plotter, theme.ink)
        self.measurements = Measurements(self._renderer, theme, unit)
        self.clip = ClipBox(self.plotter, theme)
        self.columns = SideBySide(self.plotter, theme, unit)
        self._corner = CornerAxes(self.plotter)
        scale = self._deviation.scale
        self._overlays = (self.columns, self._bar, scale, self.measurements, self.clip, self._corner)
        self.set_theme(theme)

    # ---- what is shown ------------------------------------------------------------------

    def set_scan(self, scan: Scan | None) -> None:
        """Show a scan by three slices, or take the present one away."""
        if self.slices is not None:
            self.slices.remove()
        self.slices = None
        self._remove_volume()
        if self._box is not None:
            self.plotter.remove_actor(self._box, reset_camera=False, render=False)
            self._box = None
        if scan is None:
            return
        self.set_unit(scan.unit)
        self.slices = SlicePlanes(self.plotter, scan, self.theme.axes)
        self.slices.set_visible(self._visible["slices"])
        self._box = scan_box(self.plotter, scan, self.theme.ink)
        self._apply_visibility()

    def set_volume(self, voxels: VolumeVoxels | None) -> None:
        """Show a scan's voxels (:func:`~mbstudio.scene.layers.volume.volume_voxels`) as a cloud."""
        self._remove_volume()
        if voxels is not None and self.slices is not None:
            self._cloud = VolumeCloud(self.plotter, voxels, self.slices.window)
        self._apply_visibility()

    def set_window(self, low: float, high: float) -> None:
        """Show grey value `low` of the scan black and `high` white, in slices and volume."""
        if self.slices is not None:
            self.slices.set_window(low, high)
        if self._cloud is not None:
            self._cloud.set_window(low, high)

    def set_moving(self, moving: bool) -> None:
        """Tell that the camera is being turned by hand: the volume is drawn by fewer voxels."""
        self._moving = moving
        self._apply_visibility()

    def _remove_volume(self) -> None:
        if self._cloud is not None:
            self._cloud.remove()
            self._cloud = None

    @property
    def has_volume(self) -> bool:
        return self._cloud is not None

    def set_grains(self, surface: Surface | None, unit: str | None = None) -> None:
        """Show all grains as one surface (:func:`~mbstudio.scene.surfaces.label_surface`)."""
        self._set_labelled("grains", surface, unit)

    def set_avatars(self, surface: Surface | None, unit: str | None = None) -> None:
        """Show many avatars where their grains lie."""
        self._set_labelled("avatars", surface, unit)

    def set_grain(self, surface: Surface | None, unit: str | None = None) -> None:
        """Show one grain's surface."""
        self._set_surface("grain", surface, unit)

    def set_avatar(self, surface: Surface | None, unit: str | None = None) -> None:
        """Show one avatar's surface."""
        self._set_surface("avatar", surface, unit)

    def set_deviation(self, shown: DeviationSurface | None) -> None:
        """Show how far the avatar lies from its grain as colours on its surface."""
        self._remove("deviation")
        if shown is not None:
            self.set_unit(shown.deviation.unit)
            self._actors["deviation"] = self._deviation.add(shown)
        self._apply_visibility()

    @property
    def has_deviation(self) -> bool:
        return "deviation" in self._actors

    def set_points(self, spheres: Surface | None) -> None:
        """Show an avatar's control points (:func:`~mbstudio.scene.surfaces.control_points`)."""
        self._set_surface("points", spheres, None)

    def set_live(self, surface: Surface | None, unit: str | None = None) -> None:
        """Show the grain that is being shaped by hand."""
        self._set_surface("live", surface, unit)

    def set_ghosts(self, first: Surface | None, second: Surface | None) -> None:
        """Show two grains through which one can see, as what the live one lies between."""
        self._set_surface("ghost_a", first, None)
        self._set_surface("ghost_b", second, None)

    def set_export(self, shape: Surface | None, avatar: Surface | None, unit: str | None = None) -> None:
        """Show what stands for an avatar in an export, and the avatar over it."""
        self._set_surface("shape", shape, unit)
        self._set_surface("envelope", avatar, None)

    def set_edges(self, shown: bool) -> None:
        """Draw the edges of the export's triangles."""
        if "shape" in self._actors:
            prop = self._actors["shape"].prop
            prop.show_edges, prop.edge_color = shown, self.theme.ink

    def set_unit(self, unit: str | None) -> None:
        """Take another unit of the coordinates, for the scale bar; None leaves it."""
        if unit is not None:
            self.unit = self._bar.unit = self.measurements.unit = unit

    def set_others(self, surface: Surface | None) -> None:
        """Show the surface of the chosen grains beside the selected one, solid within the overview."""
        self._overviews.set_others(surface, self.theme.grain)
        self._apply_visibility()

    def select(self, label: int | None, others: Collection[int] = ()) -> None:
        """Bring out one grain of the overview, and any others with it: the rest loses its colour."""
        self.selected = label
        self.chosen = frozenset(others) | (frozenset() if label is None else {label})
        for layer in LABELLED:
            self._overviews.colour(layer, self.theme, self.chosen)
        if "grains" in self._actors:
            # Chosen grains may lie deep inside: the others turn to glass around their surfaces.
            self._actors["grains"].prop.opacity = 0.28 if self.chosen else 1.0

    def clear(self) -> None:
        """Take everything away."""
        self.set_scan(None)
        for layer in LAYERS:
            self._remove(layer)
        self.set_others(None)
        self.gallery.show(None)

    def set_gallery(self, surface: Surface | None, unit: str | None = None) -> None:
        """Lay bodies out next to each other (:func:`~mbstudio.scene.layers.gallery.tray_surface`)."""
        self.set_unit(unit)
        self.gallery.show(surface)
        self._apply_visibility()

    # ---- how it is shown ----------------------------------------------------------------

    def show_layers(self, shown: set[Layer]) -> None:
        """Show exactly these layers (those that hold something)."""
        self._visible = {layer: layer in shown for layer in LAYERS}
        self._apply_visibility()

    def show_layer(self, layer: Layer, shown: bool) -> None:
        """Show or hide one layer."""
        self._visible[layer] = shown
        self._apply_visibility()

    def is_shown(self, layer: Layer) -> bool:
        """Return whether a layer is to be seen (it may hold nothing yet)."""
        return self._visible[layer]

    def show_gallery(self, shown: bool) -> None:
        """Show or hide the bodies that are laid out."""
        self.gallery.set_visible(shown)
        self._apply_visibility()

    def set_opacity(self, layer: Layer, opacity: float) -> None:
        """Make a surface see-through: 0 not to be seen, 1 solid."""
        self._opacity[layer] = float(opacity)
        if layer in self._actors:
            self._actors[layer].prop.opacity = float(opacity)
        self._apply_visibility()

    def opacity(self, layer: Layer) -> float:
        """Return a surface's opacity."""
        return self._opacity.get(layer, 1.0)

    def set_theme(self, theme: SceneTheme) -> None:
        """Change all colours."""
        self.theme = theme
        self._renderer.set_background(theme.bottom, top=theme.top)
        self._bar.recolour(theme.ink)
        self._deviation.scale.recolour(theme.ink)
        for part in (self.measurements, self.clip, self.columns, self.gallery, self._corner):
            part.recolour(theme)
        if self._box is not None:
            self._box.prop.color = theme.ink
        if self.slices is not None:
            self.slices.recolour(theme.axes)
        for layer, name in COLOURS.items():
            if layer in self._actors:
                self._actors[layer].prop.color = getattr(theme, name)
        if self._overviews.others is not None:
            self._overviews.others.prop.color = theme.grain
        for layer in LABELLED:
            self._overviews.colour(layer, self.theme, self.chosen)

    def flatten(self, layer: Layer, colour: str, background: str) -> None:
        """Show one layer alone in one flat colour: its silhouette, for measuring pictures."""
        self.set_theme(replace(self.theme, top=background, bottom=background))
        self.show_layers({layer})
        self._bar.set_visible(False)
        if self._box is not None:
            self._box.SetVisibility(False)
        self._renderer.axes_actor.SetVisibility(False)
        actor = self._actors[layer]
        actor.prop.color = colour
        actor.prop.opacity = 1.0
        actor.prop.lighting = False

    def set_pixel_ratio(self, ratio: float) -> None:
        """Tell how many pixels of the picture one of the screen's units is, for text and lines."""
        for part in self._overlays:
            part.pixel_ratio = ratio

    # ---- camera -------------------------------------------------------------------------

    def fit(self) -> None:
        """Bring all that is shown into the picture, without turning."""
        points = self.points()
        if self.columns.is_on:
            self.columns.fit()
        elif points is not None:
            camera.fit(self._renderer, points)

    def fit_if_cut(self) -> None:
        """Bring what is shown into the picture if a part of it lies outside."""
        points = self.points()
        if points is not None and not camera.shows(self._renderer, points):
            camera.fit(self._renderer, points)

    def look_from(self, view: View) -> None:
        """Turn to one of the preset views and fit."""
        camera.turn(self._renderer, view)
        self.fit()

    def points(self) -> np.ndarray | None:
        """Return points, shape (m, 3), that span all that is shown, or None."""
        tray = self.gallery.points()
        found = [] if tray is None else [tray]
        if self._box is not None and self._box.GetVisibility():
            found.append(np.asarray(self._box.mapper.dataset.points))
        else:
            for layer in ("grains", "avatars", "deviation", *COLOURS):
                if layer in self._actors and self._visible[layer]:
                    found.append(some_points(self._actors[layer]))
        return np.concatenate(found).astype(float) if found else None

    # ---- asking the picture ---------------------------------------------------------------

    def label_at(self, x: float, y: float) -> int | None:
        """Return the label of the grain or avatar under a pixel (from the lower left), or None."""
        shown = [self._actors[layer] for layer in LABELLED if layer in self._actors and self._visible[layer]]
        return label_under(self._renderer, shown, x, y)

    def point_at(self, x: float, y: float) -> Float[np.ndarray, "3"] | None:
        """Return the foremost point of a surface or slice under a pixel (from the lower left), or None."""
        surfaces = [one for one in self._cuttable() if one.GetVisibility() and isinstance(one, pv.Actor)]
        on_slice = None if self.slices is None else self.slices.point_on
        return foremost_point(self._renderer, surfaces, on_slice, x, y)

    def screenshot(self) -> UInt8[np.ndarray, "h w 3"]:
        """Render and return the picture."""
        self.plotter.render()
        return np.asarray(self.plotter.screenshot(return_img=True))

    # ---- inside ---------------------------------------------------------------------------

    def _set_surface(self, layer: Layer, surface: Surface | None, unit: str | None) -> None:
        self.set_unit(unit)
        if surface is None or not len(surface.triangles):
            self._remove(layer)
        elif layer in self._actors:
            # While a slider moves this happens thirty times a second: only the mesh's arrays change.
            surface.fill(self._meshes[layer])
        else:
            colour = getattr(self.theme, COLOURS[layer])
            mesh = self._meshes[layer] = surface.poly_data()
            self._actors[layer] = single_surface(self.plotter, layer, mesh, colour, self.opacity(layer))
            # With the grain drawn after the avatar inside it plain blending is right.
            if layer not in SEE_THROUGH:
                draw_last(self._renderer, [self._actors[one] for one in SEE_THROUGH if one in self._actors])
        self._apply_visibility()

    def _set_labelled(self, layer: Layer, surface: Surface | None, unit: str | None) -> None:
        self.set_unit(unit)
        self._remove(layer)
        if surface is not None and len(surface.triangles):
            self._actors[layer] = self._overviews.add(layer, surface)
            self.select(self.selected, self.chosen)
        self._apply_visibility()

    def _cuttable(self) -> list[Any]:
        """Return the actors of all surfaces and of the volume."""
        more = (self._overviews.others, self.gallery.actor)
        clouds = () if self._cloud is None else (self._cloud.actor, self._cloud.coarse)
        return [*clouds, *self._actors.values(), *(actor for actor in more if actor is not None)]

    def _remove(self, layer: Layer) -> None:
        self._overviews.forget(layer)
        self._meshes.pop(layer, None)
        actor = self._actors.pop(layer, None)
        if actor is not None:
            self.plotter.remove_actor(actor, reset_camera=False, render=False)
            self._apply_visibility()

    def _apply_visibility(self) -> None:
        if self.slices is not None:
            self.slices.set_visible(self._visible["slices"])
        if self._cloud is not None:
            self._cloud.set_visible(self._visible["volume"], self._moving)
        for layer, actor in self._actors.items():
            actor.SetVisibility(self._visible[layer] and self.opacity(layer) > 0.001)
        if self._overviews.others is not None:
            self._overviews.others.SetVisibility(self._visible["grains"])
        if self._box is not None:
            self._box.SetVisibility(any(self._visible[layer] for layer in ("slices", "volume", "grains")))
        self.clip.cut(self._cuttable())
        self._deviation.scale.set_visible(self.has_deviation and self._visible["deviation"])
        self._bar.set_visible(self.points() is not None)

    def close(self) -> None:
        """Let go of the plotter's objects; the plotter itself is closed by its owner."""
        self.clear()
        for part in self._overlays:
            part.remove()
