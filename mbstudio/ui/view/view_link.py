"""Keeps the 3-D view in step with the work: what is shown at which station, and from where."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtGui import QGuiApplication

from mbstudio.scene import Scene, View
from mbstudio.scene.tray_camera import TrayCamera
from mbstudio.ui.stations.fit.work import FitWork, LiveAvatar
from mbstudio.ui.stations.station_layers import StationLayers
from mbstudio.ui.theme import Theme
from mbstudio.ui.view.view_surfaces import ViewSurfaces
from mbstudio.ui.view.viewport import Viewport
from mbstudio.ui.workers import TaskQueue
from mbstudio.ui.workspace import Workspace


class ViewLink(QObject):
    """Shows the workspace's scan, grains and avatars in a scene.

    Attributes
    ----------
    factors_ready : signal (ShapeFactors or None, ShapeFactors or None)
        Factors of the chosen grain and its avatar.
    drawn : signal
        The scene was changed and will be rendered.
    slices_changed : signal
        Slices were moved, shown otherwise, or are those of another scan.
    arranged : signal
        Other layers are shown than before, or other things in them.
    picking : bool
        Whether a click chooses what lies under it; a tool that takes clicks itself switches it off.
    """

    factors_ready = Signal(object, object)
    drawn = Signal()
    slices_changed = Signal()
    arranged = Signal()

    def __init__(
        self,
        workspace: Workspace,
        fits: FitWork,
        queue: TaskQueue,
        viewport: Viewport,
        theme: Theme,
        parent: QObject,
    ) -> None:
        super().__init__(parent)
        self.workspace, self.viewport, self.theme = workspace, viewport, theme
        self.scene = Scene(viewport.plotter, theme.scene)
        self.surfaces = ViewSurfaces(workspace, fits, queue, self.scene, viewport.kind, self)
        self.station = "scan"
        self.picking = True
        self._layers = StationLayers()
        self._opacity: dict[str, float] = {"grain": 0.6, "avatar": 1.0}
        self._focus: object = None
        self.preview: object = None  # what of an export is looked at, in place of the avatars
        self._tray = TrayCamera(self.scene)
        self.surfaces.factors_ready.connect(self.factors_ready)
        self.surfaces.taken.connect(self.arrange)
        workspace.scan_changed.connect(self._scan_changed)
        workspace.grains_changed.connect(self._grains_changed)
        workspace.selection_changed.connect(self._selection_changed)
        workspace.fits_changed.connect(self._fits_changed)
        fits.avatar_moved.connect(self._avatar_moved)
        theme.changed.connect(self._theme_changed)
        viewport.clicked.connect(self._clicked)
        viewport.scaled.connect(self.scene.set_pixel_ratio)
        viewport.moving.connect(self._camera_moving)

    # ---- what the window asks ------------------------------------------------------------------

    def enter(self, station: str) -> None:
        """Show what belongs to a station."""
        self.station = station
        if station == "export":
            self.surfaces.build_avatars()
        self.arrange()

    def is_shown(self, layer: str) -> bool:
        """Return whether a layer is switched on at this station."""
        return self._layers.is_shown(self.station, layer)

    def show_layer(self, layer: str, shown: bool) -> None:
        """Switch a layer on or off at this station."""
        self._layers.switch(self.station, layer, shown)
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
        self.draw()

    def look_from(self, view: View) -> None:
        """Turn to a preset view."""
        self.scene.look_from(view)
        self.draw()

    def set_opacity(self, layer: str, opacity: float) -> None:
        """Change the opacity of the grain or the avatar at station Fit."""
        self._opacity[layer] = opacity
        self.arrange()

    def move_slice(self, axis: Any, index: int) -> None:
        """Cut the scan elsewhere."""
        slices = self.scene.layers.slices.planes
        if slices is not None and slices.index[axis] != index:
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

    def close(self) -> None:
        """Let go of the scene."""
        self.viewport.grips.clear()
        self.scene.close()

    # ---- what happens --------------------------------------------------------------------------

    def _slices_moved(self) -> None:
        self.slices_changed.emit()
        self.draw()

    def _scan_changed(self) -> None:
        scan = self.workspace.scan
        self.scene.set_scan(scan)
        if scan is not None and self.is_shown("volume"):
            self.surfaces.build_volume()
        self._outline_grains()
        self._focus = None
        self.arrange(view="isometric")

    def _grains_changed(self) -> None:
        self.surfaces.build_grains()
        self._outline_grains()
        self.surfaces.build_chosen()
        self.arrange()

    def _outline_grains(self) -> None:
        grains, scan = self.workspace.state.grains, self.workspace.scan
        slices = self.scene.layers.slices.planes
        if slices is not None and scan is not None:
            fitting = grains is not None and grains.labels.shape == scan.shape
            slices.set_labels(grains.labels if grains is not None and fitting else None)
        self.slices_changed.emit()

    def _selection_changed(self) -> None:
        self.scene.select(self.workspace.selected, self.workspace.chosen)
        self.surfaces.build_others()
        self._build_chosen()
        self.arrange()

    def _fits_changed(self) -> None:
        self._build_chosen()
        if self.station == "export" or self.is_shown("avatars"):
            self.surfaces.build_avatars()

    def _build_chosen(self) -> None:
        self.surfaces.build_chosen()
        if self._layers.is_shown("fit", "deviation"):
            self.surfaces.build_deviation()

    def _avatar_moved(self, label: int, live: LiveAvatar) -> None:
        if label != self.workspace.selected:
            return
        self.scene.layers.avatar.set(live.surface)
        self.scene.layers.points.set(live.points)
        if self.scene.layers.deviation.holds_something:
            self.surfaces.clear_deviation()
            self.arrange()
        self.draw()

    def _camera_moving(self, moving: bool) -> None:
        if self.scene.layers.volume.holds_something:
            self.scene.set_moving(moving)
            self.viewport.request_render()

    def _theme_changed(self) -> None:
        self.scene.set_theme(self.theme.scene)
        self.draw()

    def _clicked(self, x: float, y: float) -> None:
        layers = self.scene.layers
        if self.picking and (layers.grains.is_shown or layers.avatars.is_shown):
            label = self.scene.label_at(x, y)
            adding = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
            if not QGuiApplication.keyboardModifiers() & adding:
                self.workspace.select(label)
            elif label is not None:
                self.workspace.toggle([label])

    @property
    def shows_tray(self) -> bool:
        """Whether clones are looked at: at station Style, and if there is nothing else."""
        bare = self.workspace.state.grains is None and self.workspace.scan is None
        return self.station == "style" or (bare and self.station != "latent")

    def refit_tray(self) -> None:
        """Fit the clones into a view that has another size now."""
        if self._tray.refit():
            self.draw()

    # ---- arranging -------------------------------------------------------------------------------

    def arrange(self, view: View | None = None) -> None:
        """Show the layers of the station; where they are empty, what comes before them."""
        state, layers = self.workspace.state, self._layers.shown(self.station)
        whole: set[str] = {"grains"} if state.grains is not None else {"slices"}
        previewing = self.station == "export" and self.preview is not None
        tray = self.shows_tray and self.scene.layers.tray.holds_something and not previewing
        if self.station == "style" and not tray:
            layers = set(whole)
        elif self.station in ("grains", "populations") and state.grains is None:
            layers |= {"slices"}
        elif (self.station == "fit" and self.workspace.selected is None) or (
            self.station == "export" and not state.fits
        ):
            layers = whole
        if "deviation" in layers and not self.scene.layers.deviation.holds_something:
            # Before it is built, while the search runs, and for a grain that has no avatar yet.
            layers |= {"avatar", "grain"}
        if previewing:
            layers = self._layers.shown("export") & {"shape", "envelope"}
        elif self.station == "export":
            layers -= {"shape", "envelope"}
        overview = self.station in ("grains", "populations") or (self.station == "style" and not tray)
        if overview and self.workspace.selected is not None and "grains" in layers:
            layers |= {"grain"}
        for layer, opacity in self._opacity.items():
            self.scene.layers[layer].set_opacity(opacity if self.station == "fit" else 1.0)
        self.scene.show_layers(layers | {"tray"} if tray else layers)
        single = self.station == "fit" and self.workspace.selected is not None
        latent = self.station == "latent"
        looked_at = self.preview if previewing else self.workspace.selected if single else None
        focus = (looked_at, latent, self.scene.points() is not None)
        at_tray = self._tray.look_at_tray(tray, view is not None)
        if not at_tray and (focus != self._focus or view is not None):
            # The camera moves when what is looked at changes, never while it is looked at.
            self._focus = focus
            if view is not None:
                self.scene.look_from(view)
            else:
                self.scene.fit()
        self.arranged.emit()
        self.draw()

    def draw(self) -> None:
        """Render once the event loop is free."""
        self.viewport.request_render()
        self.drawn.emit()
