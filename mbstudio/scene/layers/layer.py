"""A layer: one thing that a scene can show, and all that a scene asks of it.

A new layer is a subclass of :class:`Layer` in a module of its own, and a line in
:class:`~mbstudio.scene.layers.registry.Layers`. The scene fits the camera to it, clips, picks, recolours
and closes it, and the window offers a switch for it if it has a title.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import pyvista as pv
from jaxtyping import Float

from mbstudio.scene.layers.picking import surface_under
from mbstudio.scene.theme import SceneTheme

Content = TypeVar("Content")

MOST_POINTS = 20_000
"""So many points (or a few more) of a surface are asked whether they are in the picture."""


@dataclass(frozen=True, eq=False)
class Hit:
    """What lies under a pixel.

    Attributes
    ----------
    layer : str
        Name of the layer.
    point : float array, shape (3,)
        Place (x, y, z) in the scene's unit.
    label : int or None
        Of the body that was hit, where the layer shows many.
    """

    layer: str
    point: Float[np.ndarray, "3"]
    label: int | None = None


class Stage:
    """What all layers of a scene share.

    Parameters
    ----------
    plotter : pyvista.BasePlotter
    theme : SceneTheme
    unit : str
        Canonical unit of the coordinates.

    Attributes
    ----------
    renderer : vtkRenderer
        That was the plotter's when the scene was made.
    chosen : frozenset of int
        Labels of the grains that are brought out.
    isolated : bool
        Whether those alone are shown, if there are any.
    grey_window : tuple of float, or None
        Grey values of the scan shown black and white; None without a scan.
    update : callable
        Brings the scene in step with a layer that has changed.
    """

    def __init__(self, plotter: Any, theme: SceneTheme, unit: str) -> None:
        self.plotter = plotter
        self.renderer: Any = plotter.renderer
        self.theme = theme
        self.unit = unit
        self.chosen: frozenset[int] = frozenset()
        self.isolated = False
        self.grey_window: tuple[float, float] | None = None
        self.update: Callable[[], object] = lambda: None

    @property
    def shows_chosen_alone(self) -> bool:
        """Whether grains are chosen, and all others hidden."""
        return self.isolated and bool(self.chosen)

    def set_unit(self, unit: str | None) -> None:
        """Take another unit of the coordinates; None leaves it."""
        if unit is not None:
            self.unit = unit

    def remove(self, actor: Any) -> None:
        """Take an actor out of the plotter."""
        self.plotter.remove_actor(actor, reset_camera=False, render=False)


class Layer(ABC, Generic[Content]):
    """One thing that a scene can show.

    Parameters
    ----------
    name : str
        Under which the scene knows it.
    stage : Stage

    Attributes
    ----------
    title, icon, tip : str
        Of its switch in the window; without a title it has none.
    starts_shown : bool
        Whether what is set is to be seen before anybody says so.
    starts_opaque : float
        Opacity before anybody changes it.
    is_switched_alone : bool
        Whether it is left as it is where a scene shows exactly some layers.
    is_drawn_last : bool
        Whether one sees other layers through it: those must be drawn before it.
    is_clipped : bool
        Whether the clipping box cuts it.
    has_outline : bool
        Whether the outline of the scan is shown with it.
    is_within_scan : bool
        Whether it lies inside that outline, which then spans it when the camera is fitted.
    picks_grains : bool
        Whether the labels of what is hit are those of grains.
    shows_one_grain : bool
        Whether a click on it may mean a grain all the same: that which is looked at, or one that is cut.
    is_shown : bool
        Whether it is switched on; it may hold nothing yet.
    opacity : float
        0 not to be seen, 1 solid.
    """

    title: ClassVar[str] = ""
    icon: ClassVar[str] = ""
    tip: ClassVar[str] = ""
    starts_shown: ClassVar[bool] = True
    starts_opaque: ClassVar[float] = 1.0
    is_switched_alone: ClassVar[bool] = False
    is_drawn_last: ClassVar[bool] = False
    is_clipped: ClassVar[bool] = True
    has_outline: ClassVar[bool] = False
    is_within_scan: ClassVar[bool] = False
    picks_grains: ClassVar[bool] = False
    shows_one_grain: ClassVar[bool] = False

    def __init__(self, name: str, stage: Stage) -> None:
        self.name, self.stage = name, stage
        self.is_shown = self.starts_shown
        self.opacity = self.starts_opaque

    # ---- what it shows ---------------------------------------------------------------------------

    @abstractmethod
    def set(self, content: Content | None, unit: str | None = None) -> None:
        """Show something else, or nothing.

        Parameters
        ----------
        content : object, optional
            None takes away what is there.
        unit : str, optional
            Canonical unit of its coordinates; by default that which the scene has.
        """

    @property
    @abstractmethod
    def actors(self) -> Sequence[Any]:
        """What the plotter draws of it; empty if it holds nothing."""

    @property
    def holds_something(self) -> bool:
        """Whether there is something to show."""
        return bool(self.actors)

    # ---- how it is shown -------------------------------------------------------------------------

    @property
    def is_visible(self) -> bool:
        """Whether what it holds is to be seen."""
        return self.is_shown and self.opacity > 0.001

    def show(self, on: bool) -> None:
        """Show or hide it."""
        self.is_shown = on
        self.stage.update()

    def set_opacity(self, opacity: float) -> None:
        """Make it see-through: 0 not to be seen, 1 solid."""
        self.opacity = float(opacity)
        for actor in self.actors:
            actor.GetProperty().SetOpacity(self.opacity)
        self.stage.update()

    def refresh(self) -> None:
        """Have the plotter draw it, or not, as things stand."""
        for actor in self.actors:
            actor.SetVisibility(self.is_visible)

    def recolour(self, theme: SceneTheme) -> None:
        """Take the colours of another theme."""

    def choose(self, labels: frozenset[int]) -> None:
        """Bring out these grains."""

    def set_moving(self, moving: bool) -> None:
        """Take note that the camera is being turned by hand, or no longer: what is slow is drawn coarser."""

    def set_pixel_ratio(self, ratio: float) -> None:
        """Take note how many pixels of the picture one of the screen's units is, for text and lines."""

    # ---- where it is -----------------------------------------------------------------------------

    def points(self) -> Float[np.ndarray, "m 3"] | None:
        """Return points that span what it holds, for fitting the camera; None if it holds nothing."""
        found = []
        for actor in self.actors:
            # Before the first rendering a mapper may answer with an empty mesh.
            actor.mapper.Update()
            found.append(sample_points(actor.mapper.dataset))
        return np.concatenate(found) if found else None

    def pick(self, x: float, y: float) -> Hit | None:
        """Return what of it lies under a pixel (from the lower left), or None."""
        surfaces = [actor for actor in self.actors if isinstance(actor, pv.Actor) and actor.GetVisibility()]
        found = surface_under(self.stage.renderer, surfaces, x, y)
        return None if found is None else Hit(self.name, *found)

    def close(self) -> None:
        """Take everything out of the plotter."""
        self.set(None)


def sample_points(mesh: Any) -> Float[np.ndarray, "m 3"]:
    """Return points of a mesh that span it, 20,000 or a few more at most."""
    points = np.asarray(mesh.points)
    return points[:: max(1, len(points) // MOST_POINTS)]
