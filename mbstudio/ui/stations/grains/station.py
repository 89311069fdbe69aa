"""Station Grains: the grains of a scan are told apart, and listed in a table."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from mbstudio.core.errors import MbstudioError
from mbstudio.core.meshes.listing import means_meshes
from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.grains.editing.commands import edit_commands
from mbstudio.ui.stations.grains.editing.grain_editing import GrainEditing
from mbstudio.ui.stations.grains.editing.slice_editing import SliceEditing
from mbstudio.ui.stations.grains.editing.tool_box import ToolBox
from mbstudio.ui.stations.grains.learning.commands import learning_commands
from mbstudio.ui.stations.grains.learning.learning_box import LearningBox
from mbstudio.ui.stations.grains.learning.preview_link import PreviewLink
from mbstudio.ui.stations.grains.learning.slice_preview import SlicePreview
from mbstudio.ui.stations.grains.learning.stroke_painting import StrokePainting
from mbstudio.ui.stations.grains.link import GrainLink
from mbstudio.ui.stations.grains.mesh_link import MeshLink
from mbstudio.ui.stations.grains.mesh_work import MeshWork
from mbstudio.ui.stations.grains.panel import GrainPanel
from mbstudio.ui.stations.grains.suspicion.card import SuspicionCard
from mbstudio.ui.stations.grains.suspicion.commands import suspicion_commands
from mbstudio.ui.stations.grains.suspicion.tour import SuspicionTour
from mbstudio.ui.stations.grains.suspicion.work import SuspicionWork
from mbstudio.ui.stations.grains.table import GrainTable
from mbstudio.ui.stations.grains.work import GrainWork
from mbstudio.ui.stations.station import Station
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.display import GrainsDisplay
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.widgets.dock_frame import DockFrame


class GrainStation(Station):
    """Finds grains, or takes labels made elsewhere."""

    id, icon, guide = "grains", "ph.polygon", "Grains"
    title, tip = mark("Grains"), mark("Find the grains")
    menu = mark("Grains")

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio, view)
        space = studio.workspace
        self.work = GrainWork(space, studio.queue, self)
        self.suspicion_work = SuspicionWork(space, studio.queue, studio.offers, self)
        self.tour = SuspicionTour(studio, self.suspicion_work)
        self.card = SuspicionCard(space, self.suspicion_work, self.tour)
        self.panel: GrainPanel = GrainPanel(space, studio.theme, self.card)
        self.table = GrainTable(studio.settings)
        self.display = GrainsDisplay(space, ("slices", "volume", "grains"), ("grains",), shows_slices=True)
        self.table_frame = DockFrame(
            "table",
            tr("Grains"),
            self.table,
            "bottom",
            studio.icons,
            is_wanted=lambda: space.state.grains is not None,
            first_height=230,
            share=580,
        )
        self.docks = (self.table_frame,)
        self.link = GrainLink(studio, view, self.work, self.panel, self.table)
        self.editing = GrainEditing(studio)
        self.tools = SliceEditing(studio, view, self.editing)
        self.tool_box = ToolBox(self.tools)
        self.panel.add_tools(self.tool_box)
        self.preview = SlicePreview(studio, view)
        self.painting = StrokePainting(studio, view, self.preview)
        self.learning_box = LearningBox(self.painting)
        self.panel.add_learning(self.learning_box)
        self.preview_link = PreviewLink(studio, self.panel, self.preview, self.painting, lambda: self.is_open)
        self.mesh_work = MeshWork(space, studio.queue, self)
        self.mesh_link = MeshLink(studio, self.mesh_work)

    def commands(self) -> list[Command]:
        space = self.studio.workspace
        return [
            *self._mesh_commands(),
            Command(
                id="grains.find",
                title=tr("Find grains"),
                run=self.find,
                menu="Grains",
                shortcut="Ctrl+G",
                icon="ph.magnifying-glass",
                tip=tr("Segment the scan into grains"),
                enabled=self._can_find,
            ),
            Command(
                id="grains.load",
                title=tr("Load labels…"),
                run=self.link.ask_labels,
                menu="Grains",
                icon="ph.folder-open",
                tip=tr("Load a label image made with another program"),
                enabled=self._can_find,
            ),
            *self._selection_commands(),
            *edit_commands(
                space,
                self.editing,
                self.tools,
                lambda: self.is_open,
                lambda: self.view.display.offers("grains"),
            ),
            *suspicion_commands(
                space,
                self.view,
                self.suspicion_work,
                self.tour,
                lambda: self.is_open,
                lambda: self.tools.can_accept,
                self.tools.accept,
            ),
            *learning_commands(
                space, self.painting, self.preview_link.preview_splitting, lambda: self.is_open
            ),
            self.table_frame.command(
                tr("Table of grains"),
                tr("Show or hide the table of grains"),
                shortcut="Ctrl+T",
                icon="ph.table",
                separated=True,
            ),
        ]

    def _selection_commands(self) -> list[Command]:
        space = self.studio.workspace
        return [
            Command(
                id="grains.next",
                title=tr("Next grain"),
                run=partial(self.link.step, 1),
                menu="Grains",
                shortcut="Ctrl+Down",
                icon="ph.caret-down",
                tip=tr("Select the next row of the table"),
                enabled=lambda: space.state.grains is not None,
                separated=True,
            ),
            Command(
                id="grains.previous",
                title=tr("Previous grain"),
                run=partial(self.link.step, -1),
                menu="Grains",
                shortcut="Ctrl+Up",
                icon="ph.caret-up",
                tip=tr("Select the row above"),
                enabled=lambda: space.state.grains is not None,
            ),
            Command(
                id="grains.unselect",
                title=tr("Clear the selection"),
                run=partial(space.select, None),
                menu="Grains",
                shortcut="Ctrl+D",
                tip=tr("Show all grains in their colours"),
                enabled=lambda: space.selected is not None,
            ),
        ]

    def _mesh_commands(self) -> list[Command]:
        return [
            Command(
                id="grains.open_meshes",
                title=tr("Open meshes…"),
                run=self.mesh_link.ask_files,
                menu="File",
                shortcut="Ctrl+Alt+O",
                icon="ph.diamond",
                tip=tr("Open the surfaces of scanned stones: STL, PLY, OBJ, OFF, 3MF or GLB, one or many"),
                separated=True,
            ),
            Command(
                id="grains.open_mesh_folder",
                title=tr("Open folder of meshes…"),
                run=self.mesh_link.ask_folder,
                menu="File",
                icon="ph.folders",
                tip=tr("Open all meshes of a folder as grains"),
            ),
        ]

    def wire(self) -> None:
        self.relay_messages(self.work, self.mesh_work, self.suspicion_work)
        self.tour.arrived.connect(lambda: self.panel.scroll_to(self.card))
        self.tour.arrived.connect(self.studio.look_at_grain)
        for button, command in (
            (self.card.look_button, "grains.look"),
            (self.card.next_button, "grains.next_suspect"),
            (self.card.back_button, "grains.previous_suspect"),
            (self.card.accept_button, "grains.accept"),
        ):
            self.studio.commands.bind(button, command)
        self.mesh_link.arrived.connect(lambda: self.studio.enter(self.id))
        self.studio.commands.bind(self.panel.meshes_button, "grains.open_meshes")
        self.studio.commands.bind(self.panel.find_button, "grains.find")
        self.studio.commands.bind(self.panel.load_button, "grains.load")
        self.tool_box.bind(self.studio.commands)
        self.tools.changed.connect(self._show_tool)
        self.studio.commands.bind(self.panel.preview_button, "grains.preview_splitting")
        self.learning_box.bind(self.studio.commands)
        self.painting.taken_up.connect(self.tools.stop)

    def open(self, paths: Sequence[Path]) -> bool:
        if not any(means_meshes(path) for path in paths):
            return False
        self.mesh_link.open(paths)
        return True

    def enter(self) -> None:
        self.panel.tell_memory()
        self.preview_link.enter()

    def leave(self) -> None:
        self.tools.stop()
        self.preview_link.leave()

    def close(self) -> None:
        for part in (self.preview, self.painting, self.preview_link):
            part.close()

    def _show_tool(self) -> None:
        if self.tools.tool:
            self.panel.scroll_to(self.tool_box)

    def _can_find(self) -> bool:
        return self.studio.workspace.scan is not None and self.studio.queue.running() is None

    def find(self) -> None:
        """Find the grains with the panel's settings."""
        self.studio.enter(self.id)
        try:
            settings = self.panel.settings()
        except MbstudioError as error:
            self.studio.say("error", str(error))
            return
        if settings.by_classifier and self.painting.is_learning:
            self.studio.say("warning", tr("The strokes are still being learned: try again in a moment."))
            return
        self.work.find(settings)
