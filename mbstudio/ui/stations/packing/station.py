"""Station Packing: grains are poured into a mould, watched, measured and compared."""

from __future__ import annotations

from functools import partial

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.packing.display import PackingDisplay
from mbstudio.ui.stations.packing.link import PackingLink
from mbstudio.ui.stations.packing.panel import PackingPanel
from mbstudio.ui.stations.packing.plots import NARROWEST, PAGES, PackingDock
from mbstudio.ui.stations.packing.work import PackingWork
from mbstudio.ui.stations.station import Station
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.widgets.dock_frame import DockFrame

_PANEL = 440  # pixels that rail and panel take


class PackingStation(Station):
    """Packs avatars, clones and spheres, and tells whether they pack alike."""

    id, icon, guide = "packing", "ph.package", "Packing"
    title, tip = mark("Packing"), mark("Pour grains into a mould and measure the packing")
    menu = mark("Packing")

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio, view)
        self.work = PackingWork(studio.workspace, studio.queue, view.viewport.kind, self)
        self.panel: PackingPanel = PackingPanel(self.work)
        self.dock = PackingDock(studio.theme)
        self.display: PackingDisplay = PackingDisplay(studio.workspace)
        self.frame = DockFrame(
            "packing",
            tr("Plots of the packing"),
            self.dock,
            "right",
            studio.icons,
            first_width=lambda width: min(max(400, width // 4), max(NARROWEST, (width - _PANEL) // 2)),
        )
        self.docks = (self.frame,)
        self.link = PackingLink(studio, view, self.display, self.work, self.panel, self.dock)

    def commands(self) -> list[Command]:
        work = self.work
        return [
            Command(
                id="packing.pack",
                title=tr("Pack grains"),
                run=self.pack,
                menu="Packing",
                shortcut="Ctrl+J",
                icon="ph.package",
                tip=tr("Pour grains into a mould as station Packing says, and let them settle"),
                enabled=lambda: self.panel.is_ready,
            ),
            Command(
                id="packing.pause",
                title=tr("Pause packing"),
                run=work.run.pause_or_resume,
                menu="Packing",
                icon="ph.pause",
                tip=tr("Let the grains stand still, or go on"),
                enabled=lambda: work.run.is_running,
                words=lambda: tr("Resume packing") if work.run.is_paused else tr("Pause packing"),
            ),
            Command(
                id="packing.cancel",
                title=tr("Cancel packing"),
                run=work.run.cancel,
                menu="Packing",
                icon="ph.x",
                tip=tr("Give up the packing; the one before stays"),
                enabled=lambda: work.run.is_running,
            ),
            Command(
                id="packing.export",
                title=tr("Export packing…"),
                run=self.link.ask_export,
                menu="Packing",
                icon="ph.export",
                tip=tr("Write poses, contacts, profiles and surfaces of the packing into a folder"),
                enabled=lambda: work.trial is not None and not work.run.is_running,
            ),
            Command(
                id="packing.remove",
                title=tr("Remove packing"),
                run=lambda: self.studio.workspace.change(tr("Remove packing"), packing=None),
                menu="Packing",
                icon="ph.trash",
                tip=tr("Take the packing out of the project"),
                enabled=lambda: work.trial is not None and not work.run.is_running,
            ),
            *self._page_commands(),
            self.frame.command(
                tr("Plots of the packing"),
                tr("Show or hide the plots at station Packing"),
                icon="ph.chart-line",
                enabled=lambda: self.is_open,
            ),
        ]

    def _page_commands(self) -> list[Command]:
        return [
            Command(
                id=f"packing.page_{name}",
                title=tr("Page {page}", page=tr(title)),
                run=partial(self.open_page, name),
                menu="Packing",
                tip=tr("Turn to the page {page} of the packing", page=tr(title)),
                enabled=lambda: self.work.trial is not None,
                separated=place == 0,
            )
            for place, (name, title) in enumerate(PAGES)
        ]

    def wire(self) -> None:
        self.relay_messages(self.work)
        self.work.changed.connect(self.studio.refresh)
        for button, command in (
            (self.panel.pack_button, "packing.pack"),
            (self.panel.pause_button, "packing.pause"),
            (self.panel.cancel_button, "packing.cancel"),
            (self.panel.export_button, "packing.export"),
        ):
            self.studio.commands.bind(button, command)

    def enter(self) -> None:
        self.link.entered()

    def leave(self) -> None:
        self.link.left()

    def pack(self) -> None:
        """Pack as the panel says."""
        self.studio.enter(self.id)
        self.work.pack(self.panel.asked)

    def open_page(self, name: str) -> None:
        """Go to a plot."""
        self.studio.enter(self.id)
        self.frame.show()
        self.dock.open_page(name)
