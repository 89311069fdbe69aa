"""Keeps station Grains in step: table and histogram follow the grains and the one selection."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.grains.segmentation import SegmentationSettings
from mbstudio.core.scan.readers import SUFFIXES
from mbstudio.ui.language import tr
from mbstudio.ui.stations.grains.panel import GrainPanel
from mbstudio.ui.stations.grains.table import GrainTable
from mbstudio.ui.stations.grains.work import GrainWork
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.widgets.array_dialog import ask_which_array


class GrainLink(QObject):
    """What happens at station Grains.

    Parameters
    ----------
    studio : Studio
    view : SceneView
    work : GrainWork
    panel : GrainPanel
    table : GrainTable
    """

    def __init__(
        self, studio: Studio, view: SceneView, work: GrainWork, panel: GrainPanel, table: GrainTable
    ) -> None:
        super().__init__(studio)
        self._studio, self._view, self._work = studio, view, work
        self._panel, self._table = panel, table
        space = studio.workspace
        space.grains_changed.connect(self._show_fits)
        space.grains_changed.connect(lambda: table.content.set_grains(space.state.grains))
        space.fits_changed.connect(lambda: self._show_fits())
        space.grains_changed.connect(studio.arrange_docks)
        studio.offers.suspects_changed.connect(lambda: table.set_suspects(studio.offers.suspects))
        space.scan_changed.connect(self._scan_changed)
        space.selection_changed.connect(self._selection_changed)
        table.chosen.connect(space.choose)
        table.menu_asked.connect(studio.grain_menu.open)
        work.several.connect(lambda error, then: ask_which_array(error, then, studio.host))
        work.too_large.connect(self._ask_anyway)
        work.would_discard.connect(
            lambda why, take: studio.say("warning", why, tr("Take the new grains"), take)
        )

    def _show_fits(self) -> None:
        state = self._studio.workspace.state
        self._table.content.set_fits(state.fits, state.changed_labels)

    def _scan_changed(self) -> None:
        slices = self._view.scene.layers.slices.planes
        if slices is not None:
            self._panel.set_threshold_range(*slices.window)
        self._studio.arrange_docks()

    def _selection_changed(self) -> None:
        space = self._studio.workspace
        chosen, grains = space.selected, space.state.grains
        self._table.select_labels(space.chosen, chosen)
        diameter = None
        if grains is not None and chosen is not None:
            rows = grains.table.loc[grains.table["label"] == chosen, "volume"]
            diameter = nominal_diameter(float(rows.iloc[0]))
        self._panel.mark_grain(diameter)

    def step(self, step: int) -> None:
        """Choose the grain so many rows further in the table."""
        labels, space = self._table.labels_in_order(), self._studio.workspace
        if labels:
            chosen = space.selected
            place = labels.index(chosen) + step if chosen in labels else (0 if step > 0 else -1)
            space.select(labels[place % len(labels)])

    def _ask_anyway(self, settings: SegmentationSettings, why: str) -> None:
        """Say what the grains would take, and offer to try it all the same."""
        self._studio.say("warning", why, tr("Find anyway"), lambda: self._work.find(settings, anyway=True))

    def ask_labels(self) -> None:
        """Let the person choose a label image."""
        kinds = " ".join(f"*{suffix}" for suffix in SUFFIXES)
        name, _ = QFileDialog.getOpenFileName(
            self._studio.host,
            tr("Load labels"),
            self._studio.path_for(),
            tr("Label images ({endings});;All files (*)", endings=kinds),
        )
        if name:
            self._work.load(Path(name))
