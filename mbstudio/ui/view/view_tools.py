"""Tools of the 3-D view: measuring by clicks, and the clipping box."""

from __future__ import annotations

from PySide6.QtCore import QObject

from mbstudio.scene.tools.measurements import POINTS, Kind
from mbstudio.ui.language import mark, tr
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.clip_bar import ClipBar
from mbstudio.ui.view.scene_view import SceneView

_HINTS = {
    "distance": mark("Measure a distance: click two points of a surface or slice. Press Esc to stop."),
    "angle": mark("Measure an angle: click a point, the vertex and a third point. Press Esc to stop."),
}
_MEASURED = {"distance": mark("Distance {value}."), "angle": mark("Angle {value}.")}


class ViewTools(QObject):
    """Measuring and clipping.

    Parameters
    ----------
    studio : Studio
    view : SceneView

    Attributes
    ----------
    measuring : {'distance', 'angle'} or None
        What the next clicks are for.
    """

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio)
        self._studio, self._view, self._scene = studio, view, view.scene
        self.measuring: Kind | None = None
        self.bar = ClipBar(studio.icons)
        self.bar.hide()
        self.bar.moved.connect(self._clip_moved)
        self.bar.reset.connect(self.reset_clip)
        self.bar.closed.connect(lambda: self.clip(False))
        self._scene.clip.changed = self._clip_dragged
        studio.viewport.grips.append(self._scene.clip)
        studio.viewport.clicked.connect(self._clicked)
        studio.workspace.scan_changed.connect(self.clear)
        studio.workspace.project_replaced.connect(self._leave)

    # ---- measuring -------------------------------------------------------------------------------

    @property
    def holds_measurements(self) -> bool:
        """Whether there is something that Esc would take away."""
        return self.measuring is not None or bool(self._scene.measurements.measured)

    def measure(self, kind: Kind, wanted: bool = True) -> None:
        """Take clicks for distances or angles, or take them no longer."""
        self._scene.measurements.drop_unfinished()
        self.measuring = kind if wanted else None
        self._view.picking = self.measuring is None
        if self.measuring is None:
            self._studio.give_hint("")
        else:
            self._studio.give_hint(tr(_HINTS[kind]))
        self._studio.commands.refresh()
        self._view.draw()

    def clear(self) -> None:
        """Take all measurements away and end measuring."""
        self._scene.measurements.clear()
        self.measure("distance", False)

    def _clicked(self, x: float, y: float) -> None:
        if self.measuring is None or self._scene.layers.side_by_side.is_shown:
            return
        hit = self._scene.pick(x, y)
        if hit is None:
            self._studio.give_hint(tr("There is no surface or slice under the cursor."))
            return
        measurement = self._scene.measurements.add_point(self.measuring, hit.point)
        if measurement.is_complete:
            measured = tr(_MEASURED[self.measuring], value=measurement.format_value(self._scene.unit))
            words = f"{measured} {tr(_HINTS[self.measuring])}"
        else:
            words = tr(
                "Point {point} of {points}. Press Esc to stop.",
                point=len(measurement.points),
                points=POINTS[self.measuring],
            )
        self._studio.give_hint(words)
        self._studio.commands.refresh()
        self._view.draw()

    # ---- clipping --------------------------------------------------------------------------------

    def clip(self, wanted: bool) -> None:
        """Show the clipping box, or put it away and show everything again."""
        points = self._scene.points()
        if wanted and points is not None:
            self._scene.clip.span(points)
        self._scene.clip.switch(wanted and points is not None)
        self._clip_dragged()
        self.bar.setVisible(self._scene.clip.is_on)
        self._studio.commands.refresh()

    def reset_clip(self) -> None:
        """Put all faces back to the ends of what is shown."""
        self._scene.clip.reset()
        points = self._scene.points()
        if points is not None:
            self._scene.clip.span(points)
        self._clip_dragged()

    @property
    def is_clipping(self) -> bool:
        return self._scene.clip.is_on

    def _clip_moved(self, axis: int, low: float, high: float) -> None:
        self._scene.clip.set_share(axis, low, high)
        self._view.draw()

    def _clip_dragged(self) -> None:
        self.bar.show_shares([(float(low), float(high)) for low, high in self._scene.clip.shares])
        self._view.draw()

    def _leave(self) -> None:
        self.clear()
        self.reset_clip()
        self.clip(False)
