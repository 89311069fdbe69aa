"""Builds what the view shows in a thread, and puts it into the scene if it is still wanted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QObject, Signal

from mbstudio.core.grains import GrainSet
from mbstudio.core.imaging import FitResult
from mbstudio.core.metrics import ShapeFactors, measure
from mbstudio.scene import Scene
from mbstudio.scene.grain_overview import GrainOverview
from mbstudio.scene.grain_surfaces import MOST_OF_ONE, overview_of_grains, surface_of_grain
from mbstudio.scene.layers.deviation_map import deviation_surface
from mbstudio.scene.layers.volume import largest_texture, volume_voxels
from mbstudio.scene.surfaces import (
    Surface,
    avatar_surface,
    avatars_surface,
    control_points,
)
from mbstudio.scene.thinning import thinned
from mbstudio.ui.language import tr
from mbstudio.ui.workers import Task, TaskQueue
from mbstudio.ui.workspace import Workspace

# Longest side in voxels of overview and volume: what software renders in a fraction of a second.
DETAIL = {"OpenGL": (320, 384), "software": (140, 160)}
# Triangles of all grains, and of one: software draws them in the main thread in less than 0.1 s.
TRIANGLES = {"OpenGL": (1_500_000, MOST_OF_ONE), "software": (150_000, 150_000)}


@dataclass(frozen=True, eq=False)
class _Chosen:
    """What a worker makes of the chosen grain."""

    grain: Surface
    avatar: Surface | None
    points: Surface | None
    grain_factors: ShapeFactors
    avatar_factors: ShapeFactors | None


class ViewSurfaces(QObject):
    """The surfaces and the volume of the workspace, built in the lane ``view``.

    Parameters
    ----------
    workspace : Workspace
    queue : TaskQueue
    scene : Scene
    kind : str
        Of the viewport: software renders less detail.

    Attributes
    ----------
    factors_ready : signal (ShapeFactors or None, ShapeFactors or None)
        Factors of the chosen grain and its avatar.
    taken : signal
        Something new is in the scene.
    live_label : callable
        Label of the grain whose avatar is being fitted: that avatar is drawn by others as it moves.
    """

    factors_ready = Signal(object, object)
    taken = Signal()

    def __init__(
        self, workspace: Workspace, queue: TaskQueue, scene: Scene, kind: str, parent: QObject
    ) -> None:
        super().__init__(parent)
        self._workspace, self._queue, self._scene = workspace, queue, scene
        self.live_label: Callable[[], int | None] = lambda: None
        self._overview, self._volume = DETAIL[kind]
        self._most, self._most_of_one = TRIANGLES[kind]
        self._factors: dict[int, ShapeFactors] = {}
        self._drawn: GrainOverview | None = None
        self._shown_grain: int | None = None
        self._shown_family: object = None
        self._deviating: tuple[object, object] | None = None

    def build_grains(self) -> None:
        """Build the overview of all grains; after corrections anew only where something was corrected."""
        grains, drawn = self._workspace.state.grains, self._drawn
        if grains is not None and drawn is not None and drawn.follows(grains):
            before = drawn.grains
            self._factors = {k: known for k, known in self._factors.items() if grains.shares_body(before, k)}
            if not grains.changed_since(before):
                self._drawn = drawn.updated(grains)
                return
            self._build_overview(grains, lambda: drawn.updated(grains))
            return
        self._factors.clear()
        self._drawn = None
        # Corrected by hand, they are shown as they were until they are built anew: no blank view meanwhile.
        family = None if grains is None else (grains.label_volume.family, grains.voxel_size)
        if family is None or family != self._shown_family:
            self._scene.layers.grains.set(None)
            self._scene.layers.grains.set_chosen(None)
        self._shown_family = family
        if grains is not None:
            self._build_overview(grains, lambda: GrainOverview.of(grains, self._overview, self._most))

    def _build_overview(self, grains: GrainSet, make: Callable[[], GrainOverview]) -> None:
        def make_both() -> tuple[GrainOverview, Surface]:
            overview = make()
            # Meshes of files are as coarse as is wanted already.
            return overview, overview.surface if grains.meshes else thinned(overview.surface, self._most)

        def show(made: tuple[GrainOverview, Surface]) -> None:
            self._drawn, shown = made
            self._scene.layers.grains.set(shown, grains.unit)

        self._build(
            "grains",
            tr("Drawing the grains"),
            make_both,
            show,
            lambda: grains is self._workspace.state.grains,
        )

    def build_volume(self) -> None:
        """Build the scan, or what is cut in its place, as a cloud, if it is not there."""
        scan = self._workspace.sliced
        if scan is not None and not self._scene.layers.volume.holds_something:
            most = largest_texture(self._scene.plotter.render_window)
            longest = min(self._volume, most) if most else self._volume
            self._build(
                "volume",
                tr("Drawing the volume"),
                lambda: volume_voxels(scan, longest),
                self._scene.layers.volume.set,
                lambda: scan is self._workspace.sliced,
            )

    def build_chosen(self) -> None:
        """Build the chosen grain, its avatar and the factors of both."""
        label, state = self._workspace.selected, self._workspace.state
        grains = state.grains
        if label is None or grains is None or label != self._shown_grain:
            self._shown_grain = None if grains is None else label
            layers = self._scene.layers
            for layer in (layers.grain, layers.avatar, layers.points):
                layer.set(None)
            self.clear_deviation()
            self.factors_ready.emit(None, None)
        if label is None or grains is None:
            return
        fit = state.fits.get(label)
        known = self._factors.get(label)

        def make() -> _Chosen:
            return _Chosen(
                surface_of_grain(grains, label, self._most_of_one),
                *_drawn_avatar(fit),
                known or measure(grains.body(label)),
                _factors_or_none(fit),
            )

        def show(chosen: _Chosen) -> None:
            self._factors[label] = chosen.grain_factors
            self._scene.layers.grain.set(chosen.grain, grains.unit)
            if self.live_label() != label:
                self._scene.layers.avatar.set(chosen.avatar)
                self._scene.layers.points.set(chosen.points)
            self.factors_ready.emit(chosen.grain_factors, chosen.avatar_factors)

        self._build(
            "grain",
            tr("Drawing the grain"),
            make,
            show,
            lambda: (
                label == self._workspace.selected
                and grains is self._workspace.state.grains
                and fit is self._workspace.state.fits.get(label)
            ),
        )

    def build_deviation(self) -> None:
        """Build the map of the avatar's deviation from the chosen grain, if it is not there or under way."""
        label, state = self._workspace.selected, self._workspace.state
        fit = state.fits.get(label) if label is not None else None
        grains = state.grains
        if fit is None or grains is None or label is None:
            self.clear_deviation()
            return
        wanted = (grains, fit)
        if self._deviating is not None and all(a is b for a, b in zip(wanted, self._deviating, strict=True)):
            return
        self.clear_deviation()
        self._deviating = wanted
        self._build(
            "deviation",
            tr("Drawing the deviation"),
            lambda: deviation_surface(fit.avatar, grains.body(label)),
            self._scene.layers.deviation.set,
            lambda: self._deviating is wanted,
        )

    def clear_deviation(self) -> None:
        """Take the map of deviations away: the avatar that it belongs to has changed."""
        self._deviating = None
        self._scene.layers.deviation.set(None)

    def build_others(self) -> None:
        """Build the grains that are chosen beside the one looked at."""
        grains, space = self._workspace.state.grains, self._workspace
        wanted = space.chosen - {space.selected}
        self._scene.layers.grains.set_chosen(None)
        if grains is not None and wanted:
            self._build(
                "chosen",
                tr("Drawing chosen grains"),
                lambda: overview_of_grains(grains, self._overview, self._most, wanted),
                self._scene.layers.grains.set_chosen,
                lambda: grains is space.state.grains and wanted == space.chosen - {space.selected},
            )

    def build_avatars(self) -> None:
        """Build all avatars where their grains lie."""
        fits, grains = self._workspace.state.fits, self._workspace.state.grains
        if not fits:
            self._scene.layers.avatars.set(None)
            return
        unit = grains.unit if grains is not None else next(iter(fits.values())).avatar.unit
        self._build(
            "avatars",
            tr("Drawing the avatars"),
            lambda: avatars_surface(
                (fit.avatar for fit in fits.values()),
                40 if len(fits) < 100 else 24 if len(fits) < 500 else 14,
            ),
            lambda surface: self._scene.layers.avatars.set(surface, unit),
            lambda: fits is self._workspace.state.fits,
        )

    def _build(
        self,
        key: str,
        title: str,
        make: Callable[[], Any],
        on_built: Callable[[Any], object],
        wanted: Callable[[], bool],
    ) -> None:
        def done(result: Any) -> None:
            if wanted():
                on_built(result)
                self.taken.emit()

        task = Task(title, lambda control: make())
        task.succeeded.connect(done)
        self._queue.submit(task, lane="view", key=key)


def _drawn_avatar(fit: FitResult | None) -> tuple[Surface | None, Surface | None]:
    return (None, None) if fit is None else (avatar_surface(fit.avatar, 72), control_points(fit.avatar))


def _factors_or_none(fit: FitResult | None) -> ShapeFactors | None:
    """Return the avatar's factors; those of an avatar in pieces are not defined."""
    return measure(fit.avatar) if fit is not None and fit.verdict.pieces == 1 else None
