"""Keeps the view in step with a grain that is shaped from surfaces."""

from __future__ import annotations

from functools import partial

import numpy as np
from PySide6.QtCore import QObject

from mbstudio.core.cloning.surface_studio import ShapedGrain
from mbstudio.scene.label_net import vertex_normals
from mbstudio.scene.surfaces import Surface, avatar_surface
from mbstudio.ui.deferred_calls import DeferredCalls
from mbstudio.ui.stations.latent.surface_sliders import SurfaceSliders
from mbstudio.ui.stations.latent.surface_work import SurfaceWork
from mbstudio.ui.stations.station import Station
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView

_CELLS = 64  # of the metaball along its longest side


class SurfaceLink(QObject):
    """Shows the shaped grain, or its metaball at rest.

    Parameters
    ----------
    station : Station
    studio : Studio
    view : SceneView
    work : SurfaceWork
    sliders : SurfaceSliders
    """

    def __init__(
        self, station: Station, studio: Studio, view: SceneView, work: SurfaceWork, sliders: SurfaceSliders
    ) -> None:
        super().__init__(studio)
        self._station, self._studio, self._view = station, studio, view
        self._work, self._sliders = work, sliders
        self._layer = view.scene.layers.live
        self._framed: object = None
        self._deferred = DeferredCalls(self)
        work.style_taken.connect(self._take_style)
        work.grain_changed.connect(self._show)
        work.fitted_changed.connect(self._show)
        sliders.shows_metaball.toggled.connect(lambda _: self._show())

    def entered(self) -> None:
        """Show the grain when the station is entered with a style of surfaces."""
        style = self._work.style
        if style is not None:
            self._view.scene.set_unit(style.unit)
            # The docks of the station take their room first.
            self._deferred.call(partial(self._frame, True))

    def _take_style(self) -> None:
        if self._work.is_opening:
            self._layer.set(None)
        self._framed = None
        if self._work.style is not None and self._station.is_open:
            self.entered()
        self._view.arrange()
        self._studio.arrange_docks()

    def _show(self) -> None:
        work, style = self._work, self._work.style
        grain = work.grain
        if style is None or grain is None:
            return
        rests = grain is work.at_rest
        fitted = work.fitted if rests and self._sliders.shows_metaball.isChecked() else None
        shown = shown_surface(grain) if fitted is None else avatar_surface(fitted.avatar, _CELLS)
        self._layer.set(shown, style.unit if self._station.is_open else None)
        if self._station.is_open:
            # Never under the hand: only what has come to rest moves the camera.
            self._frame(rests)

    def _frame(self, may_move: bool) -> None:
        style = self._work.style
        if not self._station.is_open or style is None or self._work.grain is None:
            return
        if self._framed is not style:
            self._framed = style
            self._view.arrange()
            self._view.scene.look_from("isometric")
        elif may_move:
            self._view.scene.fit_if_cut()
        self._studio.viewport.request_render()


def shown_surface(grain: ShapedGrain) -> Surface:
    """Return a shaped grain as the view shows it."""
    points, triangles = grain.surface
    return Surface(points.astype(np.float32), triangles, vertex_normals(points, triangles))
