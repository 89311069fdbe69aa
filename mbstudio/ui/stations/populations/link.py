"""Keeps plots, panel and selection in step: what is chosen in one is chosen in all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QObject, QUrl
from PySide6.QtGui import QDesktopServices, QGuiApplication, QImage
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.errors import MbstudioError
from mbstudio.core.populations import (
    LaboratoryCurve,
    Population,
    border_weights,
    read_laboratory_table,
    size_distribution,
)
from mbstudio.scene.figures.form_figures import sneed_folk_figure, zingg_figure
from mbstudio.scene.figures.population_figures import distribution_figure, joint_figure, sieve_figure
from mbstudio.ui.figure_files import FIGURE_FILTER, draw_figure, fault_of_figure, figure_path
from mbstudio.ui.language import tr
from mbstudio.ui.stations.populations.dock import PopulationDock
from mbstudio.ui.stations.populations.panel import PopulationPanel
from mbstudio.ui.stations.populations.plots import Shown
from mbstudio.ui.stations.populations.pores import PoreWork
from mbstudio.ui.stations.populations.work import PopulationWork
from mbstudio.ui.studio import Studio

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class PopulationLink(QObject):
    """What happens at station Populations.

    Parameters
    ----------
    studio : Studio
    work : PopulationWork
    panel : PopulationPanel
    dock : PopulationDock
    """

    def __init__(
        self, studio: Studio, work: PopulationWork, panel: PopulationPanel, dock: PopulationDock
    ) -> None:
        super().__init__(studio)
        self._studio, self._space = studio, studio.workspace
        self._work, self._panel, self._dock = work, panel, dock
        self._tables: list[LaboratoryCurve] = []
        self.pores = PoreWork(studio, work)
        self._panel.shown_changed.connect(self._show)
        self._panel.certainty_changed.connect(self._show_certainty)
        self._dock.brushed.connect(self._brushed)
        self._dock.menu_asked.connect(studio.grain_menu.open)
        self._space.selection_changed.connect(self._mark)
        self._space.grains_changed.connect(self._say)
        self._work.changed.connect(self._say)
        self._say()

    # ---- in step -------------------------------------------------------------------------------

    def _show(self, shown: Shown) -> None:
        self._dock.show_populations(
            self._work.shown, shown, self._work.is_growing, self._tables, self._counts(shown)
        )
        self._mark()

    def _show_certainty(self, shown: Shown) -> None:
        self._dock.show_certainty(shown)

    def _counts(self, shown: Shown) -> dict[int, np.ndarray]:
        """Return how many grains each stands for, where curves are corrected for the border."""
        grains = self._space.state.grains
        if not shown.border or grains is None or self._work.is_growing:
            return {}
        counts = {}
        for population in self._work.shown:
            if population.kind == "clones":
                continue
            try:
                counts[id(population)] = border_weights(grains, population.labels.tolist())
            except MbstudioError as error:
                self._studio.say("warning", str(error))
                return {}
        return counts

    # ---- tables of laboratories ------------------------------------------------------------------

    def ask_laboratory(self) -> None:
        """Ask for a table of a sieve analysis, and draw it beside the curves."""
        name, _ = QFileDialog.getOpenFileName(
            self._studio.host,
            tr("Laboratory table"),
            self._studio.path_for(""),
            tr("Tables (*.csv *.txt *.tsv);;All files (*)"),
        )
        if name:
            self.add_laboratory(Path(name))

    def add_laboratory(self, path: Path) -> None:
        """Draw a table of a sieve analysis beside the curves, or say why not."""
        try:
            table = read_laboratory_table(path)
        except MbstudioError as error:
            self._studio.say("error", str(error))
            return
        self._tables = [one for one in self._tables if one.name != table.name] + [table]
        self._dock.open_page("size")
        self._show(self._panel.shown)

    def remove_laboratory(self) -> None:
        """Show no tables of laboratories any more."""
        self._tables = []
        self._show(self._panel.shown)

    @property
    def has_laboratory(self) -> bool:
        """Whether tables of laboratories are shown."""
        return bool(self._tables)

    def _mark(self) -> None:
        self._dock.mark(self._space.chosen, self._space.selected)

    def _brushed(self, labels: list[int], adding: bool) -> None:
        if adding:
            self._space.toggle(labels)
        else:
            self._space.choose(labels)

    def measure_chosen(self) -> None:
        """Measure the chosen grains alone, and show their plots."""
        self._studio.enter("populations")
        self._panel.choose_scope("chosen")
        if not self._work.is_current:
            self._work.measure()

    def _say(self) -> None:
        if self._space.state.grains is None:
            words = tr("There are no grains yet.\nFind them at station Grains, then come back.")
        elif self._work.run.is_running:
            words = tr("Grains and avatars are being measured …\nPlots appear here and fill as it goes on.")
        else:
            words = tr("Press “Measure” on the left.\nPlots of the grains and their avatars appear here.")
        self._dock.say(words)

    # ---- figures and report --------------------------------------------------------------------

    def ask_figure(self) -> None:
        """Ask for a file and save the plot that is looked at to it."""
        name, kind = QFileDialog.getSaveFileName(
            self._studio.host,
            tr("Save figure"),
            self._studio.path_for(f"{self._dock.page_name}.svg"),
            tr(FIGURE_FILTER),
        )
        if name:
            self.save_figure(Path(name), kind)

    def save_figure(self, path: Path, kind: str = "") -> None:
        """Save the plot that is looked at as a figure of a report: SVG, PNG or PDF by its ending."""
        path, studio = figure_path(path, kind), self._studio
        fault = fault_of_figure(path)
        if fault:
            studio.say("error", fault)
            return
        task = draw_figure(studio.queue, self._maker(), path)
        task.succeeded.connect(
            lambda written: studio.say("success", tr("Saved the figure as {path}.", path=written))
        )

    def copy_figure(self) -> None:
        """Put the page that is looked at into the clipboard."""
        if not self._work.populations:
            return

        def copy(pixels: object) -> None:
            height, width, _ = pixels.shape  # type: ignore[attr-defined]
            image = QImage(pixels.tobytes(), width, height, 3 * width, QImage.Format.Format_RGB888)  # type: ignore[attr-defined]
            QGuiApplication.clipboard().setImage(image.copy())
            self._studio.say("success", tr("Copied the figure to the clipboard."))

        draw_figure(self._studio.queue, self._maker()).succeeded.connect(copy)

    def ask_report(self) -> None:
        """Ask for a file and write the report on the populations to it."""
        path = self._space.project.path
        name, _ = QFileDialog.getSaveFileName(
            self._studio.host,
            tr("Write report"),
            self._studio.path_for(f"{path.stem}.html" if path else "report.html"),
            tr("HTML page (*.html);;PDF (*.pdf);;JSON (*.json)"),
        )
        if name:
            chosen = Path(name)
            self.write_report(chosen if chosen.suffix else chosen.with_suffix(".html"))

    def write_report(self, path: Path) -> None:
        """Write the report, and offer to open it."""
        shown = self._panel.shown
        task = self._work.write_report(path, shown.sieves or "iso", tables=self._tables, border=shown.border)
        if task is None:
            return
        address = QUrl.fromLocalFile(str(path.resolve()))
        task.succeeded.connect(
            lambda _: self._studio.say(
                "success",
                tr("Wrote the report {path}.", path=path),
                tr("Open"),
                lambda: QDesktopServices.openUrl(address),
            )
        )

    def ask_certificate(self) -> None:
        """Ask for a file and write the certificate of the sample to it."""
        path = self._space.project.path
        name, _ = QFileDialog.getSaveFileName(
            self._studio.host,
            tr("Write certificate"),
            self._studio.path_for(f"{path.stem}-certificate.pdf" if path else "certificate.pdf"),
            tr("PDF (*.pdf)"),
        )
        if name:
            self.write_certificate(Path(name).with_suffix(".pdf"))

    def write_certificate(self, path: Path) -> None:
        """Write the certificate, and offer to open it."""
        task = self._work.write_certificate(path, tables=self._tables, border=self._panel.shown.border)
        if task is None:
            return
        address = QUrl.fromLocalFile(str(path.resolve()))
        task.succeeded.connect(
            lambda _: self._studio.say(
                "success",
                tr("Wrote the certificate {path}.", path=path),
                tr("Open"),
                lambda: QDesktopServices.openUrl(address),
            )
        )

    def _maker(self) -> Callable[[], Figure]:
        """Return what draws the page that is looked at."""
        populations, shown, page = list(self._work.populations), self._panel.shown, self._dock.page_name
        counts, tables = self._counts(shown), list(self._tables)
        makers: dict[str, Callable[[list[Population]], Figure]] = {
            "distribution": lambda given: distribution_figure(given, shown.factor, by=shown.by, bands=True),
            "pairs": lambda given: joint_figure(given, list(dict.fromkeys((shown.factor, shown.second)))),
            "zingg": zingg_figure,
            "sneed_folk": sneed_folk_figure,
            "size": lambda given: sieve_figure(
                [(p, size_distribution(p, shown.sieves, counts=counts.get(id(p)))) for p in given],
                laboratory=tables,
                bands=not counts,
            ),
        }
        return lambda: makers[page](populations)
