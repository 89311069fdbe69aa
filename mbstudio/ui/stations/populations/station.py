"""Station Populations: grains, avatars and clones are measured and compared."""

from __future__ import annotations

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.populations.commands import population_commands
from mbstudio.ui.stations.populations.dock import NARROWEST, PopulationDock
from mbstudio.ui.stations.populations.link import PopulationLink
from mbstudio.ui.stations.populations.panel import PopulationPanel
from mbstudio.ui.stations.populations.work import PopulationWork
from mbstudio.ui.stations.station import Station
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.display import GrainsDisplay
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.widgets.dock_frame import DockFrame

_PANEL = 440  # pixels that rail and panel take


def _width_of_plots(width: int) -> int:
    """Return the room of the plots at first: a third of the window, but no more than leaves a view."""
    return min(max(400, width // 3), max(NARROWEST, round(0.55 * (width - _PANEL))))


class PopulationStation(Station):
    """Measures populations, plots them and writes the report."""

    id, icon, guide = "populations", "ph.chart-bar", "Populations"
    title, tip = mark("Populations"), mark("Compare grains and avatars")
    menu = mark("Populations")
    borrowed = ("table",)

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio, view)
        self.work = PopulationWork(studio.workspace, studio.queue, studio.offers, self)
        self.panel: PopulationPanel = PopulationPanel(studio.workspace, self.work)
        self.dock = PopulationDock(studio.theme, studio.icons)
        self.display = GrainsDisplay(studio.workspace, ("slices", "grains", "avatars"), ("grains",))
        self.frame = DockFrame(
            "plots",
            tr("Plots of populations"),
            self.dock,
            "right",
            studio.icons,
            first_width=_width_of_plots,
        )
        self.docks = (self.frame,)
        self.link = PopulationLink(studio, self.work, self.panel, self.dock)

    def commands(self) -> list[Command]:
        return [
            *population_commands(self.studio.workspace, self.work, self.link, self.open_page),
            self.frame.command(
                tr("Plots of populations"),
                tr("Show or hide the plots at station Populations"),
                icon="ph.chart-bar",
                enabled=lambda: self.is_open,
            ),
        ]

    def wire(self) -> None:
        self.relay_messages(self.work)
        self.work.changed.connect(self.studio.refresh)
        self.studio.commands.bind(self.panel.measure_button, "populations.measure")
        self.studio.commands.bind(self.panel.report_button, "populations.report")
        self.studio.commands.bind(self.panel.laboratory_button, "populations.laboratory")
        self.studio.commands.bind(self.dock.save, "populations.save_figure")
        self.studio.commands.bind(self.dock.copy, "populations.copy_figure")

    def close(self) -> None:
        self.panel.close_certainty()

    def enter(self) -> None:
        if self.studio.queue.running() is None:
            self.work.measure_if_quick()

    def open_page(self, name: str) -> None:
        """Go to a plot."""
        self.studio.enter(self.id)
        self.frame.show()
        self.dock.open_page(name)
