"""Which signal reaches whom: works, panels, docks and the view know nothing of each other."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from mbstudio.core.errors import MbstudioError
from mbstudio.core.formulas import nominal_diameter
from mbstudio.ui.language import tr
from mbstudio.ui.workers import Task

if TYPE_CHECKING:
    from mbstudio.ui.shell.main_window import MainWindow

log = logging.getLogger(__name__)


class WindowWiring:
    """Connects the parts of the main window and does what concerns several of them.

    Parameters
    ----------
    window : MainWindow
        With all its parts made.
    """

    def __init__(self, window: MainWindow) -> None:
        self.window = window
        space, link = window.workspace, window.link
        for signal in (
            space.state_changed, window.queue.changed, window.fits.changed, window.messages.shown,
            window.populations.changed, window.sweeps.changed,
        ):  # fmt: skip
            signal.connect(lambda *_: window.refresh())
        space.recent_changed.connect(window.show_recent)
        space.project_replaced.connect(lambda: window.enter("scan"))
        space.scan_changed.connect(self._scan_changed)
        space.grains_changed.connect(lambda: window.table.content.set_grains(space.state.grains))
        space.grains_changed.connect(window.show_docks)
        space.fits_changed.connect(lambda: window.table.content.set_fits(space.state.fits))
        space.selection_changed.connect(self._selection_changed)
        space.fits_changed.connect(self._show_curve_of_fit)
        for work in (
            window.scans, window.grains, window.fits, window.populations, window.sweeps, window.exports,
            window.projects,
        ):  # fmt: skip
            work.said.connect(window.messages.say)
        window.queue.failed.connect(self._task_failed)
        window.scans.asked.connect(window.files.ask_about_scan)
        window.projects.opened.connect(window.scans.reopen)
        window.table.chosen.connect(space.choose)
        window.rail.chosen.connect(window.enter)
        window.fits.began.connect(lambda _: window.curve.set_losses([]))
        window.fits.losses_arrived.connect(self._losses_arrived)
        link.factors_ready.connect(window.panels_fit.show_factors)
        window.panels_fit.intervals_button.clicked.connect(window.switch_intervals)
        window.intervals.found.connect(window.panels_fit.show_intervals)
        window.panels_scan.slice_moved.connect(link.move_slice)
        window.panels_scan.slice_switched.connect(link.switch_slice)
        window.panels_scan.window_changed.connect(link.set_window)
        window.panels_fit.opacity_changed.connect(link.set_opacity)
        window.sweep.n_chosen.connect(window.use_n)
        window.panels_fit.sweep_button.clicked.connect(lambda: window.show_sweep(True))
        window.panels_fit.step_asked.connect(window.step_grain)
        window.panels_fit.points.toggled.connect(lambda on: self._run_layer("points", on))
        window.panels_export.folder_asked.connect(window.files.ask_export_folder)
        window.panels_grains.find_asked.connect(lambda _: window.commands.run("grains.find"))
        window.panels_export.export_asked.connect(lambda: window.commands.run("export.run"))
        window.welcome.recent_chosen.connect(window.files.open_path)
        for button, command in (
            (window.welcome.open_button, "scan.open"),
            (window.welcome.sample_button, "scan.sample"),
            (window.welcome.project_button, "project.open"),
            (window.panels_scan.open_button, "scan.open"),
            (window.panels_scan.sample_button, "scan.sample"),
            (window.panels_grains.load_button, "grains.load"),
            (window.panels_fit.fit_button, "fit.grain"),
            (window.panels_fit.all_button, "fit.all"),
        ):
            button.clicked.connect(lambda _checked=False, name=command: window.commands.run(name))
        window.show_recent()

    def _scan_changed(self) -> None:
        slices = self.window.link.scene.layers.slices.planes
        if slices is not None:
            self.window.panels_scan.show_window(*slices.window)
            self.window.panels_grains.set_threshold_range(*slices.window)
        self.window.show_docks()

    def _selection_changed(self) -> None:
        chosen, grains = self.window.workspace.selected, self.window.workspace.state.grains
        self.window.table.select_labels(self.window.workspace.chosen, chosen)
        diameter = None
        if grains is not None and chosen is not None:
            rows = grains.table.loc[grains.table["label"] == chosen, "volume"]
            diameter = nominal_diameter(float(rows.iloc[0]))
        self.window.panels_grains.mark_grain(diameter)
        self._show_curve_of_fit()

    def _losses_arrived(self, fitted: int, losses: list[float]) -> None:
        if fitted == self.window.workspace.selected:
            self.window.curve.add_losses(losses)

    def _show_curve_of_fit(self) -> None:
        chosen = self.window.workspace.selected
        if chosen is not None and chosen == self.window.fits.running_label:
            return
        fit = self.window.workspace.state.fits.get(chosen) if chosen is not None else None
        self.window.curve.set_losses([] if fit is None else [float(loss) for loss in fit.history])

    def _run_layer(self, layer: str, shown: bool) -> None:
        self.window.link.show_layer(layer, shown)  # type: ignore[arg-type]
        self.window.commands.refresh()

    def _task_failed(self, task: Task, error: Exception) -> None:
        if isinstance(error, MbstudioError):
            self.window.messages.say("error", str(error))
        elif isinstance(error, OSError | MemoryError):
            reason = str(error) or tr("not enough memory")
            told = tr("{task} failed: {reason}.", task=task.title, reason=reason)
            self.window.messages.say("error", told)
        else:
            log.error("%s failed", task.title, exc_info=error)
            self.window.messages.say(
                "error",
                tr(
                    "{task} failed by a mistake in mbstudio ({kind}: {error}).",
                    task=task.title,
                    kind=type(error).__name__,
                    error=error,
                ),
            )
