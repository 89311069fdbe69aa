"""Grain, avatar and clone side by side, at the stations that compare them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PySide6.QtCore import QObject

from mbstudio.core.units import conversion_factor
from mbstudio.scene.grain_surfaces import surface_of_grain
from mbstudio.scene.layers.side_by_side import Column
from mbstudio.scene.surfaces import avatar_surface, surface_of_body
from mbstudio.ui.language import tr
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.live_avatar import LiveAvatar
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.view.view_tools import ViewTools
from mbstudio.ui.viewport.viewport import Grip
from mbstudio.ui.workers import Task


class Comparison(QObject):
    """What the comparison shows.

    Parameters
    ----------
    studio : Studio
    view : SceneView
    tools : ViewTools

    Attributes
    ----------
    wanted : bool
        Whether it is shown at the stations that have it.
    """

    def __init__(self, studio: Studio, view: SceneView, tools: ViewTools) -> None:
        super().__init__(studio)
        self._studio, self._view, self._tools, self._space = studio, view, tools, studio.workspace
        self._columns = view.scene.layers.side_by_side
        self.wanted = False
        self._built: tuple[object, ...] = ()
        self._grips: list[Grip] = []
        self._view.arranged.connect(self._follow)
        self._space.clone_changed.connect(self._follow)
        self._space.clones_changed.connect(self._follow)
        self._space.fits_changed.connect(self._follow)
        view.avatar_moved.connect(self._avatar_moved)

    @property
    def is_offered(self) -> bool:
        """Whether this station has the comparison, and there is something to compare."""
        there = self._space.state.grains is not None or self._space.clones is not None
        return self._view.display.compares and there

    @property
    def is_shown(self) -> bool:
        return self._columns.is_shown

    def show(self, wanted: bool) -> None:
        """Show grain, avatar and clone next to each other, or the view as it was."""
        self.wanted = wanted
        self._follow()
        self._studio.refresh()

    def _follow(self) -> None:
        on = self.wanted and self.is_offered
        if on:
            self._build()
        if on != self._columns.is_shown:
            self._columns.show(on)
            self._view.picking = not on and self._tools.measuring is None
            # What could be dragged or measured is not to be seen.
            viewport = self._studio.viewport
            self._grips, viewport.grips = viewport.grips, self._grips
            self._view.draw()

    def _build(self) -> None:
        label, state, clones = self._space.selected, self._space.state, self._space.clones
        grains = state.grains
        if label is None:
            label = next(iter(sorted(state.fits)), None)
        fit = state.fits.get(label) if label is not None else None
        number = None if clones is None else self._space.clone or 1
        wanted = (label, grains, fit, clones, number)
        if len(wanted) == len(self._built) and all(a is b for a, b in zip(wanted, self._built, strict=True)):
            return
        self._built = wanted
        clone = clones.body(number - 1) if clones is not None and number is not None else None
        here = grains is not None and label is not None
        unit = grains.unit if here else clones.unit if clones is not None else "um"  # type: ignore[union-attr]

        def make() -> list[Column]:
            surface = None if clone is None else surface_of_body(clone, 64)
            if surface is not None and clones is not None:
                scale = conversion_factor(clones.unit, unit)
                surface = replace(surface, points=(surface.points * np.float32(scale)))
            return [
                Column(
                    tr("Grain") if label is None else tr("Grain {label}", label=label),
                    None if grains is None or label is None else surface_of_grain(grains, label),
                    "grain",
                    tr("No grain is selected."),
                ),
                Column(
                    tr("Avatar") if fit is None else tr("Avatar, n = {n}", n=fit.avatar.n),
                    None if fit is None else avatar_surface(fit.avatar, 64),
                    "avatar",
                    tr("No avatar yet:\nfit the grain at station Fit."),
                ),
                Column(
                    tr("Clone") if number is None else tr("Clone {number}", number=number),
                    surface,
                    "points",
                    tr("No clone yet:\nmake some at station Style."),
                ),
            ]

        def done(columns: list[Column]) -> None:
            if self._built is wanted:
                self._columns.set(columns, unit)
                self._view.draw()

        task = Task(tr("Drawing the comparison"), lambda control: make())
        task.succeeded.connect(done)
        self._studio.queue.submit(task, lane="view", key="comparison")

    def _avatar_moved(self, label: int, live: LiveAvatar) -> None:
        if self._columns.is_shown and label == self._space.selected:
            self._columns.replace(1, live.surface)
