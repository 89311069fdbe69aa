"""The box of the part of a scan that is chosen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv
from jaxtyping import Float

from mbstudio.scene.layers.layer import Hit, Layer, Stage
from mbstudio.scene.theme import SceneTheme

Bounds = Float[np.ndarray, "3 2"]


class PartBox(Layer[Bounds]):
    """Twelve edges, to be set with the two ends along x, y and z."""

    is_switched_alone = True
    is_clipped = False
    is_within_scan = True

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self._actor: pv.Actor | None = None

    @property
    def actors(self) -> Sequence[Any]:
        return [] if self._actor is None else [self._actor]

    def set(self, content: Bounds | None, unit: str | None = None) -> None:
        self.stage.set_unit(unit)
        if content is None:
            if self._actor is not None:
                self.stage.remove(self._actor)
                self._actor = None
        elif self._actor is not None:
            self._actor.mapper.dataset = _edges(content)
        else:
            self._actor = self.stage.plotter.add_mesh(
                _edges(content), color=self.stage.theme.grain, line_width=3, name="part of the scan",
                pickable=False, reset_camera=False, render=False, lighting=False,
            )  # fmt: skip
        self.stage.update()

    def recolour(self, theme: SceneTheme) -> None:
        if self._actor is not None:
            self._actor.prop.color = theme.grain

    def pick(self, x: float, y: float) -> Hit | None:
        """Return None: a click means what lies inside the box."""
        return None


def _edges(bounds: Bounds) -> pv.PolyData:
    return pv.Box(bounds=bounds.ravel().tolist()).extract_all_edges()
