"""Station Export: avatars are written for a DEM engine."""

from __future__ import annotations

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.export.display import ExportDisplay
from mbstudio.ui.stations.export.link import ExportLink
from mbstudio.ui.stations.export.panel import ExportPanel
from mbstudio.ui.stations.export.work import ExportWork
from mbstudio.ui.stations.station import Station
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView


class ExportStation(Station):
    """Writes DEM files, shows beforehand what they hold, and makes specimens."""

    id, icon, guide = "export", "ph.export", "Export"
    title, tip = mark("Export"), mark("Write DEM files")

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio, view)
        self.work = ExportWork(studio.workspace, studio.queue, self)
        self.panel: ExportPanel = ExportPanel(studio.workspace, studio.offers, studio.theme, studio.icons)
        self.display: ExportDisplay = ExportDisplay(studio.workspace)
        self.link = ExportLink(self, studio, view, self.display, self.panel)

    def commands(self) -> list[Command]:
        return [
            Command(
                id="export.run",
                title=tr("Export avatars"),
                run=self.export,
                menu="Fit",
                shortcut="Ctrl+E",
                icon="ph.export",
                tip=tr("Write the avatars for the DEM engine chosen at station Export"),
                enabled=lambda: self.panel.is_ready,
                separated=True,
            ),
            Command(
                id="export.chosen",
                title=tr("Export chosen avatars…"),
                run=self.export_chosen,
                menu="Fit",
                icon="ph.export",
                tip=tr("Choose the avatars of the chosen grains at station Export"),
                enabled=lambda: bool(self.panel.chosen_labels),
                words=lambda: plural(
                    len(self.panel.chosen_labels) or 1,
                    mark("Export chosen avatar…"),
                    mark("Export {count} chosen avatars…"),
                ),
                is_about_grains=True,
            ),
        ]

    def wire(self) -> None:
        self.relay_messages(self.work)
        self.panel.readiness_changed.connect(self.studio.commands.refresh)
        self.studio.commands.bind(self.panel.export_button, "export.run")

    def enter(self) -> None:
        self.link.entered()

    def leave(self) -> None:
        self.link.left()

    def export_chosen(self) -> None:
        """Go to the export of the chosen grains' avatars."""
        self.studio.enter(self.id)
        self.panel.choose("chosen")

    def export(self) -> None:
        """Export as the panel says."""
        if self.panel.folder_path is not None:
            self.studio.enter(self.id)
            self.panel.start(self.work)
