"""All grains as one surface, and the chosen ones that stand solid among them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyvista as pv

from mbstudio.core.translation import mark
from mbstudio.scene.layers.layer import Stage
from mbstudio.scene.layers.surface_layer import OverviewLayer, add_surface
from mbstudio.scene.surfaces import Surface
from mbstudio.scene.theme import SceneTheme, rgb, score_colours

GLASS = 0.28
"""Opacity of all grains while some are chosen."""


class AllGrains(OverviewLayer):
    """All grains (:func:`~mbstudio.scene.surfaces.label_surface`), each in its colour."""

    title = mark("All grains")
    icon = "ph.polygon"
    tip = mark("All grains, each in its colour")
    colour = "grain"
    has_outline = True
    is_within_scan = True
    picks_grains = True

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self._solid: pv.Actor | None = None
        self.scores: dict[int, float] | None = None

    @property
    def actors(self) -> Sequence[Any]:
        return [*super().actors, *([] if self._solid is None else [self._solid])]

    @property
    def _alone_now(self) -> frozenset[int] | None:
        # The chosen ones have finer surfaces of their own.
        return frozenset() if self.stage.shows_chosen_alone else None

    def set(self, content: Surface | None, unit: str | None = None) -> None:
        super().set(content, unit)
        self._turn_to_glass()

    def set_scores(self, scores: Mapping[int, float] | None) -> None:
        """Colour grains by scores, 0 quiet to 1 red, grey without one; None gives them their own colours."""
        self.scores = None if scores is None else dict(scores)
        self.recolour(self.stage.theme)

    def _own_colours(self, largest: int, theme: SceneTheme) -> np.ndarray:
        if self.scores is None:
            return super()._own_colours(largest, theme)
        colours = np.tile(np.array(rgb(theme.muted), dtype=np.uint8), (largest + 1, 1))
        known = {label: score for label, score in self.scores.items() if label <= largest}
        if known:
            colours[list(known)] = score_colours(np.array(list(known.values())))
        return colours

    def set_chosen(self, surface: Surface | None) -> None:
        """Show the surface of chosen grains, solid within the overview, or take it away."""
        if self._solid is not None:
            self.stage.remove(self._solid)
            self._solid = None
        if surface is not None and len(surface.triangles):
            self._solid = add_surface(
                self.stage, "chosen grains", surface.poly_data(), color=self.stage.theme.grain,
                pickable=False, scalars=None,
            )  # fmt: skip
            self._solid.prop.culling = "none"
        self.stage.update()

    def set_opacity(self, opacity: float) -> None:
        self.opacity = float(opacity)
        self._turn_to_glass()
        self.stage.update()

    def choose(self, labels: frozenset[int]) -> None:
        super().choose(labels)
        self._turn_to_glass()

    def recolour(self, theme: SceneTheme) -> None:
        super().recolour(theme)
        if self._solid is not None:
            self._solid.prop.color = theme.grain

    def close(self) -> None:
        self.set_chosen(None)
        super().close()

    def _turn_to_glass(self) -> None:
        # Chosen grains may lie deep inside: the others turn to glass around their surfaces.
        if self._actor is not None:
            self._actor.prop.opacity = GLASS if self.stage.chosen else self.opacity
