"""The outline of the scan's box, to be seen with the layers that fill it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv

from mbstudio.scene.layers.layer import Hit, Layer, Stage
from mbstudio.scene.theme import SceneTheme

if TYPE_CHECKING:
    from mbstudio.core.scan import Scan


class Outline(Layer["Scan"]):
    """Twelve thin edges from voxel edge to voxel edge."""

    starts_opaque = 0.35
    is_switched_alone = True
    is_clipped = False

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self._actor: pv.Actor | None = None

    @property
    def actors(self) -> Sequence[Any]:
        return [] if self._actor is None else [self._actor]

    def set(self, content: Scan | None, unit: str | None = None) -> None:
        if self._actor is not None:
            self.stage.remove(self._actor)
            self._actor = None
        if content is not None:
            self.stage.set_unit(content.unit)
            low = np.array(content.origin) - np.array(content.voxel_size.xyz) / 2
            bounds = np.column_stack([low, low + content.size]).ravel().tolist()
            self._actor = self.stage.plotter.add_mesh(
                pv.Box(bounds=bounds).extract_all_edges(), color=self.stage.theme.ink, opacity=self.opacity,
                line_width=1, pickable=False, reset_camera=False, render=False, name="scan box",
                lighting=False,
            )  # fmt: skip
        self.stage.update()

    def recolour(self, theme: SceneTheme) -> None:
        if self._actor is not None:
            self._actor.prop.color = theme.ink

    def pick(self, x: float, y: float) -> Hit | None:
        """Return None: nobody means a thin line."""
        return None
