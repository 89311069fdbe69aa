"""The commands of the twin, in the menu Fit."""

from __future__ import annotations

from collections.abc import Callable

from mbstudio.ui.commands import Command
from mbstudio.ui.language import tr
from mbstudio.ui.stations.fit.twin.link import TwinLink
from mbstudio.ui.stations.fit.twin.work import TwinWork
from mbstudio.ui.widgets.dock_frame import DockFrame
from mbstudio.ui.workspace import Workspace


def twin_commands(
    space: Workspace,
    work: TwinWork,
    link: TwinLink,
    frame: DockFrame,
    show: Callable[[bool], object],
) -> list[Command]:
    """Return the commands of the twin."""

    def start() -> None:
        show(True)
        work.start()

    return [
        Command(
            id="fit.twin",
            title=tr("Twin"),
            run=show,
            menu="Fit",
            shortcut="Ctrl+Shift+W",
            icon="ph.share-network",
            tip=tr(
                "All avatars fitted together to the grey values, their contacts and fabric, at station Fit"
            ),
            enabled=lambda: space.state.grains is not None,
            checked=lambda: not frame.isHidden(),
            separated=True,
        ),
        Command(
            id="fit.start_twin",
            title=tr("Fit the twin"),
            run=start,
            menu="Fit",
            icon="ph.play-circle",
            tip=tr("Fit all avatars together to the grey values of the scan"),
            enabled=lambda: work.can_start,
            words=lambda: tr("Fit the twin again") if space.state.twin is not None else tr("Fit the twin"),
        ),
        Command(
            id="fit.pause_twin",
            title=tr("Pause or resume the twin"),
            run=work.run.pause_or_resume,
            menu="Fit",
            icon="ph.pause-circle",
            tip=tr("Pause the fit of the twin, or resume it"),
            enabled=lambda: work.run.is_running,
        ),
        Command(
            id="fit.stop_twin",
            title=tr("Stop the twin and keep it"),
            run=work.run.stop,
            menu="Fit",
            icon="ph.stop-circle",
            tip=tr("End the sweeps and keep the twin as it stands"),
            enabled=lambda: work.run.is_running,
        ),
        Command(
            id="fit.cancel_twin",
            title=tr("Cancel the twin"),
            run=work.run.cancel,
            menu="Fit",
            icon="ph.x-circle",
            tip=tr("Give the fit of the twin up; the avatars stay as they are"),
            enabled=lambda: work.run.is_running,
        ),
        *_files(space, link),
    ]


def _files(space: Workspace, link: TwinLink) -> list[Command]:
    return [
        Command(
            id="fit.export_contacts",
            title=tr("Export contacts…"),
            run=link.ask_export,
            menu="Fit",
            icon="ph.download-simple",
            tip=tr("Write the contacts of the twin as CSV, for ParaView (VTU) or as a graph (GraphML)"),
            enabled=lambda: space.state.twin is not None,
        ),
        Command(
            id="fit.save_fabric",
            title=tr("Save figure of the fabric…"),
            run=link.ask_figure,
            menu="Fit",
            icon="ph.chart-pie-slice",
            tip=tr("Save rose, coordination numbers and fabric tensors as SVG, PNG or PDF"),
            enabled=lambda: space.state.twin is not None and len(space.state.twin.touching) > 0,
        ),
    ]
