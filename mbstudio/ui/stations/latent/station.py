"""Station Latent: grains are shaped by hand in the latent space of a style-learner."""

from __future__ import annotations

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.latent.commands import latent_commands
from mbstudio.ui.stations.latent.dock import LatentDock
from mbstudio.ui.stations.latent.link import LatentLink
from mbstudio.ui.stations.latent.panel import LatentPanel
from mbstudio.ui.stations.latent.shelf import Shelf
from mbstudio.ui.stations.latent.surface_commands import surface_commands
from mbstudio.ui.stations.latent.surface_dock import SurfaceDock
from mbstudio.ui.stations.latent.surface_link import SurfaceLink
from mbstudio.ui.stations.latent.surface_work import SurfaceWork
from mbstudio.ui.stations.latent.work import LatentWork
from mbstudio.ui.stations.station import Station, UndoHistory
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.display import Display
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.widgets.dock_frame import DockFrame
from mbstudio.ui.workspace import Workspace


class LatentDisplay(Display):
    """The grain under the hand, with A and B as ghosts about it."""

    def __init__(self, workspace: Workspace, work: LatentWork, surface_work: SurfaceWork) -> None:
        super().__init__(workspace, ("live", "ghost_a", "ghost_b"), ("live",), own_space=True)
        self._work, self._surface_work = work, surface_work

    @property
    def has_content(self) -> bool:
        shaped = self._work.learner is not None or self._surface_work.style is not None
        return shaped or super().has_content

    @property
    def shows_tray(self) -> bool:
        return False


class LatentStation(Station):
    """Shapes grains with sliders, keeps them, and blends them."""

    id, icon, guide = "latent", "ph.sliders-horizontal", "Latent studio"
    title, tip = mark("Latent"), mark("Shape grains by hand")
    menu = mark("Latent")

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio, view)
        self.work = LatentWork(studio.workspace, studio.queue, self)
        self.surface_work = SurfaceWork(studio.workspace, studio.queue, self)
        self.panel: LatentPanel = LatentPanel(self.work, self.surface_work, studio.icons)
        self.dock = LatentDock(studio.theme, studio.icons)
        self.shelf = Shelf(studio.icons)
        self.surface_dock = SurfaceDock(self.surface_work, studio.theme)
        self.display = LatentDisplay(studio.workspace, self.work, self.surface_work)

        def has_learner() -> bool:
            return self.work.learner is not None

        self.docks = (
            DockFrame(
                "latent",
                tr("Latent studio"),
                self.dock,
                "right",
                is_wanted=has_learner,
                first_width=lambda width: max(400, width // 3),
            ),
            DockFrame("shelf", tr("Shelf"), self.shelf, "bottom", is_wanted=has_learner),
            DockFrame(
                "surface_studio",
                tr("Map and design"),
                self.surface_dock,
                "right",
                is_wanted=lambda: self.surface_work.style is not None,
                first_width=lambda width: max(360, width // 3),
            ),
        )
        self.link = LatentLink(self, studio, view, self.work, self.panel, self.dock, self.shelf)
        self.surface_link = SurfaceLink(self, studio, view, self.surface_work, self.panel.surfaces)

    def commands(self) -> list[Command]:
        return [
            *latent_commands(self.studio, self.work, self.link, self.panel, self.dock, self.shelf),
            *surface_commands(self.studio, self.surface_work, self.panel.surfaces),
        ]

    def wire(self) -> None:
        self.relay_messages(self.work, self.surface_work)
        for signal in (
            self.work.stepped, self.work.kept_changed, self.work.style_taken, self.surface_work.stepped,
            self.surface_work.style_taken,
        ):  # fmt: skip
            signal.connect(self.studio.refresh)
        shaped = self.panel.surfaces
        self.dock.blend.changed.connect(self.studio.commands.refresh)
        for button, command in (
            (self.panel.undo, "edit.undo"),
            (self.panel.redo, "edit.redo"),
            (self.panel.open_button, "style.open"),
            (self.panel.style_button, "station.style"),
            (self.panel.reset, "latent.reset"),
            (self.panel.keep, "latent.keep"),
            (self.panel.alike, "latent.alike"),
            (self.panel.another, "latent.another"),
            (self.panel.randomise, "latent.randomise"),
            (self.dock.blend.play, "latent.play"),
            (self.dock.blend.animation, "latent.animation"),
            (self.dock.blend.apply, "latent.add"),
            (shaped.undo, "edit.undo"),
            (shaped.redo, "edit.redo"),
            (shaped.reset, "latent.reset_surface"),
            (shaped.keep, "latent.keep_surface"),
            (shaped.another, "latent.another_warp"),
            (shaped.randomise, "latent.draw_surface"),
            (self.shelf.rename, "latent.rename"),
            (self.shelf.remove, "latent.remove"),
        ):
            self.studio.commands.bind(button, command)

    def enter(self) -> None:
        self.link.entered()
        self.surface_link.entered()

    def leave(self) -> None:
        self.link.left()

    @property
    def history(self) -> UndoHistory | None:
        if self.surface_work.style is not None:
            return self.surface_work
        return self.work if self.work.learner is not None else None

    def close(self) -> None:
        self.work.close()
        self.surface_work.close()
