"""Keeps plots, panel and selection in step: what is chosen in one is chosen in all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QUrl
from PySide6.QtGui import QDesktopServices, QGuiApplication, QImage

from mbstudio.core.populations import Population, size_distribution
from mbstudio.scene.figures.form_figures import sneed_folk_figure, zingg_figure
from mbstudio.scene.figures.population_figures import distribution_figure, joint_figure, sieve_figure
from mbstudio.ui.language import tr
from mbstudio.ui.stations.populations.plots import Shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mbstudio.ui.shell.main_window import MainWindow


class PopulationLink(QObject):
    """What happens at station Populations.

    Parameters
    ----------
    window : MainWindow
    """

    def __init__(self, window: MainWindow) -> None:
        super().__init__(window)
        self._window = window
        self._work, self._space = window.populations, window.workspace
        self._panel, self._dock = window.panels_populations, window.plots
        self._measured: object = None
        self._panel.shown_changed.connect(self._show)
        self._panel.measure_asked.connect(self._work.measure)
        self._panel.report_asked.connect(window.files.ask_report)
        self._dock.save_asked.connect(window.files.ask_figure)
        self._dock.copy_asked.connect(self.copy_figure)
        self._dock.brushed.connect(self._brushed)
        self._space.selection_changed.connect(self._mark)
        self._space.grains_changed.connect(self._say)
        self._work.changed.connect(self._say)
        self._say()

    def entered(self) -> None:
        """Measure what was not measured yet, when the station is entered."""
        busy = self._window.queue.running() is not None
        if not busy and self._work.measured is None:
            self._work.measure()

    # ---- in step -------------------------------------------------------------------------------

    def _show(self, shown: Shown) -> None:
        self._dock.show_populations(self._work.populations, shown)
        self._mark()

    def _mark(self) -> None:
        self._dock.mark(self._space.chosen, self._space.selected)

    def _brushed(self, labels: list[int], adding: bool) -> None:
        if adding:
            self._space.toggle(labels)
        else:
            self._space.choose(labels)

    def _say(self) -> None:
        if self._space.state.grains is None:
            words = tr("There are no grains yet.\nFind them at station Grains, then come back.")
        elif self._work.is_measuring:
            words = tr("Grains and avatars are being measured …\nPlots appear here when that is done.")
        else:
            words = tr("Press “Measure” on the left.\nPlots of the grains and their avatars appear here.")
        self._dock.say(words)

    # ---- figures and report --------------------------------------------------------------------

    def save_figure(self, path: Path) -> None:
        """Save the page that is looked at as a figure of a report."""
        messages = self._window.messages
        task = self._work.draw(self._maker(), path)
        task.succeeded.connect(
            lambda written: messages.say("success", tr("Saved the figure as {path}.", path=written))
        )

    def copy_figure(self) -> None:
        """Put the page that is looked at into the clipboard."""
        if not self._work.populations:
            return

        def take(pixels: object) -> None:
            height, width, _ = pixels.shape  # type: ignore[attr-defined]
            image = QImage(pixels.tobytes(), width, height, 3 * width, QImage.Format.Format_RGB888)  # type: ignore[attr-defined]
            QGuiApplication.clipboard().setImage(image.copy())
            self._window.messages.say("success", tr("Copied the figure to the clipboard."))

        self._work.draw(self._maker()).succeeded.connect(take)

    def write_report(self, path: Path) -> None:
        """Write the report, and offer to open it."""
        task = self._work.write_report(path, self._panel.shown.sieves or "iso")
        if task is None:
            return
        address = QUrl.fromLocalFile(str(path.resolve()))
        task.succeeded.connect(
            lambda _: self._window.messages.say(
                "success",
                tr("Wrote the report {path}.", path=path),
                tr("Open"),
                lambda: QDesktopServices.openUrl(address),
            )
        )

    def _maker(self) -> Callable[[], Figure]:
        """Return what draws the page that is looked at."""
        populations, shown, page = list(self._work.populations), self._panel.shown, self._dock.page_name
        makers: dict[str, Callable[[list[Population]], Figure]] = {
            "distribution": lambda given: distribution_figure(given, shown.factor, by=shown.by),
            "pairs": lambda given: joint_figure(given, list(dict.fromkeys((shown.factor, shown.second)))),
            "zingg": zingg_figure,
            "sneed_folk": sneed_folk_figure,
            "size": lambda given: sieve_figure([(p, size_distribution(p, shown.sieves)) for p in given]),
        }
        return lambda: makers[page](populations)
