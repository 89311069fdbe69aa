"""A tray of bodies next to each other, one of which can be brought out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Float

from mbstudio.scene.layers.layer import Stage
from mbstudio.scene.layers.surface_layer import OverviewLayer
from mbstudio.scene.surfaces import Surface, merge, surface_of_body
from mbstudio.scene.theme import SceneTheme, rgb

if TYPE_CHECKING:
    import trimesh

    from mbstudio.core.metaball import Avatar

GAP = 1.12
"""Cells of the tray are by this factor larger than the largest body."""


def tray_places(extents: Float[np.ndarray, "bodies 3"], aspect: float) -> Float[np.ndarray, "bodies 3"]:
    """Return where bodies lie on the plane z = 0, row by row from the upper left.

    Parameters
    ----------
    extents : float array, shape (bodies, 3)
        Sizes along x, y and z.
    aspect : float
        Width of the picture over its height: the tray gets as near to it as whole rows allow.

    Returns
    -------
    float array, shape (bodies, 3)
    """
    count = len(extents)
    width, height = (GAP * float(side) for side in np.max(extents, axis=0)[:2])
    columns = min(range(1, count + 1), key=lambda c: max(c * width / aspect, math.ceil(count / c) * height))
    place = np.arange(count)
    return np.column_stack([place % columns * width, -(place // columns) * height, np.zeros(count)])


def tray_surface(
    bodies: Sequence[Avatar | trimesh.Trimesh], first: int = 1, *, aspect: float = 1.5, scale: float = 1.0,
    cells: int = 28,
) -> Surface:  # fmt: skip
    """Return bodies laid out next to each other as one surface; may run in a worker thread.

    Parameters
    ----------
    bodies : sequence of Avatar or trimesh.Trimesh
    first : int
        Label of the first one; the others follow.
    aspect : float
        Of the picture, width over height.
    scale : float
        By what lengths are multiplied: to another unit.
    cells : int
        Along the longest side of each avatar; meshes are made about as coarse.
    """
    # A surface that crosses so many cells has about four triangles a cell of its shell.
    surfaces = [surface_of_body(body, cells, most=4 * cells**2) for body in bodies]
    lows = np.array([surface.points.min(axis=0) for surface in surfaces])
    highs = np.array([surface.points.max(axis=0) for surface in surfaces])
    places = tray_places(highs - lows, aspect)
    moved = [
        replace(surface, points=((surface.points + shift) * scale).astype(np.float32))
        for surface, shift in zip(surfaces, places - (lows + highs) / 2, strict=True)
    ]
    return merge([(surface, label) for label, surface in enumerate(moved, first)])


class Tray(OverviewLayer):
    """The bodies that are laid out (:func:`tray_surface`).

    Attributes
    ----------
    selected : int or None
        Label of the body that is brought out.
    serial : int
        Counts what was laid out.
    """

    colour = "points"
    shine: ClassVar[dict[str, float]] = {}
    starts_shown = False

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self.selected: int | None = None
        self.serial = 0

    def set(self, content: Surface | None, unit: str | None = None) -> None:
        self.serial += 1
        super().set(content, unit)

    def select(self, label: int | None) -> None:
        """Bring one body out by its label; the others keep their colour, a little faded."""
        self.selected = label
        self.recolour(self.stage.theme)

    def choose(self, labels: frozenset[int]) -> None:
        """Do nothing: what lies here has labels of its own."""

    def _colours(self, labels: np.ndarray, theme: SceneTheme) -> np.ndarray:
        plain = np.array(rgb(getattr(theme, self.colour)), dtype=float)
        if self.selected is None or not (labels == self.selected).any():
            return np.broadcast_to(plain, (len(labels), 3)).astype(np.uint8)
        faded = 0.55 * np.array(rgb(theme.muted)) + 0.45 * plain
        return np.where((labels == self.selected)[:, None], plain, faded).astype(np.uint8)
