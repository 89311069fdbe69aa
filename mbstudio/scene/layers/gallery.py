"""A tray of bodies next to each other, one of which can be brought out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv
from jaxtyping import Float

from mbstudio.scene import camera
from mbstudio.scene.layers.picking import label_under
from mbstudio.scene.surfaces import LABEL_ARRAY, Surface, avatar_surface, merge
from mbstudio.scene.theme import SceneTheme, rgb

if TYPE_CHECKING:
    from mbstudio.core.metaball import Avatar
    from mbstudio.scene.scene import Scene

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
    avatars: Sequence[Avatar], first: int = 1, *, aspect: float = 1.5, scale: float = 1.0, cells: int = 28
) -> Surface:
    """Return avatars laid out next to each other as one surface; may run in a worker thread.

    Parameters
    ----------
    avatars : sequence of Avatar
    first : int
        Label of the first one; the others follow.
    aspect : float
        Of the picture, width over height.
    scale : float
        By what lengths are multiplied: to another unit.
    cells : int
        Along the longest side of each.
    """
    surfaces = [avatar_surface(avatar, cells) for avatar in avatars]
    lows = np.array([surface.points.min(axis=0) for surface in surfaces])
    highs = np.array([surface.points.max(axis=0) for surface in surfaces])
    places = tray_places(highs - lows, aspect)
    moved = [
        replace(surface, points=((surface.points + shift) * scale).astype(np.float32))
        for surface, shift in zip(surfaces, places - (lows + highs) / 2, strict=True)
    ]
    return merge([(surface, label) for label, surface in enumerate(moved, first)])


class Gallery:
    """The tray on a plotter.

    Parameters
    ----------
    plotter : pyvista.BasePlotter
    theme : SceneTheme
    """

    def __init__(self, plotter: Any, theme: SceneTheme) -> None:
        self._plotter, self._theme = plotter, theme
        self.actor: pv.Actor | None = None
        self._mesh: pv.PolyData | None = None
        self.is_visible = False
        self.selected: int | None = None
        self.serial = 0  # of the tray that is laid out

    @property
    def holds_something(self) -> bool:
        return self._mesh is not None

    def show(self, surface: Surface | None) -> None:
        """Lay out another tray (:func:`tray_surface`), or take the present one away."""
        if self.actor is not None:
            self._plotter.remove_actor(self.actor, reset_camera=False, render=False)
        self.actor = self._mesh = None
        self.serial += 1
        if surface is None or not len(surface.triangles):
            return
        self._mesh = surface.poly_data()
        self._mesh.cell_data["colour"] = np.zeros((self._mesh.n_cells, 3), dtype=np.uint8)
        self.actor = self._plotter.add_mesh(
            self._mesh, scalars="colour", rgb=True, smooth_shading=False, specular=0.15, specular_power=25,
            ambient=0.12, name="gallery", reset_camera=False, render=False, show_scalar_bar=False,
        )  # fmt: skip
        self.actor.prop.interpolation = "Phong"
        self.actor.prop.culling = "back"
        self._colour()
        self.set_visible(self.is_visible)

    def set_visible(self, visible: bool) -> None:
        """Show or hide the tray."""
        self.is_visible = visible
        if self.actor is not None:
            self.actor.SetVisibility(visible)

    def select(self, label: int | None) -> None:
        """Bring one body out by its label; the others keep their colour, a little faded."""
        self.selected = label
        self._colour()

    def recolour(self, theme: SceneTheme) -> None:
        """Take the colours of another theme."""
        self._theme = theme
        self._colour()

    def points(self) -> Float[np.ndarray, "m 3"] | None:
        """Return points that span what is shown of it, or None."""
        if self._mesh is None or not self.is_visible:
            return None
        points = np.asarray(self._mesh.points)
        return points[:: max(1, len(points) // 20_000)]

    def label_at(self, x: float, y: float, renderer: Any) -> int | None:
        """Return the label of the body under a pixel (from the lower left), or None."""
        if self.actor is None or not self.is_visible:
            return None
        return label_under(renderer, [self.actor], x, y)

    def _colour(self) -> None:
        if self._mesh is None:
            return
        plain = np.array(rgb(self._theme.points), dtype=float)
        labels = np.asarray(self._mesh.cell_data[LABEL_ARRAY])
        if self.selected is not None and (labels == self.selected).any():
            faded = 0.55 * np.array(rgb(self._theme.muted)) + 0.45 * plain
            colours = np.where((labels == self.selected)[:, None], plain, faded)
        else:
            colours = np.broadcast_to(plain, (len(labels), 3))
        np.asarray(self._mesh.cell_data["colour"])[:] = colours.astype(np.uint8)
        self._mesh.GetCellData().GetArray("colour").Modified()
        self._mesh.Modified()


class TrayCamera:
    """Looks at the tray from above when it is shown, and goes back when it is hidden.

    Parameters
    ----------
    scene : Scene
        Whose gallery it is.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._looked_at = 0
        self._before: tuple[Any, ...] | None = None
        self._placed: tuple[Any, ...] | None = None

    def refit(self) -> bool:
        """Fit the tray into a picture of another size, if nobody has turned it; return whether it was."""
        renderer = self._scene.plotter.renderer
        if not self._looked_at or camera.stand(renderer) != self._placed:
            return False
        self._scene.fit()
        self._placed = camera.stand(renderer)
        return True

    def follow(self, shown: bool, turned: bool) -> bool:
        """Move the camera if the tray was shown, changed or hidden; return whether it is there.

        Parameters
        ----------
        shown : bool
            Whether the tray is looked at now.
        turned : bool
            Whether what else there is to see was replaced: then there is nothing to go back to.
        """
        serial = self._scene.gallery.serial if shown else 0
        renderer = self._scene.plotter.renderer
        came, went = bool(serial and not self._looked_at), bool(self._looked_at and not serial)
        if came:
            self._before = camera.stand(renderer)
        if turned:
            self._before = None
        if serial and serial != self._looked_at:
            self._scene.look_from("top")
            self._placed = camera.stand(renderer)
        self._looked_at = serial
        if went and self._before is not None:
            camera.return_to(renderer, self._before)
        elif went:
            camera.turn(renderer, "isometric")
        return bool(serial)
