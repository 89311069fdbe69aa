"""A box with faces that can be dragged: surfaces and volume are to be seen inside it only."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv
from jaxtyping import Float
from vtkmodules.vtkCommonDataModel import vtkPlane

from mbstudio.scene.layers.picking import length_of_drag, to_display
from mbstudio.scene.layers.surface_layer import remove_plane
from mbstudio.scene.theme import SceneTheme

LEAST = 0.02  # of the whole that stays between two faces
REACH = 11.0  # pixels at scale 1 between mouse and the middle of a face


def _is_cut(actor: Any) -> bool:
    planes = actor.mapper.GetClippingPlanes()
    return planes is not None and planes.GetNumberOfItems() > 0


class ClipBox:
    """Cuts what is drawn by six planes, and is the grip by which they are dragged.

    Parameters
    ----------
    plotter : pyvista.BasePlotter
    theme : SceneTheme

    Attributes
    ----------
    is_on : bool
    shares : float array, shape (3, 2)
        Where the faces across x, y and z stand, 0 to 1 between the ends of what is shown.
    """

    def __init__(self, plotter: Any, theme: SceneTheme) -> None:
        self._plotter, self._theme = plotter, theme
        self.pixel_ratio = 1.0
        self.is_on = False
        self.shares = np.tile([0.0, 1.0], (3, 1))
        self.changed: Any = lambda: None
        self._low, self._high = np.zeros(3), np.ones(3)
        self._planes = [[vtkPlane(), vtkPlane()] for _ in range(3)]
        self._actors: list[Any] = []
        self._frame: pv.Actor | None = None
        self._handles: pv.Actor | None = None
        self._held: tuple[int, int, float, Float[np.ndarray, "2"]] | None = None

    # ---- what is cut -----------------------------------------------------------------------------

    def span(self, points: Float[np.ndarray, "m 3"]) -> None:
        """Let the faces stand between the ends of these points."""
        low, high = points.min(axis=0), points.max(axis=0)
        # A little wider: at first nothing at all is cut.
        edge = 0.01 * max(float((high - low).max()), 1e-12)
        self._low, self._high = low - edge, high + edge
        self._place()

    def cut(self, actors: list[Any]) -> None:
        """Cut these actors (and no others), if it is on."""
        gone = [actor for actor in self._actors if not self.is_on or actor not in actors]
        for actor in gone:
            # A layer may cut its actor by a plane of its own.
            for plane in (plane for pair in self._planes for plane in pair):
                remove_plane(actor.mapper, plane)
            if hasattr(actor.prop, "culling") and not _is_cut(actor):
                actor.prop.culling = "back"
        kept = [actor for actor in self._actors if actor not in gone]
        self._actors = list(actors)
        if not self.is_on:
            return
        for actor in actors:
            if actor not in kept:
                for plane in (plane for pair in self._planes for plane in pair):
                    actor.mapper.AddClippingPlane(plane)
                if hasattr(actor.prop, "culling"):
                    # One looks into the open body: its inside is to be seen.
                    actor.prop.culling = "none"

    def switch(self, on: bool) -> None:
        """Begin or end to cut."""
        self.is_on = on
        actors, self._actors = self._actors, [] if on else self._actors
        self.cut(actors)
        if on and self._frame is None:
            self._draw()
        for actor in (self._frame, self._handles):
            if actor is not None:
                actor.SetVisibility(on)
        self._place()

    def reset(self) -> None:
        """Put all faces back to the ends."""
        self.shares = np.tile([0.0, 1.0], (3, 1))
        self._place()

    def set_share(self, axis: int, low: float, high: float) -> None:
        """Put the two faces across an axis (0, 1, 2) to shares between 0 and 1, in either order."""
        low, high = sorted((float(np.clip(low, 0, 1)), float(np.clip(high, 0, 1))))
        if high - low < LEAST:
            low = min(low, 1 - LEAST)
            high = low + LEAST
        self.shares[axis] = low, high
        self._place()

    @property
    def bounds(self) -> Float[np.ndarray, "3 2"]:
        """Where the faces stand, in the scene's coordinates."""
        return np.asarray(self._low[:, None] + self.shares * (self._high - self._low)[:, None])

    def recolour(self, theme: SceneTheme) -> None:
        """Take the colours of another theme."""
        self._theme = theme
        if self._frame is not None and self._handles is not None:
            self._frame.prop.color = self._handles.prop.color = theme.avatar

    def remove(self) -> None:
        """Cut nothing any more, and leave the plotter."""
        self.is_on = False
        self.changed = lambda: None
        self.cut([])
        for actor in (self._frame, self._handles):
            if actor is not None:
                self._plotter.remove_actor(actor, reset_camera=False, render=False)
        self._frame = self._handles = None

    def _draw(self) -> None:
        look = {"pickable": False, "reset_camera": False, "render": False, "lighting": False}
        self._frame = self._plotter.add_mesh(
            pv.Box().extract_all_edges(), color=self._theme.avatar, line_width=1.5, name="clip box", **look
        )
        self._handles = self._plotter.add_mesh(
            pv.PolyData(np.zeros((6, 3), np.float32)), color=self._theme.avatar, style="points",
            point_size=11 * self.pixel_ratio, render_points_as_spheres=True, name="clip handles", **look,
        )  # fmt: skip

    def _place(self) -> None:
        bounds = self.bounds
        for axis, (lower, upper) in enumerate(self._planes):
            for plane, place, side in ((lower, bounds[axis, 0], 1.0), (upper, bounds[axis, 1], -1.0)):
                plane.SetOrigin(*(place * np.eye(3)[axis]))
                plane.SetNormal(*(side * np.eye(3)[axis]))
        if self._frame is not None and self._handles is not None:
            self._frame.mapper.dataset = pv.Box(bounds=bounds.ravel().tolist()).extract_all_edges()
            self._handles.mapper.dataset = pv.PolyData(self._middles().astype(np.float32))

    def _middles(self) -> Float[np.ndarray, "6 3"]:
        """Return the middles of the faces: low x, high x, low y ..."""
        bounds = self.bounds
        result = np.tile(bounds.mean(axis=1), (6, 1))
        for axis in range(3):
            result[2 * axis : 2 * axis + 2, axis] = bounds[axis]
        return result

    # ---- dragging --------------------------------------------------------------------------------

    def over(self, x: float, y: float) -> int | None:
        """Return the number of the face whose middle lies under a pixel, or None."""
        if not self.is_on:
            return None
        seen = to_display(self._plotter.renderer, self._middles())
        away = np.linalg.norm(seen - [x, y], axis=1)
        nearest = int(np.argmin(away))
        return nearest if away[nearest] <= REACH * self.pixel_ratio else None

    def grab(self, x: float, y: float) -> bool:
        """Take hold of the face whose middle lies under a pixel; return whether there is one."""
        face = self.over(x, y)
        if face is None:
            return False
        self._held = face // 2, face % 2, float(self.shares[face // 2, face % 2]), np.array([x, y])
        return True

    def drag(self, x: float, y: float) -> None:
        """Move the face along its axis with the mouse."""
        if self._held is None:
            return
        axis, end, share, start = self._held
        place = self._middles()[2 * axis + end]
        length = length_of_drag(self._plotter.renderer, place, np.eye(3)[axis], np.array([x, y]) - start)
        wanted = share + length / float(self._high[axis] - self._low[axis])
        other = float(self.shares[axis, 1 - end])
        if end == 0:
            self.set_share(axis, min(wanted, other - LEAST), other)
        else:
            self.set_share(axis, other, max(wanted, other + LEAST))
        self.changed()

    def drop(self) -> None:
        """Let go."""
        self._held = None
