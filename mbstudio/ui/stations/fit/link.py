"""Keeps station Fit in step: curve, factors and avatar follow the fit that runs and the chosen grain."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject, QSignalBlocker
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.metrics import FactorIntervals, ShapeFactors
from mbstudio.ui.figure_files import FIGURE_FILTER, draw_figure, fault_of_figure, figure_path
from mbstudio.ui.language import tr
from mbstudio.ui.stations.fit.panel import FitPanel
from mbstudio.ui.stations.fit.work import FitWork, IntervalWork
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.widgets.plots import ConvergenceCurve


class FitLink(QObject):
    """What happens at station Fit.

    Parameters
    ----------
    studio : Studio
    view : SceneView
    work : FitWork
    interval_work : IntervalWork
    panel : FitPanel
    curve : ConvergenceCurve
    """

    def __init__(
        self,
        studio: Studio,
        view: SceneView,
        work: FitWork,
        interval_work: IntervalWork,
        panel: FitPanel,
        curve: ConvergenceCurve,
    ) -> None:
        super().__init__(studio)
        self._studio, self._view, self._space = studio, view, studio.workspace
        self._work, self._interval_work = work, interval_work
        self._panel, self._curve = panel, curve
        self._space.selection_changed.connect(self._show_curve_of_fit)
        self._space.fits_changed.connect(self._show_curve_of_fit)
        work.began.connect(lambda _: curve.set_losses([]))
        work.losses_arrived.connect(self._add_losses)
        work.avatar_moved.connect(view.show_live_avatar)
        view.surfaces.live_label = lambda: work.running_label
        view.factors_ready.connect(self._show_factors)
        view.arranged.connect(self._show_points)
        interval_work.found.connect(self._show_intervals)
        panel.opacity_changed.connect(view.set_opacity)
        panel.points.toggled.connect(self._switch_points)

    def _add_losses(self, fitted: int, losses: list[float]) -> None:
        if fitted == self._space.selected:
            self._curve.add_losses(losses)
            self._curve.mark_changes(self._work.changes_of(fitted))

    def _show_curve_of_fit(self) -> None:
        chosen = self._space.selected
        if chosen is not None and chosen == self._work.running_label:
            return
        fit = self._space.state.fits.get(chosen) if chosen is not None else None
        self._curve.set_losses([] if fit is None else [float(loss) for loss in fit.history])
        self._curve.mark_changes([] if fit is None else self._work.changes_of(chosen))

    def _show_factors(self, grain: ShapeFactors | None, avatar: ShapeFactors | None) -> None:
        self._panel.show_factors(grain, avatar)
        self._studio.commands.outdate()

    def _show_intervals(self, label: int, intervals: FactorIntervals | None) -> None:
        self._panel.show_intervals(label, intervals)
        self._studio.commands.outdate()

    def _show_points(self) -> None:
        with QSignalBlocker(self._panel.points):
            self._panel.points.setChecked(self._view.is_shown("points"))

    def _switch_points(self, shown: bool) -> None:
        self._view.show_layer("points", shown)
        self._studio.commands.outdate()

    # ---- what the commands do --------------------------------------------------------------------

    def fit_chosen(self) -> None:
        """Fit the chosen grain before the eyes; many of them in the background, all at once."""
        if self._space.selected is None or not self._panel.take_target():
            return
        self._studio.enter("fit")
        if len(self._space.chosen) > 1:
            self._work.fit_all(self._work.fittable())
        else:
            self._work.fit(self._space.selected)

    def fit_all(self) -> None:
        """Fit every grain inside the scan without an avatar."""
        self._studio.enter("fit")
        if self._panel.take_target():
            self._work.fit_all()

    def fit_more(self) -> None:
        """Let the last fit go on."""
        self._work.go_on(self._panel.more.value(), self._panel.n.value())

    def switch_intervals(self, _shown: bool = True) -> None:
        """Show between what the factors of the chosen grain lie, or its factors again."""
        label = self._space.selected
        if label is None:
            return
        if self._panel.factors.has_intervals:
            self._show_intervals(label, None)
        else:
            self._interval_work.find(label)

    def use_n(self, n: int) -> None:
        """Fit with this number from now on; a target would look for another."""
        self._space.change_fit_settings(n=n, target="")
        self._studio.say("success", tr("The next fits are made with n = {n}.", n=n))

    # ---- files -----------------------------------------------------------------------------------

    def ask_curve(self) -> None:
        """Ask for a file and save the chosen grain's convergence curve to it."""
        name, kind = QFileDialog.getSaveFileName(
            self._studio.host,
            tr("Save convergence curve"),
            self._studio.path_for(f"convergence_{self._space.selected}.svg"),
            tr(FIGURE_FILTER),
        )
        if name:
            self.save_curve(figure_path(name, kind))

    def save_curve(self, path: Path) -> None:
        """Save the chosen grain's convergence curve: SVG, PNG or PDF by its ending."""
        from mbstudio.scene.pictures.figures import convergence_plot

        space, studio = self._space, self._studio
        fault = fault_of_figure(path)
        fit = space.state.fits.get(space.selected) if space.selected is not None else None
        if fault:
            studio.say("error", fault)
        elif fit is not None and space.selected is not None:
            fits = {space.selected: fit}
            task = draw_figure(studio.queue, lambda: convergence_plot(fits), path)
            task.succeeded.connect(
                lambda written: studio.say("success", tr("Saved the curve as {path}.", path=written))
            )
