"""Porosity of the specimen at station Populations: measured in the background, told and drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.errors import MeasureError
from mbstudio.core.porosity import (
    PorosityProfile,
    RepresentativeVolume,
    SizeProfile,
    porosity_profiles,
    representative_volume,
    size_profiles,
)
from mbstudio.core.units import unit_label
from mbstudio.scene.figures.specimen_figure import specimen_figure
from mbstudio.ui.figure_files import FIGURE_FILTER, draw_figure, fault_of_figure, figure_path
from mbstudio.ui.language import tr
from mbstudio.ui.stations.populations.work import PopulationWork
from mbstudio.ui.studio import Studio
from mbstudio.ui.workers import Task


@dataclass(frozen=True, eq=False)
class Pores:
    """Porosity along the axes, of growing boxes, and where which sizes lie."""

    profiles: Mapping[str, PorosityProfile]
    boxes: RepresentativeVolume | None
    sizes: Mapping[str, SizeProfile]


class PoreWork(QObject):
    """Measures the porosity of the segmented specimen.

    Attributes
    ----------
    found : Pores or None
        What was measured last.
    """

    def __init__(self, studio: Studio, work: PopulationWork) -> None:
        super().__init__(studio)
        self._studio, self._work = studio, work
        self.found: Pores | None = None

    @property
    def has_specimen(self) -> bool:
        """Whether there is a scan with grains."""
        grains = self._studio.workspace.state.grains
        return grains is not None and not grains.is_of_meshes

    def measure(self) -> None:
        """Measure porosity, representative volume and the arrangement of sizes, and tell them."""
        grains = self._studio.workspace.state.grains
        population = next((p for p in self._work.populations if p.kind == "grains"), None)
        if grains is None or not self.has_specimen:
            return

        def work(control: object) -> Pores:
            boxes, sizes = None, {}
            try:
                boxes = representative_volume(grains)
            except MeasureError:  # too small for boxes: the porosity of the whole is still known
                boxes = None
            if population is not None:
                try:
                    sizes = size_profiles(population, grains)
                except MeasureError:  # fewer than ten grains were measured
                    sizes = {}
            return Pores(porosity_profiles(grains), boxes, sizes)

        task = Task(tr("Measuring the porosity"), work)
        task.succeeded.connect(self._tell)
        self._studio.queue.submit(task)

    def _tell(self, found: Pores) -> None:
        self.found = found
        mean, boxes = found.profiles["z"].mean, found.boxes
        ratio = f"{mean / (1 - mean):.3f}" if mean < 1 else "–"
        if boxes is None or boxes.edge is None:
            box = tr("No box of the scan is representative.")
        else:
            edge = f"{boxes.edge:.3g} {unit_label(boxes.unit)}"
            box = tr("Boxes are representative from an edge of {edge} on.", edge=edge)
        text = tr("Porosity {porosity:.3f}, void ratio {ratio}. {box}", porosity=mean, ratio=ratio, box=box)
        self._studio.say("success", text, tr("Save figure…"), self.ask_figure)

    def ask_figure(self) -> None:
        """Ask for a file and save profiles, boxes and sizes as a figure."""
        name, kind = QFileDialog.getSaveFileName(
            self._studio.host, tr("Save figure"), self._studio.path_for("specimen.svg"), tr(FIGURE_FILTER)
        )
        if name:
            self.save_figure(Path(name), kind)

    def save_figure(self, path: Path, kind: str = "") -> None:
        """Save what was measured last as a figure: SVG, PNG or PDF by its ending."""
        found, path = self.found, figure_path(path, kind)
        fault = fault_of_figure(path)
        if fault or found is None:
            self._studio.say("error", fault or tr("Measure the porosity first."))
            return
        task = draw_figure(
            self._studio.queue, lambda: specimen_figure(found.profiles, found.boxes, found.sizes), path
        )
        task.succeeded.connect(
            lambda written: self._studio.say("success", tr("Saved the figure as {path}.", path=written))
        )
