"""Keeps the 3-D view in step with the work: what is shown at which station, and from where."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PySide6.QtCore import QEvent, QObject, QSize, Signal

from mbstudio.core.grains import GrainSet
from mbstudio.scene import Scene, View, camera
from mbstudio.scene.layers.slices import AXES, Axis
from mbstudio.scene.tray_camera import TrayCamera
from mbstudio.ui.deferred_calls import DeferredCalls
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.display import Display
from mbstudio.ui.view.live_avatar import LiveAvatar
from mbstudio.ui.view.pane_trail import Brush
from mbstudio.ui.view.slice_tool import SliceTool
from mbstudio.ui.view.view_surfaces import ViewSurfaces

SOLID_WINDOW = (0.0, 1.6)
"""Grey values shown black and white in slices of voxels: grains are light grey, their outlines coloured."""
SEEN_THROUGH: tuple[str, ...] = ("grain", "avatar")
"""Layers that a station can make transparent."""


class SceneView(QObject):
    """Shows the workspace's scan, grains and avatars in a scene.

    Parameters
    ----------
    studio : Studio

    Attributes
    ----------
    display : Display
        What the open station shows.
    factors_ready : signal (ShapeFactors or None, ShapeFactors or None)
        Factors of the chosen grain and its avatar.
    entered : signal
        Another station's layers are shown.
    drawn : signal
        The scene was changed and will be rendered.
    slices_changed : signal
        Slices were moved, shown otherwise, or are those of another scan.
    avatar_moved : signal (int, LiveAvatar)
        The avatar of a grain that is being fitted, as it stands.
    arranged : signal
        Other layers are shown than before, or other things in them.
    part_changed : signal
        Another part of the scan is marked, or none.
    part_dragged : signal (dict of Axis to tuple of int)
        The part is to reach from and up to these voxels.
    part : dict of Axis to tuple of int, or None
        The part of the scan that is marked in slices and view, in voxels, half open.
    slice_tool : SliceTool or None
        What takes the left button in the flat slices; None to move the lines.
    brush : Brush or None
        What that draws with in the flat slices while the button is held.
    marks : tuple of (z, y, x)
        Voxels that the flat slices mark.
    fitted : signal
        All that is shown was brought into the picture.
    shows_suspicion : bool
        Whether the overview is coloured by how suspicious grains are.
    tints : dict of Axis to uint8 array, shape (h, w, 4)
        What lies over the flat slices.
    tinted : signal
        Something else lies over them.
    picking : bool
        Whether a click chooses what lies under it; a tool that takes clicks itself switches it off.
    """

    factors_ready = Signal(object, object)
    entered = Signal()
    drawn = Signal()
    slices_changed = Signal()
    avatar_moved = Signal(int, object)
    arranged = Signal()
    part_changed = Signal()
    part_dragged = Signal(object)
    fitted = Signal()
    tinted = Signal()

    def __init__(self, studio: Studio) -> None:
        super().__init__(studio)
        workspace, viewport, theme = studio.workspace, studio.viewport, studio.theme
        self.workspace, self.viewport, self.theme = workspace, viewport, theme
        self.scene = Scene(viewport.plotter, theme.scene)
        self.surfaces = ViewSurfaces(workspace, studio.queue, self.scene, viewport.kind, self)
        self.display = Display(workspace)
        self._displays = [self.display]
        self.picking = True
        self.part: dict[Axis, tuple[int, int]] | None = None
        self.slice_tool: SliceTool | None = None
        self.brush: Brush | None = None
        self.marks: tuple[tuple[int, int, int], ...] = ()
        self.tints: Mapping[Axis, UInt8[np.ndarray, "h w 4"]] = {}
        self._focus: object = None
        self._sliced: object = None
        self._placed: tuple[Any, ...] | None = None
        self._deferred = DeferredCalls(self)
        self._tray = TrayCamera(self.scene)
        self.surfaces.factors_ready.connect(self.factors_ready)
        self.surfaces.taken.connect(self.arrange)
        workspace.scan_changed.connect(self._scan_changed)
        workspace.grains_changed.connect(self._grains_changed)
        workspace.selection_changed.connect(self._selection_changed)
        workspace.fits_changed.connect(self._fits_changed)
        self._offers = studio.offers
        self.shows_suspicion = False
        studio.offers.suspects_changed.connect(self._show_suspicion)
        theme.changed.connect(self._theme_changed)
        viewport.scaled.connect(self.scene.set_pixel_ratio)
        viewport.moving.connect(self._camera_moving)
        viewport.installEventFilter(self)

    # ---- what the window asks ------------------------------------------------------------------

    def enter(self, display: Display) -> None:
        """Show what belongs to a station."""
        self.display = display
        if display not in self._displays:
            self._displays.append(display)
        if "avatars" in display.kept_built:
            self.surfaces.build_avatars()
        self.arrange()
        self.entered.emit()

    @property
    def has_content(self) -> bool:
        """Whether there is something in the view at this station."""
        return self.display.has_content

    def offers(self, layer: str) -> bool:
        """Return whether a layer can be switched at this station."""
        return self.display.offers(layer)

    def is_shown(self, layer: str) -> bool:
        """Return whether a layer is switched on at this station."""
        return self.display.is_shown(layer)

    def show_layer(self, layer: str, shown: bool) -> None:
        """Switch a layer on or off at this station."""
        self.display.switch(layer, shown)
        if layer == "volume" and shown:
            self.surfaces.build_volume()
        if layer == "avatars" and shown:
            self.surfaces.build_avatars()
        if layer == "deviation" and shown:
            self.surfaces.build_deviation()
        self.arrange()

    def fit_view(self) -> None:
        """Bring all that is shown into the picture."""
        self.scene.fit()
        self.fitted.emit()
        self.draw()

    def frame(self, points: Float[np.ndarray, "m 3"], room: float = 1.0) -> None:
        """Bring points (x, y, z) into the picture, with `room` times their size around them."""
        self.scene.frame(points, room)
        self.draw()

    def centre(self, point: Float[np.ndarray, "3"]) -> None:
        """Move a point (x, y, z) into the middle of the picture."""
        self.scene.centre(point)
        self.draw()

    def look_from(self, view: View) -> None:
        """Turn to a preset view."""
        self.scene.look_from(view)
        self.draw()

    def colour_by_suspicion(self, on: bool) -> None:
        """Colour the grains of the overview by how suspicious they are, or each by its own colour."""
        self.shows_suspicion = on
        self._show_suspicion()

    def _show_suspicion(self) -> None:
        grains = self.workspace.state.grains
        if self.shows_suspicion and grains is not None:
            accepted = grains.accepted_labels
            scores = {
                label: 0.0 if label in accepted else one.score for label, one in self._offers.suspects.items()
            }
        elif self.scene.layers.grains.scores is None:
            return
        else:
            scores = None
        self.scene.layers.grains.set_scores(scores)
        self.draw()

    def set_opacity(self, layer: str, opacity: float) -> None:
        """Change how far one sees through the grain or the avatar at this station."""
        self.display.opacity[layer] = opacity
        self.arrange()

    def show_live_avatar(self, label: int, live: LiveAvatar) -> None:
        """Show the avatar of a grain that is being fitted, as it stands."""
        self.avatar_moved.emit(label, live)
        if label != self.workspace.selected:
            return
        self.scene.layers.avatar.set(live.surface)
        self.scene.layers.points.set(live.points)
        if self.scene.layers.deviation.holds_something:
            self.surfaces.clear_deviation()
            self.arrange()
        self.draw()

    def take_unit(self) -> None:
        """Give the scene the unit of the grains, or of the scan."""
        grains, scan = self.workspace.state.grains, self.workspace.scan
        if grains is not None:
            self.scene.set_unit(grains.unit)
        elif scan is not None:
            self.scene.set_unit(scan.unit)

    def move_slice(self, axis: Any, index: int) -> None:
        """Cut the scan elsewhere."""
        slices = self.scene.layers.slices.planes
        if slices is not None and slices.index[axis] != index:
            slices.move(axis, index)
            self._slices_moved()

    def move_slices(self, places: Mapping[Axis, int]) -> None:
        """Cut the scan elsewhere across several axes."""
        slices = self.scene.layers.slices.planes
        moved = {} if slices is None else {a: i for a, i in places.items() if slices.index[a] != i}
        if slices is not None and moved:
            for axis, index in moved.items():
                slices.move(axis, index)
            self._slices_moved()

    def switch_slice(self, axis: Any, shown: bool) -> None:
        """Show or hide one slice."""
        slices = self.scene.layers.slices.planes
        if slices is not None:
            slices.show(axis, shown)
            self._slices_moved()

    def set_window(self, low: float, high: float) -> None:
        """Change the grey values shown black and white."""
        slices = self.scene.layers.slices.planes
        if slices is not None and slices.window != (low, high):
            self.scene.set_window(low, high)
            self._slices_moved()

    def mark_part(self, part: dict[Axis, tuple[int, int]] | None) -> None:
        """Mark a part of the scan in slices and view, or none."""
        scan = self.workspace.scan
        self.part = part if scan is not None else None
        bounds = None
        if self.part is not None and scan is not None:
            ends = np.array([self.part[axis] for axis in AXES], float)
            edges = np.array(scan.voxel_size.xyz)[:, None]
            bounds = np.array(scan.origin)[:, None] + (ends - 0.5) * edges
        self.scene.layers.part_box.set(bounds)
        self.part_changed.emit()
        self.draw()

    def close(self) -> None:
        """Let go of the scene."""
        self.viewport.grips.clear()
        self.scene.close()

    # ---- what happens --------------------------------------------------------------------------

    def _slices_moved(self) -> None:
        self.slices_changed.emit()
        self.draw()

    def _scan_changed(self) -> None:
        self._cut_slices()
        self._outline_grains()
        self._cut_through(self.workspace.selected or self._middle_grain())
        self._focus = None
        self.arrange(self._first_view())

    def _first_view(self) -> View:
        """Return from where to look at what is new: bodies of several files are read like a page."""
        grains = self.workspace.state.grains
        side_by_side = self.workspace.slices_voxels and grains is not None and grains.is_of_meshes
        return "top" if side_by_side and grains is not None and len(grains) > 1 else "isometric"

    def _cut_slices(self) -> None:
        """Cut the slices through the scan, or through the voxels of grains without one."""
        scan = self._sliced = self.workspace.sliced
        self.scene.set_scan(scan)
        if self.workspace.slices_voxels:
            self.scene.set_window(*SOLID_WINDOW)
        if scan is not None and self.is_shown("volume"):
            self.surfaces.build_volume()

    def _grains_changed(self) -> None:
        view: View | None = None
        if self.workspace.sliced is not self._sliced:
            self._cut_slices()
            view = self._first_view()
        self.surfaces.build_grains()
        self.surfaces.build_others()
        self._outline_grains()
        if view is not None:
            self._cut_through(self.workspace.selected or self._middle_grain())
        self.surfaces.build_chosen()
        self.arrange(view)

    def _middle_grain(self) -> int | None:
        """Return the grain nearest to the middle of all."""
        grains = self.workspace.state.grains
        if grains is None or not len(grains):
            return None
        away = grains.table[["x", "y", "z"]].to_numpy()
        middle = (away.min(axis=0) + away.max(axis=0)) / 2
        return int(grains.table["label"].iloc[int(((away - middle) ** 2).sum(axis=1).argmin())])

    def _outline_grains(self) -> None:
        grains, scan = self.workspace.state.grains, self.workspace.sliced
        slices = self.scene.layers.slices.planes
        if slices is not None and scan is not None:
            self.outline(grains if grains is not None and grains.label_volume.shape == scan.shape else None)

    def outline(self, grains: GrainSet | None) -> None:
        """Outline grains in the slices: those of the project, or what they would become."""
        slices = self.scene.layers.slices.planes
        if slices is not None:
            volume = None if grains is None else grains.label_volume
            slices.set_labels(volume, 0 if grains is None else grains.last_label)
        self.slices_changed.emit()

    def tint(self, tints: Mapping[Axis, UInt8[np.ndarray, "h w 4"]]) -> None:
        """Lay pictures (red, green, blue, alpha) over the flat slices, one a slice; none for the others."""
        if tints or self.tints:
            self.tints = tints
            self.tinted.emit()

    def mark_voxels(self, marks: Iterable[tuple[int, int, int]]) -> None:
        """Mark voxels in the flat slices."""
        self.marks = tuple(marks)
        self.slices_changed.emit()

    def _cut_through(self, label: int | None) -> None:
        """Cut slices through voxels, where there is no scan, through the middle of a grain."""
        grains, slices = self.workspace.state.grains, self.scene.layers.slices.planes
        if not self.workspace.slices_voxels or grains is None or slices is None or label is None:
            return
        rows = grains.table.loc[grains.table["label"] == label]
        if len(rows):  # else of the grains before
            row = rows.iloc[0]
            for axis in AXES:
                slices.move(axis, int(row[f"{axis}0"] + row[f"{axis}1"]) // 2)
            self.slices_changed.emit()

    def _selection_changed(self) -> None:
        self.scene.select(self.workspace.selected, self.workspace.chosen)
        self.surfaces.build_others()
        self._build_chosen()
        self.arrange()

    def _fits_changed(self) -> None:
        self._build_chosen()
        if "avatars" in self.display.kept_built or self.is_shown("avatars"):
            self.surfaces.build_avatars()

    def _build_chosen(self) -> None:
        self.surfaces.build_chosen()
        if any(display.is_shown("deviation") for display in self._displays):
            self.surfaces.build_deviation()

    def _camera_moving(self, moving: bool) -> None:
        if self.scene.layers.volume.holds_something:
            self.scene.set_moving(moving)
            self.viewport.request_render()

    def _theme_changed(self) -> None:
        self.scene.set_theme(self.theme.scene)
        self.draw()

    @property
    def room(self) -> QSize:
        """Size of the place where the view is, or will be once there is something in it."""
        if self.viewport.isVisible():
            return self.viewport.size()
        place = self.viewport.parentWidget()
        pages = place.parentWidget() if place is not None else None
        return (pages or place or self.viewport).size()

    @property
    def shows_tray(self) -> bool:
        """Whether clones are looked at, if there are any."""
        return self.display.shows_tray

    def refit_tray(self) -> None:
        """Fit the clones into a view that has another size now."""
        if self._tray.refit():
            self.draw()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize and self.workspace.slices_voxels:
            # Once the view has taken its new size.
            self._deferred.call(self._refit)
        return super().eventFilter(watched, event)

    def _refit(self) -> None:
        """Fit stones that lie side by side into a view of another size, if nobody has turned it."""
        renderer = self.scene.plotter.renderer
        if self.workspace.slices_voxels and camera.pose(renderer) == self._placed:
            self.scene.fit()
            self._placed = camera.pose(renderer)
            self.draw()

    # ---- arranging -------------------------------------------------------------------------------

    def arrange(self, view: View | None = None) -> None:
        """Show the layers of the station; where they are empty, what comes before them."""
        display = self.display
        looked_at = display.looked_at
        tray = display.shows_tray and self.scene.layers.tray.holds_something and looked_at is None
        layers = display.layers_now(tray)
        if "deviation" in layers and not self.scene.layers.deviation.holds_something:
            # Before it is built, while the search runs, and for a grain that has no avatar yet.
            layers |= {"avatar", "grain"}
        for layer in SEEN_THROUGH:
            self.scene.layers[layer].set_opacity(display.opacity.get(layer, 1.0))
        self.scene.show_layers(layers | {"tray"} if tray else layers)
        focus = (looked_at, display.own_space, self.scene.points() is not None)
        at_tray = self._tray.look_at_tray(tray, view is not None)
        if not at_tray and (focus != self._focus or view is not None):
            # The camera moves when what is looked at changes, never while it is looked at.
            self._focus = focus
            if view is not None:
                self.scene.look_from(view)
            else:
                self.scene.fit()
            self._placed = camera.pose(self.scene.plotter.renderer)
        self.arranged.emit()
        self.draw()

    def draw(self) -> None:
        """Render once the event loop is free."""
        self.viewport.request_render()
        self.drawn.emit()
