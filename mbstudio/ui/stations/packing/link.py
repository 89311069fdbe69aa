"""Keeps view, plots and table in step with the packing: while it settles, and at rest."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.packing.packing import Packing
from mbstudio.ui.deferred_calls import DeferredCalls
from mbstudio.ui.language import tr
from mbstudio.ui.stations.packing.display import PackingDisplay
from mbstudio.ui.stations.packing.looks import Look, Looks
from mbstudio.ui.stations.packing.panel import PackingPanel
from mbstudio.ui.stations.packing.plots import PackingDock
from mbstudio.ui.stations.packing.work import PackingWork
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView


class PackingLink(QObject):
    """What happens at station Packing."""

    def __init__(
        self,
        studio: Studio,
        view: SceneView,
        display: PackingDisplay,
        work: PackingWork,
        panel: PackingPanel,
        dock: PackingDock,
    ) -> None:
        super().__init__(studio)
        self._studio, self._view, self._display = studio, view, display
        self._work, self._panel, self._dock = work, panel, dock
        self._layer = view.scene.layers.packing
        self.looks = Looks(studio.queue, view.viewport.kind, self)
        self._is_falling = False
        self._deferred = DeferredCalls(self)
        self.looks.ready.connect(self._show_look)
        panel.look_changed.connect(self.show_trial)
        panel.cut_moved.connect(self._cut)
        work.fallen.connect(self._show_falling)
        work.changed.connect(self._work_changed)
        studio.workspace.packing_changed.connect(self.show_trial)
        self._say_empty()

    @property
    def packing(self) -> Packing | None:
        """The packing that is shown at rest."""
        trial = self._work.trial
        if trial is None:
            return None
        return trial.packings.get(self._panel.kind_shown, trial.first)

    def entered(self) -> None:
        """Show the packing of the project, in the room that the plots leave."""
        self.show_trial()
        if self._display.content is not None:
            self._deferred.call(self._view.fit_view)

    def left(self) -> None:
        """Give the scene back the unit of what the other stations show."""
        self._view.take_unit()

    def show_trial(self) -> None:
        """Have the packing at rest shown; while others settle they are."""
        trial, packing = self._work.trial, self.packing
        if self._work.falling is not None:
            return
        if trial is None or packing is None:
            self._layer.set(None)
            self._display.content = None
            self._say_empty()
            self._arrange()
            return
        if self.looks.known(packing, trial.inset) is None:
            self._dock.say(tr("The packing is being measured …"))
        self.looks.ask(packing, trial.inset)

    def _show_look(self, look: Look) -> None:
        trial = self._work.trial
        if look.packing is not self.packing or trial is None or self._work.falling is not None:
            return
        by = self._panel.colour_by
        self._show_surface(look.surface(by), look.packing.unit, look.packing)
        self._panel.show_ends(by, *look.ends(by), look.packing.unit)
        self._dock.show_packing(look.findings, look.reason, trial.comparison)

    def _show_falling(self) -> None:
        falling = self._work.falling
        if falling is None:
            return
        if not self._is_falling:
            self._is_falling = True
            self._dock.say(tr("Grains settle …\nPlots appear here once they are at rest."))
        kinds = falling.forms.kinds
        sizes = kinds.diameters[[kind for kind, _, _ in falling.forms.blocks]]
        self._panel.show_ends("size", float(sizes.min()), float(sizes.max()), kinds.unit)
        self._show_surface(falling, falling.forms.kinds.unit, falling.forms)

    def _show_surface(self, surface: object, unit: str, what: object) -> None:
        self._layer.set(surface, unit if self._is_open else None)  # type: ignore[arg-type]  # PackedGrains
        if self._display.content is not what:
            self._display.content = what
            self._arrange()
        elif self._is_open:
            self._view.draw()

    def _work_changed(self) -> None:
        if self._is_falling and self._work.falling is None:
            self._is_falling = False
            self.show_trial()
        elif self._work.trial is None and self._work.falling is None:
            self._say_empty()

    def _say_empty(self) -> None:
        if self._work.run.is_running:
            self._dock.say(tr("Spheres are fitted to the grains …\nThen they fall, and can be watched."))
        else:
            self._dock.say(tr("Press “Pack” on the left.\nPlots of the packing appear here."))

    def _cut(self, share: float) -> None:
        self._layer.set_cut(share)
        self._view.draw()

    @property
    def _is_open(self) -> bool:
        return self._view.display is self._display

    def _arrange(self) -> None:
        if self._is_open:
            self._view.arrange()

    # ---- files -----------------------------------------------------------------------------------

    def ask_export(self) -> None:
        """Ask for a folder and write the packing that is shown into it."""
        name = QFileDialog.getExistingDirectory(
            self._studio.host, tr("Folder for the packing"), self._studio.path_for()
        )
        if name:
            self.export(Path(name))

    def export(self, folder: Path) -> None:
        """Write the packing that is shown into a folder."""
        trial, packing = self._work.trial, self.packing
        if trial is None or packing is None:
            return
        task = self._work.export(packing, folder, trial.inset)
        task.succeeded.connect(
            lambda written: self._studio.say(
                "success", tr("Wrote the packing into {folder}.", folder=written)
            )
        )
