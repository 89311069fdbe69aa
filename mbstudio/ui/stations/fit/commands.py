"""The commands of the menu Fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.fit.link import FitLink
from mbstudio.ui.stations.fit.panel import FitPanel
from mbstudio.ui.stations.fit.sweep_dock import SweepDock
from mbstudio.ui.stations.fit.sweep_work import SweepWork
from mbstudio.ui.stations.fit.work import FitWork
from mbstudio.ui.widgets.dock_frame import DockFrame
from mbstudio.ui.workspace import Workspace


def fit_commands(
    space: Workspace,
    work: FitWork,
    link: FitLink,
    panel: FitPanel,
    curve: DockFrame,
    sweep: Sequence[Command],
) -> list[Command]:
    """Return the commands of station Fit, those of the sweep among them."""
    return [
        *_search(space, work, link),
        *sweep,
        curve.command(
            tr("Convergence curve"), tr("Show or hide the convergence curve"), icon="ph.chart-line"
        ),
        Command(
            id="fit.intervals",
            title=tr("Intervals of the factors"),
            run=link.switch_intervals,
            menu="Fit",
            icon="ph.arrows-out-line-horizontal",
            tip=tr("Show how far the factors of the selected grain may be off, or the factors again"),
            enabled=lambda: panel.factors.has_grain,
            checked=lambda: panel.factors.has_intervals,
        ),
        Command(
            id="view.save_curve",
            title=tr("Save convergence curve…"),
            run=link.ask_curve,
            menu="Tools",
            icon="ph.chart-line",
            tip=tr("Save the curve of the selected grain's fit as SVG, PNG or PDF"),
            enabled=lambda: space.selected in space.state.fits,
        ),
    ]


def _search(space: Workspace, work: FitWork, link: FitLink) -> list[Command]:
    return [
        Command(
            id="fit.grain",
            title=tr("Fit grain"),
            run=link.fit_chosen,
            menu="Fit",
            shortcut="Ctrl+F",
            icon="ph.play-circle",
            tip=tr("Fit an avatar to each chosen grain"),
            enabled=lambda: space.selected is not None and work.can_fit_chosen,
            words=work.words_of_fit,
            is_about_grains=True,
        ),
        Command(
            id="fit.all",
            title=tr("Fit all grains"),
            run=link.fit_all,
            menu="Fit",
            shortcut="Ctrl+Shift+F",
            icon="ph.fast-forward-circle",
            tip=tr("Fit every grain inside the scan that has no avatar yet"),
            enabled=lambda: bool(work.unfitted()) and not work.all_run.is_running,
        ),
        Command(
            id="fit.pause",
            title=tr("Pause or resume the fit"),
            run=work.run.pause_or_resume,
            menu="Fit",
            shortcut="Ctrl+Space",
            icon="ph.pause-circle",
            tip=tr("Pause the search, or resume it"),
            enabled=lambda: work.run.is_running,
            separated=True,
        ),
        Command(
            id="fit.stop",
            title=tr("Stop the fit and keep the avatar"),
            run=work.run.stop,
            menu="Fit",
            icon="ph.stop-circle",
            tip=tr("Stop the search and keep the avatar found so far"),
            enabled=lambda: work.run.is_running,
        ),
        Command(
            id="fit.more",
            title=tr("More generations"),
            run=link.fit_more,
            menu="Fit",
            icon="ph.plus-circle",
            tip=tr("Continue the last search"),
            enabled=lambda: work.can_go_on(space.selected),
        ),
    ]


def sweep_commands(
    space: Workspace,
    work: SweepWork,
    link: FitLink,
    dock: SweepDock,
    frame: DockFrame,
    show: Callable[[bool], object],
) -> list[Command]:
    """Return the commands of the sweep over n."""

    def start() -> None:
        show(True)
        dock.start()

    def open_for_chosen() -> None:
        show(True)
        dock.choose("chosen")

    def use_n() -> None:
        if dock.advice is not None:
            link.use_n(dock.advice)

    return [
        Command(
            id="fit.sweep",
            title=tr("Sweep over n"),
            run=show,
            menu="Fit",
            shortcut="Ctrl+Shift+N",
            icon="ph.chart-line",
            tip=tr("Loss and errors of the selected grains against n, at station Fit"),
            enabled=lambda: space.state.grains is not None,
            checked=lambda: not frame.isHidden(),
        ),
        Command(
            id="fit.sweep_chosen",
            title=tr("Sweep over n of chosen grains…"),
            run=open_for_chosen,
            menu="Fit",
            icon="ph.chart-line",
            tip=tr("Choose the chosen grains for the sweep over n"),
            enabled=lambda: bool(space.chosen) and not work.run.is_running,
            words=lambda: plural(
                len(space.chosen) or 1,
                mark("Sweep over n of chosen grain…"),
                mark("Sweep over n of {count} chosen grains…"),
            ),
            is_about_grains=True,
        ),
        Command(
            id="fit.start_sweep",
            title=tr("Start the sweep"),
            run=start,
            menu="Fit",
            icon="ph.play-circle",
            tip=tr("Fit the grains with each number of control points that the sweep lists"),
            enabled=lambda: space.state.grains is not None and not work.run.is_running,
        ),
        Command(
            id="fit.cancel_sweep",
            title=tr("Cancel the sweep"),
            run=work.run.cancel,
            menu="Fit",
            icon="ph.x-circle",
            tip=tr("Cancel the sweep; the fits that have ended stay in its plots"),
            enabled=lambda: work.run.is_running,
        ),
        Command(
            id="fit.use_n",
            title=tr("Use the n of the sweep"),
            run=use_n,
            menu="Fit",
            icon="ph.check-circle",
            tip=tr("Fit with the smallest n that meets the limit for all selected rows of the table"),
            enabled=lambda: dock.advice is not None,
        ),
    ]
