"""Station Fit: a grain becomes an avatar; how many control points are enough is swept."""

from __future__ import annotations

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.fit.commands import fit_commands, sweep_commands
from mbstudio.ui.stations.fit.link import FitLink
from mbstudio.ui.stations.fit.panel import FitPanel
from mbstudio.ui.stations.fit.sweep_dock import SweepDock
from mbstudio.ui.stations.fit.sweep_work import SweepWork
from mbstudio.ui.stations.fit.twin.commands import twin_commands
from mbstudio.ui.stations.fit.twin.dock import TwinDock
from mbstudio.ui.stations.fit.twin.link import TwinLink
from mbstudio.ui.stations.fit.twin.work import TwinWork
from mbstudio.ui.stations.fit.work import FitWork, IntervalWork
from mbstudio.ui.stations.station import HalfDone, Station
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.display import Display
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.widgets.dock_frame import DockFrame
from mbstudio.ui.widgets.plots import ConvergenceCurve


class FitDisplay(Display):
    """The chosen grain with its avatar; as long as none is chosen all grains, or the twin's contacts."""

    @property
    def looked_at(self) -> object:
        return self._workspace.selected

    def layers_now(self, tray: bool) -> set[str]:
        if self._workspace.selected is not None:
            return self.shown
        network = self.is_shown("network") and self._workspace.state.twin is not None
        return self.shown & {"network", "slices", "avatars"} if network else self.overview()


class FitStation(Station):
    """Fits one grain before the eyes or many in the background.

    Attributes
    ----------
    shows_sweep : bool
        Whether the sweep over n is shown; it takes the curve's room.
    shows_twin : bool
        Whether the twin is shown, in the same place.
    """

    id, icon, guide = "fit", "ph.circles-three", "Avatars"
    title, tip = mark("Fit"), mark("Fit avatars")
    menu = mark("Fit")
    borrowed = ("table",)

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio, view)
        space = studio.workspace
        self.work = FitWork(space, studio.queue, self)
        self.interval_work = IntervalWork(space, studio.queue, self)
        self.sweep_work = SweepWork(space, studio.queue, self)
        self.panel: FitPanel = FitPanel(space, self.work, studio.icons)
        self.curve = ConvergenceCurve(studio.theme)
        self.sweep_dock = SweepDock(space, self.sweep_work, studio.theme)
        self.twin_work = TwinWork(space, studio.queue, self)
        self.twin_dock = TwinDock(space, self.twin_work, studio.theme, studio.icons)
        self.display = FitDisplay(
            space,
            ("slices", "grain", "avatar", "deviation", "points", "avatars", "network"),
            ("grain", "avatar"),
            compares=True,
            shows_slices=True,
        )
        self.display.opacity["grain"] = 0.6
        self.shows_sweep = self.shows_twin = False
        self.curve_frame = DockFrame(
            "curve",
            tr("Convergence"),
            self.curve,
            "bottom",
            studio.icons,
            is_wanted=lambda: space.state.grains is not None and not self.shows_sweep and not self.shows_twin,
            share=280,
        )
        self.sweep_frame = DockFrame(
            "sweep",
            tr("Sweep over n"),
            self.sweep_dock,
            "right",
            studio.icons,
            is_wanted=lambda: self.shows_sweep,
            first_width=lambda width: max(400, width // 3),
        )
        self.twin_frame = DockFrame(
            "twin",
            tr("Twin"),
            self.twin_dock,
            "right",
            studio.icons,
            is_wanted=lambda: self.shows_twin,
            first_width=lambda width: max(360, width // 3),
        )
        self.docks = (self.curve_frame, self.sweep_frame, self.twin_frame)
        self.twin_link = TwinLink(
            studio, view, self.twin_work, self.twin_dock, lambda: self.is_open and self.shows_twin
        )
        self.link = FitLink(studio, view, self.work, self.interval_work, self.panel, self.curve)

    def commands(self) -> list[Command]:
        sweep = sweep_commands(
            self.studio.workspace,
            self.sweep_work,
            self.link,
            self.sweep_dock,
            self.sweep_frame,
            self.show_sweep,
        )
        twin = twin_commands(
            self.studio.workspace, self.twin_work, self.twin_link, self.twin_frame, self.show_twin
        )
        return fit_commands(
            self.studio.workspace, self.work, self.link, self.panel, self.curve_frame, [*twin, *sweep]
        )

    def wire(self) -> None:
        self.relay_messages(self.work, self.sweep_work, self.interval_work, self.twin_work)
        self.work.changed.connect(self.studio.refresh)
        self.work.arrived.connect(self.arrived)
        self.sweep_dock.advice_changed.connect(self.studio.commands.outdate)
        self.sweep_work.changed.connect(self.studio.refresh)
        self.twin_work.changed.connect(self.studio.refresh)
        self.twin_work.finished.connect(self.studio.refresh)
        for button, command in (
            (self.panel.fit_button, "fit.grain"),
            (self.panel.all_button, "fit.all"),
            (self.panel.pause_button, "fit.pause"),
            (self.panel.stop_button, "fit.stop"),
            (self.panel.more_button, "fit.more"),
            (self.panel.sweep_button, "fit.sweep"),
            (self.panel.intervals_button, "fit.intervals"),
            (self.panel.twin_button, "fit.twin"),
            (self.twin_dock.start_button, "fit.start_twin"),
            (self.twin_dock.pause_button, "fit.pause_twin"),
            (self.twin_dock.stop_button, "fit.stop_twin"),
            (self.twin_dock.cancel_button, "fit.cancel_twin"),
            (self.twin_dock.export_button, "fit.export_contacts"),
            (self.panel.before, "grains.previous"),
            (self.panel.after, "grains.next"),
            (self.sweep_dock.start_button, "fit.start_sweep"),
            (self.sweep_dock.cancel_button, "fit.cancel_sweep"),
            (self.sweep_dock.use_button, "fit.use_n"),
        ):
            self.studio.commands.bind(button, command)

    def show_sweep(self, shown: bool) -> None:
        """Show or hide the sweep over n, which takes the curve's room."""
        self.shows_sweep, self.shows_twin = shown, self.shows_twin and not shown
        self._arrange(shown)

    def show_twin(self, shown: bool) -> None:
        """Show or hide the twin, which takes the curve's room."""
        self.shows_twin, self.shows_sweep = shown, self.shows_sweep and not shown
        self._arrange(shown)

    def _arrange(self, shown: bool) -> None:
        if shown and not self.is_open:
            self.studio.enter(self.id)
        self.studio.arrange_docks()
        self.studio.commands.refresh()
        self.twin_link.tint()
        self.twin_link.draw_fabric()

    def enter(self) -> None:
        self.twin_link.tint()
        self.twin_link.draw_fabric()

    def leave(self) -> None:
        self.twin_link.tint()

    # ---- what the shell asks ---------------------------------------------------------------------

    @property
    def half_done(self) -> HalfDone | None:
        fits = self.work.arrived_fits
        return HalfDone(tuple(fits.values()), lambda state: state.with_fits(fits)) if fits else None

    @property
    def has_unsaved_work(self) -> bool:
        return bool(self.work.arrived_fits) or self.work.run.is_running or self.twin_work.run.is_running

    def stop_and_keep(self) -> bool:
        runs = self.work.run.is_running
        self.work.run.stop()
        return runs
