"""Keeps the 3-D view in step with the work: builds surfaces in a thread, puts them into the scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtGui import QGuiApplication

from mbstudio.core.imaging import FitResult
from mbstudio.core.metrics import ShapeFactors, measure
from mbstudio.scene import Layer, Scene, View
from mbstudio.scene.gallery import TrayCamera
from mbstudio.scene.surfaces import (
    Surface,
    avatar_surface,
    avatars_surface,
    control_points,
    grain_surface,
    label_surface,
)
from mbstudio.scene.volume import volume_voxels
from mbstudio.ui.station_layers import FIRST_LAYERS, STATION_LAYERS
from mbstudio.ui.theme import Theme
from mbstudio.ui.viewport import Viewport
from mbstudio.ui.work.fit_work import FitWork, LiveAvatar
from mbstudio.ui.workers import Task, TaskQueue
from mbstudio.ui.workspace import Workspace

# Longest side in voxels of overview and volume: what software renders in a fraction of a second.
DETAIL = {"OpenGL": (320, 384), "software": (140, 160)}


__all__ = ["STATION_LAYERS", "ViewLink"]


@dataclass(frozen=True, eq=False)
class _Chosen:
    """What a worker makes of the chosen grain."""

    grain: Surface
    avatar: Surface | None
    points: Surface | None
    grain_factors: ShapeFactors
    avatar_factors: ShapeFactors | None


class ViewLink(QObject):
    """Shows the workspace's scan, grains and avatars in a scene.

    Attributes
    ----------
    factors_ready : signal (ShapeFactors or None, ShapeFactors or None)
        Factors of the chosen grain and its avatar.
    drawn : signal
        The scene was changed and will be rendered.
    """

    factors_ready = Signal(object, object)
    drawn = Signal()

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
        self.workspace, self.queue, self.viewport, self.theme = workspace, queue, viewport, theme
        self.scene = Scene(viewport.plotter, theme.scene)
        self.station = "scan"
        self._fits = fits
        self._layers: dict[str, set[Layer]] = {name: set(shown) for name, shown in FIRST_LAYERS.items()}
        self._factors: dict[int, ShapeFactors] = {}
        self._opacity: dict[Layer, float] = {"grain": 0.6, "avatar": 1.0}
        self._focus: object = None
        self.preview: object = None  # what of an export is looked at, in place of the avatars
        self._tray = TrayCamera(self.scene)
        self._shown_grain: int | None = None
        workspace.scan_changed.connect(self._scan_changed)
        workspace.grains_changed.connect(self._grains_changed)
        workspace.selection_changed.connect(self._selection_changed)
        workspace.fits_changed.connect(self._fits_changed)
        fits.avatar_moved.connect(self._avatar_moved)
        theme.changed.connect(self._theme_changed)
        viewport.clicked.connect(self._clicked)

    # ---- what the window asks ------------------------------------------------------------------

    def enter(self, station: str) -> None:
        """Show what belongs to a station."""
        self.station = station
        if station == "export":
            self._build_avatars()
        self._arrange()

    def is_shown(self, layer: Layer) -> bool:
        """Return whether a layer is switched on at this station."""
        return layer in self._layers[self.station]

    def show_layer(self, layer: Layer, shown: bool) -> None:
        """Switch a layer on or off at this station."""
        layers = self._layers[self.station]
        if shown:
            layers.add(layer)
        else:
            layers.discard(layer)
        if layer == "volume" and shown:
            self._build_volume()
        if layer == "avatars" and shown:
            self._build_avatars()
        self._arrange()

    def arrange(self) -> None:
        """Bring the layers up to date after another part of the window changed the scene."""
        self._arrange()

    def fit_view(self) -> None:
        """Bring all that is shown into the picture."""
        self.scene.fit()
        self._draw()

    def look_from(self, view: View) -> None:
        """Turn to a preset view."""
        self.scene.look_from(view)
        self._draw()

    def set_opacity(self, layer: Layer, opacity: float) -> None:
        """Change the opacity of the grain or the avatar at station Fit."""
        self._opacity[layer] = opacity
        self._arrange()

    def move_slice(self, axis: Any, index: int) -> None:
        """Cut the scan elsewhere."""
        if self.scene.slices is not None:
            self.scene.slices.move(axis, index)
            self._draw()

    def switch_slice(self, axis: Any, shown: bool) -> None:
        """Show or hide one slice."""
        if self.scene.slices is not None:
            self.scene.slices.show(axis, shown)
            self._draw()

    def set_window(self, low: float, high: float) -> None:
        """Change the grey values shown black and white."""
        if self.scene.slices is not None:
            self.scene.slices.set_window(low, high)
            self._draw()

    def close(self) -> None:
        """Let go of the scene."""
        self.scene.close()

    # ---- what happens --------------------------------------------------------------------------

    def _scan_changed(self) -> None:
        scan = self.workspace.scan
        self.scene.set_scan(scan)
        if scan is not None and self.is_shown("volume"):
            self._build_volume()
        self._outline_grains()
        self._focus = None
        self._arrange(view="isometric")

    def _grains_changed(self) -> None:
        grains = self.workspace.state.grains
        self._factors.clear()
        self.scene.set_grains(None)
        self.scene.set_others(None)
        self._outline_grains()
        if grains is not None:
            longest = DETAIL[self.viewport.kind][0]
            self._build(
                "grains",
                lambda: label_surface(grains, longest),
                lambda surface: self.scene.set_grains(surface, grains.unit),
                lambda: grains is self.workspace.state.grains,
            )
        self._build_chosen()
        self._arrange()

    def _outline_grains(self) -> None:
        grains, scan = self.workspace.state.grains, self.workspace.scan
        if self.scene.slices is not None and scan is not None:
            fitting = grains is not None and grains.labels.shape == scan.shape
            self.scene.slices.set_labels(grains.labels if grains is not None and fitting else None)

    def _selection_changed(self) -> None:
        self.scene.select(self.workspace.selected, self.workspace.chosen)
        self._build_others()
        self._build_chosen()
        self._arrange()

    def _fits_changed(self) -> None:
        self._build_chosen()
        if self.station == "export" or self.is_shown("avatars"):
            self._build_avatars()

    def _avatar_moved(self, label: int, live: LiveAvatar) -> None:
        if label != self.workspace.selected:
            return
        self.scene.set_avatar(live.surface)
        self.scene.set_points(live.points)
        self._draw()

    def _theme_changed(self) -> None:
        self.scene.set_theme(self.theme.scene)
        self._draw()

    def _clicked(self, x: float, y: float) -> None:
        if self.scene.is_shown("grains") or self.scene.is_shown("avatars"):
            label = self.scene.label_at(x, y)
            adding = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
            if not QGuiApplication.keyboardModifiers() & adding:
                self.workspace.select(label)
            elif label is not None:
                self.workspace.toggle([label])

    # ---- building in a thread --------------------------------------------------------------------

    def _build(
        self, key: str, make: Callable[[], Any], take: Callable[[Any], object], wanted: Callable[[], bool]
    ) -> None:
        """Make something in the lane ``view`` and put it into the scene if it is still wanted."""

        def done(result: Any) -> None:
            if wanted():
                take(result)
                self._arrange()

        task = Task(f"Drawing {key}", lambda control: make())
        task.succeeded.connect(done)
        self.queue.submit(task, lane="view", key=key)

    def _build_volume(self) -> None:
        scan = self.workspace.scan
        if scan is not None and not self.scene.has_volume:
            longest = DETAIL[self.viewport.kind][1]
            self._build(
                "the volume",
                lambda: volume_voxels(scan, longest),
                self.scene.set_volume,
                lambda: scan is self.workspace.scan,
            )

    def _build_chosen(self) -> None:
        """Build the chosen grain, its avatar and the factors of both."""
        label, state = self.workspace.selected, self.workspace.state
        grains = state.grains
        if label is None or grains is None:
            self._shown_grain = None
            self.scene.set_grain(None)
            self.scene.set_avatar(None)
            self.scene.set_points(None)
            self.factors_ready.emit(None, None)
            return
        if label != self._shown_grain:
            self._shown_grain = label
            for clear in (self.scene.set_grain, self.scene.set_avatar, self.scene.set_points):
                clear(None)
            self.factors_ready.emit(None, None)
        fit = state.fits.get(label)
        known = self._factors.get(label)

        def make() -> _Chosen:
            grain = grains.grain(label)
            return _Chosen(
                grain_surface(grain),
                *_drawn_avatar(fit),
                known or measure(grain),
                _factors_or_none(fit),
            )

        def take(chosen: _Chosen) -> None:
            self._factors[label] = chosen.grain_factors
            self.scene.set_grain(chosen.grain, grains.unit)
            if self._fits.running_label != label:
                self.scene.set_avatar(chosen.avatar)
                self.scene.set_points(chosen.points)
            self.factors_ready.emit(chosen.grain_factors, chosen.avatar_factors)

        self._build(
            "the grain",
            make,
            take,
            lambda: (
                label == self.workspace.selected
                and grains is self.workspace.state.grains
                and fit is self.workspace.state.fits.get(label)
            ),
        )

    def _build_others(self) -> None:
        """Build the grains that are chosen beside the one looked at."""
        grains, space = self.workspace.state.grains, self.workspace
        wanted = space.chosen - {space.selected}
        self.scene.set_others(None)
        if grains is not None and wanted:
            longest = DETAIL[self.viewport.kind][0]
            self._build(
                "chosen grains",
                lambda: label_surface(grains, longest, wanted),
                self.scene.set_others,
                lambda: grains is space.state.grains and wanted == space.chosen - {space.selected},
            )

    def _build_avatars(self) -> None:
        fits, grains = self.workspace.state.fits, self.workspace.state.grains
        if not fits:
            self.scene.set_avatars(None)
            return
        unit = grains.unit if grains is not None else next(iter(fits.values())).avatar.unit
        self._build(
            "the avatars",
            lambda: avatars_surface(
                (fit.avatar for fit in fits.values()),
                40 if len(fits) < 100 else 24 if len(fits) < 500 else 14,
            ),
            lambda surface: self.scene.set_avatars(surface, unit),
            lambda: fits is self.workspace.state.fits,
        )

    @property
    def shows_tray(self) -> bool:
        """Whether clones are looked at: at station Style, and if there is nothing else."""
        bare = self.workspace.state.grains is None and self.workspace.scan is None
        return self.station == "style" or (bare and self.station != "latent")

    def refit_tray(self) -> None:
        """Fit the clones into a view that has another size now."""
        if self._tray.refit():
            self._draw()

    # ---- arranging -------------------------------------------------------------------------------

    def _arrange(self, view: View | None = None) -> None:
        """Show the layers of the station; where they are empty, what comes before them."""
        state, layers = self.workspace.state, set(self._layers[self.station])
        whole: set[Layer] = {"grains"} if state.grains is not None else {"slices"}
        previewing = self.station == "export" and self.preview is not None
        tray = self.shows_tray and self.scene.gallery.holds_something and not previewing
        if self.station == "style" and not tray:
            layers = set(whole)
        elif self.station in ("grains", "populations") and state.grains is None:
            layers |= {"slices"}
        elif (self.station == "fit" and self.workspace.selected is None) or (
            self.station == "export" and not state.fits
        ):
            layers = whole
        if previewing:
            layers = self._layers["export"] & {"shape", "envelope"}
        elif self.station == "export":
            layers -= {"shape", "envelope"}
        overview = self.station in ("grains", "populations") or (self.station == "style" and not tray)
        if overview and self.workspace.selected is not None and "grains" in layers:
            layers |= {"grain"}
        for layer, opacity in self._opacity.items():
            self.scene.set_opacity(layer, opacity if self.station == "fit" else 1.0)
        self.scene.show_layers(layers)
        self.scene.show_gallery(tray)
        single = self.station == "fit" and self.workspace.selected is not None
        latent = self.station == "latent"
        looked_at = self.preview if previewing else self.workspace.selected if single else None
        focus = (looked_at, latent, self.scene.points() is not None)
        at_tray = self._tray.follow(tray, view is not None)
        if not at_tray and (focus != self._focus or view is not None):
            # The camera moves when what is looked at changes, never while it is looked at.
            self._focus = focus
            if view is not None:
                self.scene.look_from(view)
            else:
                self.scene.fit()
        self._draw()

    def _draw(self) -> None:
        self.viewport.request_render()
        self.drawn.emit()


def _drawn_avatar(fit: FitResult | None) -> tuple[Surface | None, Surface | None]:
    return (None, None) if fit is None else (avatar_surface(fit.avatar, 72), control_points(fit.avatar))


def _factors_or_none(fit: FitResult | None) -> ShapeFactors | None:
    """Return the avatar's factors; those of an avatar in pieces are not defined."""
    return measure(fit.avatar) if fit is not None and fit.verdict.pieces == 1 else None
