"""Keeps view, slices and files in step with the twin."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.errors import TwinError
from mbstudio.core.twin.contact_files import ENDINGS, write_contacts
from mbstudio.core.twin.kept_twin import KeptTwin
from mbstudio.scene.layers.contact_network import network_of
from mbstudio.ui.figure_files import FIGURE_FILTER, draw_figure, fault_of_figure, figure_path
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.fit.twin.dock import TwinDock
from mbstudio.ui.stations.fit.twin.residual_tint import residual_tint
from mbstudio.ui.stations.fit.twin.work import TwinWork
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.workers import Task

_FILTER = mark("CSV table (*.csv);;ParaView network (*.vtu);;Graph (*.graphml)")


class TwinLink(QObject):
    """What the twin does in the window.

    Parameters
    ----------
    studio : Studio
    view : SceneView
    work : TwinWork
    dock : TwinDock
    is_open : callable
        Whether the station is open and the twin is looked at: slices are tinted then.
    """

    def __init__(
        self, studio: Studio, view: SceneView, work: TwinWork, dock: TwinDock, is_open: Callable[[], bool]
    ) -> None:
        super().__init__(studio)
        self._studio, self._view, self._space = studio, view, studio.workspace
        self._work, self._dock, self._is_open = work, dock, is_open
        self._shown: object = None
        self._drawn: object = None
        self._tints = False
        work.moved.connect(self.tint)
        work.finished.connect(self._show_network)
        view.slices_changed.connect(self.tint)
        view.arranged.connect(self._bring_network)
        self._space.state_changed.connect(self._state_changed)
        dock.residual_switched.connect(lambda _: self.tint())
        dock.measure_changed.connect(lambda _: self._bring_network())
        dock.page_turned.connect(self.draw_fabric)
        dock.table.chosen.connect(self._look_at)
        studio.theme.changed.connect(self.draw_fabric)

    def tint(self) -> None:
        """Lay the residual over the slices, or take it away."""
        planes = self._view.scene.layers.slices.planes
        wanted = self._is_open() and self._dock.residual.isChecked() and planes is not None
        tints = {}
        if wanted and planes is not None and self._work.has_residual:
            for axis, index in planes.index.items():
                found = self._work.residual_slice("zyx".index(axis), index)
                if found is not None:
                    tints[axis] = residual_tint(found)
        if tints or self._tints:
            self._tints = bool(tints)
            self._view.tint(tints)

    def _state_changed(self) -> None:
        self._bring_network()
        self.draw_fabric()

    def _bring_network(self) -> None:
        """Give the view the network of the present twin where it is shown; no work where it is not."""
        twin, measure = self._space.state.twin, self._dock.chosen_measure
        wanted = (twin, measure) if twin is not None and self._view.is_shown("network") else None
        if wanted == self._shown:
            return
        self._shown = wanted
        layer = self._view.scene.layers.network
        layer.set(None if wanted is None else network_of(wanted[0], wanted[1]))
        self._view.draw()

    def _show_network(self) -> None:
        """Show what was found, if the person still looks at the twin."""
        if self._is_open():
            self._view.show_layer("network", True)
            self._studio.commands.outdate()

    def _look_at(self, a: int, b: int, place: np.ndarray) -> None:
        """Choose a pair and bring where it touches into view and slices."""
        self._space.choose([a, b])
        planes = self._view.scene.layers.slices.planes
        if planes is not None:
            x, y, z = planes.voxel_at(place)
            self._view.move_slices({"x": x, "y": y, "z": z})
        self._view.centre(place)

    def draw_fabric(self) -> None:
        """Draw the page of the fabric, if it is looked at and shows another twin or theme."""
        twin = self._space.state.twin
        theme = self._studio.theme.scene
        if twin is None or not self._dock.shows_fabric or not self._is_open():
            return
        if (twin, theme) == self._drawn:
            return
        self._drawn = (twin, theme)
        if not len(twin.touching):
            self._dock.picture.show_pixels(None)
            return
        # Imported late: matplotlib takes half a second.
        from mbstudio.scene.figures.fabric_figure import fabric_figure

        task = draw_figure(self._studio.queue, lambda: fabric_figure(twin, theme, is_small=True))
        task.succeeded.connect(lambda pixels: self._take_figure(twin, pixels))

    def _take_figure(self, twin: KeptTwin, pixels: np.ndarray) -> None:
        if twin is self._space.state.twin:
            self._dock.picture.show_pixels(pixels)

    # ---- files -----------------------------------------------------------------------------------

    def ask_export(self) -> None:
        """Ask for a file and write the contacts to it."""
        path = self._space.project.path
        name, kind = QFileDialog.getSaveFileName(
            self._studio.host,
            tr("Export contacts"),
            self._studio.path_for(f"{path.stem}-contacts.csv" if path else "contacts.csv"),
            tr(_FILTER),
        )
        if name:
            chosen = Path(name)
            ending = next((end for end in ENDINGS if end in kind), ".csv")
            self.export(chosen if chosen.suffix else chosen.with_suffix(ending))

    def export(self, path: Path) -> Task | None:
        """Write the contacts: a table with all pairs (CSV), or the network of the contacts (VTU, GraphML)."""
        twin = self._space.state.twin
        if twin is None:
            return None
        if path.suffix.lower() not in ENDINGS:
            told = tr("{path} has no ending of a file of contacts. Use {endings}.", path=path,
                      endings=", ".join(ENDINGS))  # fmt: skip
            self._studio.say("error", told)
            return None
        task = Task(tr("Exporting contacts"), lambda _: write_contacts(path, twin))
        task.succeeded.connect(
            lambda written: self._studio.say("success", tr("Wrote the contacts to {path}.", path=written))
        )
        return self._studio.queue.submit(task)

    def ask_figure(self) -> None:
        """Ask for a file and save the figure of the fabric to it."""
        name, kind = QFileDialog.getSaveFileName(
            self._studio.host, tr("Save figure"), self._studio.path_for("fabric.svg"), tr(FIGURE_FILTER)
        )
        if name:
            self.save_figure(figure_path(name, kind))

    def save_figure(self, path: Path) -> None:
        """Save the figure of the fabric: SVG, PNG or PDF by its ending."""
        twin, studio = self._space.state.twin, self._studio
        fault = fault_of_figure(path)
        if fault or twin is None:
            studio.say("error", fault or tr("There is no twin."))
            return
        if not len(twin.touching):
            studio.say("error", str(TwinError("There is no contact: a fabric needs one or more.")))
            return
        from mbstudio.scene.figures.fabric_figure import fabric_figure

        task = draw_figure(studio.queue, lambda: fabric_figure(twin), path)
        task.succeeded.connect(
            lambda written: studio.say("success", tr("Saved the figure as {path}.", path=written))
        )
