"""The window: rail and panels on the left, the view in the middle, table and curve below."""

from __future__ import annotations

import logging

from PySide6.QtCore import QSettings
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import QLabel

from mbstudio.core.errors import MbstudioError
from mbstudio.scene import switched_layers
from mbstudio.ui.commands import CommandTable
from mbstudio.ui.icons import Icons, application_icon
from mbstudio.ui.language import tr
from mbstudio.ui.shell.dialogs.command_palette import CommandPalette
from mbstudio.ui.shell.file_actions import FileActions
from mbstudio.ui.shell.message_bar import MessageBar
from mbstudio.ui.shell.project_work import ProjectWork
from mbstudio.ui.shell.shell_link import ShellLink
from mbstudio.ui.shell.task_strip import TaskStrip
from mbstudio.ui.shell.window_commands import window_commands
from mbstudio.ui.shell.window_layout import WindowLayout
from mbstudio.ui.shell.window_wiring import WindowWiring
from mbstudio.ui.stations.export.link import ExportLink
from mbstudio.ui.stations.export.work import ExportWork
from mbstudio.ui.stations.fit.sweep_work import SweepWork
from mbstudio.ui.stations.fit.work import FitWork, IntervalWork
from mbstudio.ui.stations.grains.work import GrainWork
from mbstudio.ui.stations.latent.link import LatentLink
from mbstudio.ui.stations.latent.work import LatentWork
from mbstudio.ui.stations.populations.link import PopulationLink
from mbstudio.ui.stations.populations.work import PopulationWork
from mbstudio.ui.stations.scan.work import ScanWork
from mbstudio.ui.stations.station_layers import STATION_LAYERS
from mbstudio.ui.stations.style.clone_work import CloneWork
from mbstudio.ui.stations.style.link import StyleLink
from mbstudio.ui.stations.style.work import StyleWork
from mbstudio.ui.theme import Theme
from mbstudio.ui.view.compare_link import CompareLink
from mbstudio.ui.view.picture_link import PictureLink
from mbstudio.ui.view.slice_link import SliceLink
from mbstudio.ui.view.view_link import ViewLink
from mbstudio.ui.view.view_tools import ViewTools
from mbstudio.ui.view.viewport import make_viewport
from mbstudio.ui.workers import Task, TaskQueue
from mbstudio.ui.workspace import Workspace

log = logging.getLogger(__name__)


class MainWindow(WindowLayout):
    """Everything that the person sees.

    Attributes
    ----------
    ask_before_closing : bool
        Whether closing with unsaved changes asks; tests switch it off.
    """

    def __init__(self, settings: QSettings, theme: Theme) -> None:
        super().__init__()
        self.settings, self.theme = settings, theme
        self.ask_before_closing = True
        self.icons = Icons(theme, self)
        self.workspace = Workspace(settings, self)
        self.queue = TaskQueue(self)
        self.scans = ScanWork(self.workspace, self.queue, self)
        self.grains = GrainWork(self.workspace, self.queue, self)
        self.fits = FitWork(self.workspace, self.queue, self)
        self.intervals = IntervalWork(self.workspace, self.queue, self)
        self.populations = PopulationWork(self.workspace, self.queue, self)
        self.sweeps = SweepWork(self.workspace, self.queue, self)
        self.styles = StyleWork(self.workspace, self.queue, self)
        self.clones = CloneWork(self.workspace, self.queue, self)
        self.latents = LatentWork(self.workspace, self.queue, self)
        self.exports = ExportWork(self.workspace, self.queue, self)
        self.projects = ProjectWork(self.workspace, self.queue, self)
        self.messages = MessageBar(self.icons)
        self.viewport = make_viewport()
        self.link = ViewLink(self.workspace, self.fits, self.queue, self.viewport, theme, self)
        self.files = FileActions(self)
        self.station = "scan"
        self._whole_fit: Task | None = None
        self._closing = False
        self.setWindowIcon(application_icon())
        self.setAcceptDrops(True)
        self.setMinimumSize(900, 600)
        self._make_panels()
        self._make_docks()
        self.brushing = PopulationLink(self)
        self.style_link = StyleLink(self)
        self.shaping = LatentLink(self)
        self.slicing = SliceLink(self)
        self.tools = ViewTools(self)
        self.shell = ShellLink(self)
        self.exporting = ExportLink(self)
        self.comparing = CompareLink(self)
        self.pictures = PictureLink(self)
        self.commands = CommandTable(window_commands(self), self.icons, self)
        self._make_centre()
        self._make_menus()
        self.palette_box = CommandPalette(self.commands, self)
        self.strip = TaskStrip(self.queue, self.icons)
        self._renderer = QLabel(tr("OpenGL view") if self.viewport.kind == "OpenGL" else tr("software view"))
        self._renderer.setToolTip(tr("How the 3-D view is drawn"))
        self.statusBar().addPermanentWidget(self.strip)
        self.statusBar().addPermanentWidget(self._renderer)
        self.statusBar().setSizeGripEnabled(False)
        self.wiring = WindowWiring(self)
        self._restore_layout()
        self.shell.connect_all()
        self._pages.setFocus()
        self.enter("scan")
        self.refresh()

    # ---- what the conditions of commands ask -----------------------------------------------------

    @property
    def has_view(self) -> bool:
        """Whether there is something in the 3-D view."""
        state = self.workspace.state
        shaping = self.station == "latent" and self.latents.learner is not None
        there = self.workspace.scan is not None or state.grains is not None or state.clones is not None
        return shaping or there

    @property
    def may_find_grains(self) -> bool:
        return self.workspace.scan is not None and self.queue.running() is None

    @property
    def is_fitting_all(self) -> bool:
        return self._whole_fit is not None and not self._whole_fit.is_over

    def refresh(self) -> None:
        """Bring commands, buttons and the title up to date."""
        if self._closing:
            return
        self.commands.refresh()
        undone, redone = self.shaping.history()
        undo = tr("Undo: {change}", change=undone) if undone else tr("Undo")
        redo = tr("Redo: {change}", change=redone) if redone else tr("Redo")
        self.commands.action("edit.undo").setText(undo)
        self.commands.action("edit.redo").setText(redo)
        for button, command in (
            (self.panels_grains.find_button, "grains.find"),
            (self.panels_grains.load_button, "grains.load"),
            (self.panels_fit.fit_button, "fit.grain"),
            (self.panels_fit.all_button, "fit.all"),
        ):
            button.setEnabled(self.commands.action(command).isEnabled())
        self._pages.setCurrentIndex(1 if self.has_view else 0)
        self.setWindowTitle(tr("{project}[*] – MetaBall Studio", project=self.workspace.title))
        self.setWindowModified(self.workspace.is_modified)

    # ---- commands: work --------------------------------------------------------------------------

    def find_grains(self) -> None:
        """Find the grains with the panel's settings."""
        self.enter("grains")
        try:
            settings = self.panels_grains.settings()
        except MbstudioError as error:
            self.messages.say("error", str(error))
            return
        self.grains.find(settings)

    def fit_grain(self) -> None:
        """Fit the chosen grain."""
        if self.workspace.selected is not None and self.panels_fit.take_target():
            self.enter("fit")
            self.fits.fit(self.workspace.selected)

    def fit_all(self) -> None:
        """Fit every grain inside the scan without an avatar."""
        self.enter("fit")
        if self.panels_fit.take_target():
            self._whole_fit = self.fits.fit_all()

    def switch_intervals(self) -> None:
        """Show between what the factors of the chosen grain lie, or its factors again."""
        label = self.workspace.selected
        if label is None:
            return
        if self.panels_fit.factors.has_intervals:
            self.panels_fit.show_intervals(label, None)
        else:
            self.intervals.find(label)

    def use_n(self, n: int) -> None:
        """Fit with this number from now on; a target would look for another."""
        self.workspace.change_fit_settings(n=n, target="")
        self.messages.say("success", tr("The next fits are made with n = {n}.", n=n))

    def more_generations(self) -> None:
        """Let the last fit go on."""
        self.fits.go_on(self.panels_fit.more.value(), self.panels_fit.n.value())

    def export(self) -> None:
        """Export as the panel says."""
        if self.panels_export.folder_path is not None:
            self.enter("export")
            self.panels_export.start(self.exports)

    def undo(self) -> None:
        """Take the last change back."""
        self.shaping.undo()

    def redo(self) -> None:
        """Make it again."""
        self.shaping.redo()

    def cancel_task(self) -> None:
        """Cancel what the status bar shows."""
        task = self.queue.running()
        if task is not None:
            task.cancel()

    def step_grain(self, step: int) -> None:
        """Choose the grain so many rows further in the table."""
        labels = self.table.labels_in_order()
        if labels:
            chosen = self.workspace.selected
            place = labels.index(chosen) + step if chosen in labels else (0 if step > 0 else -1)
            self.workspace.select(labels[place % len(labels)])

    # ---- commands: window ------------------------------------------------------------------------

    def enter(self, station: str) -> None:
        """Go to a station."""
        before, self.station = self.station, station
        self.rail.show_chosen(station)
        self._stack.setCurrentWidget(self.panels[station])
        self.link.enter(station)
        self.show_docks()
        if station == "populations":
            self.brushing.entered()
        if station == "style":
            self.style_link.entered()
        if "export" in (before, station):
            self.exporting.entered() if station == "export" else self.exporting.left()
        if "latent" in (before, station):
            self.shaping.entered() if station == "latent" else self.shaping.left()
            self.refresh()
        for layer in switched_layers():
            self.commands.action(f"layer.{layer}").setVisible(layer in STATION_LAYERS[station])
        self.panels_fit.points.setChecked(self.link.is_shown("points"))
        self.commands.refresh()

    def show_table(self, shown: bool) -> None:
        """Show or hide the table of grains."""
        self.table_dock.setVisible(shown)

    def show_curve(self, shown: bool) -> None:
        """Show or hide the convergence curve."""
        self.curve_dock.setVisible(shown)

    def show_plots(self, shown: bool) -> None:
        """Show or hide the plots of populations."""
        self.plots_dock.setVisible(shown)

    def show_style_page(self, shown: bool) -> None:
        """Show or hide curves, clones and quality at station Style."""
        self.style_dock.setVisible(shown)

    def show_sweep(self, shown: bool) -> None:
        """Show or hide the sweep over n, which takes the curve's room."""
        self.sweep_shown = shown
        if shown and self.station != "fit":
            self.enter("fit")
        self.show_docks()
        self.commands.refresh()

    def reset_layout(self) -> None:
        """Put table and curve back to where they were at first."""
        self.restoreState(self._first_layout)
        self.shell.memory.forget()
        self.show_docks()

    def choose_theme(self, choice: str, _checked: bool = True) -> None:
        """Take a theme."""
        self.theme.choose(choice)
        self.commands.refresh()

    def has_theme(self, choice: str) -> bool:
        """Return whether this is the theme that was chosen."""
        return self.theme.choice == choice

    def open_palette(self) -> None:
        """Show the command palette."""
        self.palette_box.open()

    def about(self) -> None:
        """Show versions and graphics."""
        from mbstudio.ui.shell.dialogs.about import AboutBox

        AboutBox(self.viewport, self).open()

    # ---- closing -----------------------------------------------------------------------------------

    def closeEvent(self, event: QCloseEvent) -> None:
        if not self._closing and self.ask_before_closing and self.files.has_unsaved_work:
            event.ignore()
            self.files.leave_project(self._close_without_asking)
            return
        self._closing = True
        self.settings.setValue("geometry", self.saveGeometry())
        self.fits.stop()
        if not self.queue.shut_down():
            log.warning("A task did not end in time.")
        self.shell.autosaves.close()
        self.shell.close()
        self.latents.close()
        self.link.close()
        self.viewport.close_viewport()
        self.workspace.project.close()
        super().closeEvent(event)

    def _close_without_asking(self) -> None:
        self.ask_before_closing = False
        self.close()
