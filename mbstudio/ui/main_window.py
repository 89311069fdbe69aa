"""The window: rail and panels on the left, the view in the middle, table and curve below."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSettings, QSize, Qt
from PySide6.QtGui import QCloseEvent, QDragEnterEvent, QDropEvent
from PySide6.QtWidgets import (
    QDockWidget,
    QFileDialog,
    QFrame,
    QHBoxLayout,
    QLabel,
    QMainWindow,
    QMenu,
    QMessageBox,
    QStackedWidget,
    QToolBar,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from mbstudio.core.errors import MbstudioError
from mbstudio.scene import LAYERS
from mbstudio.ui.commands import CommandTable
from mbstudio.ui.icons import Icons, application_icon
from mbstudio.ui.panels.export_panel import ExportPanel
from mbstudio.ui.panels.fit_panel import FitPanel
from mbstudio.ui.panels.grain_panel import GrainPanel
from mbstudio.ui.panels.scan_panel import ScanPanel
from mbstudio.ui.theme import Choice, Theme
from mbstudio.ui.view_link import STATION_LAYERS, ViewLink
from mbstudio.ui.viewport import make_viewport
from mbstudio.ui.widgets.command_palette import CommandPalette
from mbstudio.ui.widgets.forms import label
from mbstudio.ui.widgets.grain_table import GrainTable
from mbstudio.ui.widgets.message_bar import MessageBar
from mbstudio.ui.widgets.plots import ConvergenceCurve
from mbstudio.ui.widgets.rail import Rail
from mbstudio.ui.widgets.scan_dialog import ScanDialog
from mbstudio.ui.widgets.task_strip import TaskStrip
from mbstudio.ui.widgets.welcome import Welcome
from mbstudio.ui.window_commands import MENUS, STATIONS, window_commands
from mbstudio.ui.work.export_work import ExportWork
from mbstudio.ui.work.fit_work import FitWork
from mbstudio.ui.work.grain_work import GrainWork
from mbstudio.ui.work.project_work import ProjectWork
from mbstudio.ui.work.scan_work import SCAN_SUFFIXES, ScanWork
from mbstudio.ui.workers import Task, TaskQueue
from mbstudio.ui.workspace import Workspace

log = logging.getLogger(__name__)

PROJECT_FILTER = "MetaBall Studio project (*.mbs)"


class MainWindow(QMainWindow):
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
        self.exports = ExportWork(self.workspace, self.queue, self)
        self.projects = ProjectWork(self.workspace, self.queue, self)
        self.messages = MessageBar(self.icons)
        self.viewport = make_viewport()
        self.link = ViewLink(self.workspace, self.fits, self.queue, self.viewport, theme, self)
        self.station = "scan"
        self._whole_fit: Task | None = None
        self._closing = False
        self.setWindowIcon(application_icon())
        self.setAcceptDrops(True)
        self.setMinimumSize(900, 600)
        self._make_panels()
        self._make_docks()
        self.commands = CommandTable(window_commands(self), self.icons, self)
        self._make_centre()
        self._make_menus()
        self.palette_box = CommandPalette(self.commands, self)
        self.strip = TaskStrip(self.queue, self.icons)
        self._renderer = QLabel(f"{self.viewport.kind} view")
        self._renderer.setToolTip("How the 3-D view is drawn")
        self.statusBar().addPermanentWidget(self.strip)
        self.statusBar().addPermanentWidget(self._renderer)
        self.statusBar().setSizeGripEnabled(False)
        self._connect()
        self._restore_layout()
        self._pages.setFocus()
        self.enter("scan")
        self.refresh()

    # ---- making it -----------------------------------------------------------------------------

    def _make_panels(self) -> None:
        self.panels_scan = ScanPanel(self.workspace, self.theme)
        self.panels_grains = GrainPanel(self.workspace, self.theme)
        self.panels_fit = FitPanel(self.workspace, self.fits, self.icons)
        self.panels_export = ExportPanel(self.workspace)
        self.panels = {
            "scan": self.panels_scan,
            "grains": self.panels_grains,
            "fit": self.panels_fit,
            "export": self.panels_export,
        }
        self.rail = Rail(list(STATIONS), self.icons)
        self._stack = QStackedWidget()
        for panel in self.panels.values():
            self._stack.addWidget(panel)
        side = QWidget()
        layout = QHBoxLayout(side)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.rail)
        layout.addWidget(self._stack)
        self.side_dock = self._dock("side", "Stations", side, Qt.DockWidgetArea.LeftDockWidgetArea)
        self.side_dock.setTitleBarWidget(QWidget())
        self.side_dock.setFeatures(QDockWidget.DockWidgetFeature.NoDockWidgetFeatures)
        # The rail reaches down to the status bar; table and curve lie beside it.
        self.setCorner(Qt.Corner.BottomLeftCorner, Qt.DockWidgetArea.LeftDockWidgetArea)

    def _make_docks(self) -> None:
        self.table = GrainTable()
        self.curve = ConvergenceCurve(self.theme)
        bottom = Qt.DockWidgetArea.BottomDockWidgetArea
        self.table_dock = self._dock("table", "Grains", self.table, bottom)
        self.curve_dock = self._dock("curve", "Convergence", self.curve, bottom)
        self.splitDockWidget(self.table_dock, self.curve_dock, Qt.Orientation.Horizontal)
        for dock in (self.table_dock, self.curve_dock):
            dock.setTitleBarWidget(self._dock_title(dock))
            # Never floating: what is undocked gets lost behind the window.
            dock.setFeatures(QDockWidget.DockWidgetFeature.DockWidgetClosable)

    def _dock(self, name: str, title: str, content: QWidget, area: Qt.DockWidgetArea) -> QDockWidget:
        dock = QDockWidget(title, self)
        dock.setObjectName(name)
        dock.setWidget(content)
        self.addDockWidget(area, dock)
        return dock

    def _dock_title(self, dock: QDockWidget) -> QWidget:
        bar = QFrame()
        bar.setObjectName("dock")
        layout = QHBoxLayout(bar)
        layout.setContentsMargins(14, 5, 8, 3)
        layout.addWidget(label(dock.windowTitle(), "heading"), 1)
        close = QToolButton()
        self.icons.set(close, "ph.x")
        close.setToolTip(f"Hide (menu View brings “{dock.windowTitle()}” back)")
        close.setAccessibleName(f"Hide {dock.windowTitle()}")
        close.clicked.connect(dock.hide)
        close.clicked.connect(self.refresh)
        layout.addWidget(close)
        return bar

    def _make_centre(self) -> None:
        self.welcome = Welcome()
        self._pages = QStackedWidget()
        self._pages.addWidget(self.welcome)
        self._pages.addWidget(self.viewport)
        self.view_bar = QToolBar("View")
        self.view_bar.setMovable(False)
        self.view_bar.setIconSize(QSize(18, 18))
        for names in (
            ("scan.open", "project.save"),
            ("edit.undo", "edit.redo"),
            tuple(f"layer.{layer}" for layer in LAYERS),
            ("view.fit", "view.screenshot"),
        ):
            for name in names:
                self.view_bar.addAction(self.commands.action(name))
                if name.startswith("layer."):
                    button = self.view_bar.widgetForAction(self.commands.action(name))
                    button.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
            self.view_bar.addSeparator()
        views = QToolButton()
        self.icons.set(views, "ph.video-camera")
        views.setToolTip("Look from …")
        views.setAccessibleName("Camera presets")
        views.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        menu = QMenu(views)
        for command in self.commands:
            if command.id.startswith("view.from_"):
                menu.addAction(self.commands.action(command.id))
        views.setMenu(menu)
        self.view_bar.addWidget(views)
        centre = QWidget()
        centre.setObjectName("centre")
        layout = QVBoxLayout(centre)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.view_bar)
        layout.addWidget(self.messages)
        layout.addWidget(self._pages, 1)
        self.setCentralWidget(centre)

    def _make_menus(self) -> None:
        self._menus = {name: self.menuBar().addMenu(f"&{name}") for name in MENUS}
        for command in self.commands:
            menu = self._menus[command.menu]
            if command.separated:
                menu.addSeparator()
            if command.id == "project.new":
                self._recent_menu = menu.addMenu("Open recent")
                menu.addSeparator()
            menu.addAction(self.commands.action(command.id))

    def _connect(self) -> None:
        space, link = self.workspace, self.link
        for signal in (space.state_changed, self.queue.changed, self.fits.changed, self.messages.shown):
            signal.connect(lambda *_: self.refresh())
        space.recent_changed.connect(self._show_recent)
        space.project_replaced.connect(lambda: self.enter("scan"))
        space.scan_changed.connect(self._scan_changed)
        space.grains_changed.connect(lambda: self.table.content.set_grains(space.state.grains))
        space.grains_changed.connect(self._show_docks)
        space.fits_changed.connect(lambda: self.table.content.set_fits(space.state.fits))
        space.selection_changed.connect(self._selection_changed)
        space.fits_changed.connect(self._show_curve_of_fit)
        for work in (self.scans, self.grains, self.fits, self.exports, self.projects):
            work.said.connect(self.messages.say)
        self.queue.failed.connect(self._task_failed)
        self.scans.asked.connect(self._ask_about_scan)
        self.projects.opened.connect(self.scans.reopen)
        self.table.chosen.connect(space.select)
        self.rail.chosen.connect(self.enter)
        self.fits.began.connect(lambda _: self.curve.set_losses([]))
        self.fits.losses_arrived.connect(self._losses_arrived)
        link.factors_ready.connect(self.panels_fit.show_factors)
        self.panels_scan.slice_moved.connect(link.move_slice)
        self.panels_scan.slice_switched.connect(link.switch_slice)
        self.panels_scan.window_changed.connect(link.set_window)
        self.panels_fit.opacity_changed.connect(link.set_opacity)
        self.panels_fit.step_asked.connect(self.step_grain)
        self.panels_fit.points.toggled.connect(lambda on: self._run_layer("points", on))
        self.panels_export.folder_asked.connect(self.ask_export_folder)
        self.panels_grains.find_asked.connect(lambda _: self.commands.run("grains.find"))
        self.panels_export.export_asked.connect(lambda: self.commands.run("export.run"))
        self.welcome.recent_chosen.connect(self.open_path)
        for button, command in (
            (self.welcome.open_button, "scan.open"),
            (self.welcome.sample_button, "scan.sample"),
            (self.welcome.project_button, "project.open"),
            (self.panels_scan.open_button, "scan.open"),
            (self.panels_scan.sample_button, "scan.sample"),
            (self.panels_grains.load_button, "grains.load"),
            (self.panels_fit.fit_button, "fit.grain"),
            (self.panels_fit.all_button, "fit.all"),
        ):
            button.clicked.connect(lambda _checked=False, name=command: self.commands.run(name))
        self._show_recent()

    # ---- what the conditions of commands ask -----------------------------------------------------

    @property
    def has_view(self) -> bool:
        """Whether there is something in the 3-D view."""
        return self.workspace.scan is not None or self.workspace.state.grains is not None

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
        history = self.workspace.project.history
        self.commands.action("edit.undo").setText(
            f"Undo: {history.undo_title}" if history.can_undo else "Undo"
        )
        self.commands.action("edit.redo").setText(
            f"Redo: {history.redo_title}" if history.can_redo else "Redo"
        )
        for button, command in (
            (self.panels_grains.find_button, "grains.find"),
            (self.panels_grains.load_button, "grains.load"),
            (self.panels_fit.fit_button, "fit.grain"),
            (self.panels_fit.all_button, "fit.all"),
        ):
            button.setEnabled(self.commands.action(command).isEnabled())
        self._pages.setCurrentIndex(1 if self.has_view else 0)
        self.setWindowTitle(f"{self.workspace.title}[*] – MetaBall Studio")
        self.setWindowModified(self.workspace.is_modified)

    # ---- commands: files -------------------------------------------------------------------------

    def ask_scan(self) -> None:
        """Let the person choose a scan file."""
        kinds = " ".join(f"*{suffix}" for suffix in SCAN_SUFFIXES)
        name, _ = QFileDialog.getOpenFileName(
            self, "Open scan", self._folder(), f"CT scans ({kinds});;All files (*)"
        )
        if name:
            self.open_path(Path(name))

    def ask_scan_folder(self) -> None:
        """Let the person choose a folder of slices."""
        name = QFileDialog.getExistingDirectory(self, "Open folder of slices", self._folder())
        if name:
            self.open_path(Path(name))

    def ask_project(self) -> None:
        """Let the person choose a project file."""
        name, _ = QFileDialog.getOpenFileName(self, "Open project", self._folder(), PROJECT_FILTER)
        if name:
            self.open_path(Path(name))

    def open_path(self, path: Path, voxel_size: str | None = None) -> None:
        """Open a project, a scan or a folder of slices, whichever it is."""
        if path.suffix.lower() == ".mbs":
            self._leave_project(lambda: self.projects.open(path))
        else:
            self.scans.open(path, voxel_size)

    def open_sample(self) -> None:
        """Make the sample scan."""
        self.scans.open_sample()

    def new_project(self) -> None:
        """Begin anew."""
        self._leave_project(self.projects.new)

    def save(self) -> None:
        """Save to the project's file, or ask for one."""
        path = self.workspace.project.path
        if path is None:
            self.save_as()
        else:
            self.projects.save(path)

    def save_as(self, after: Any = None) -> None:
        """Ask for a file and save to it."""
        name, _ = QFileDialog.getSaveFileName(self, "Save project", self._folder("sand.mbs"), PROJECT_FILTER)
        if name:
            path = Path(name)
            self.projects.save(path if path.suffix else path.with_suffix(".mbs"), after)

    def ask_screenshot(self) -> None:
        """Ask for a file and save the view to it."""
        name, _ = QFileDialog.getSaveFileName(
            self, "Save picture", self._folder("view.png"), "PNG picture (*.png)"
        )
        if name:
            self.save_screenshot(Path(name))

    def save_screenshot(self, path: Path) -> None:
        """Save the 3-D view as a picture."""
        from imageio.v3 import imwrite

        path = path if path.suffix else path.with_suffix(".png")
        try:
            imwrite(path, self.viewport.picture())
        except OSError as error:
            self.messages.say("error", f"{path} cannot be written ({error}): choose another folder.")
        else:
            self.messages.say("success", f"Saved the view as {path}.")

    def ask_labels(self) -> None:
        """Let the person choose a label image."""
        name, _ = QFileDialog.getOpenFileName(
            self,
            "Load labels",
            self._folder(),
            "Label images (*.tif *.tiff *.npy *.nrrd *.mhd *.mha);;All files (*)",
        )
        if name:
            self.grains.load(Path(name))

    def ask_export_folder(self) -> None:
        """Let the person choose where DEM files go."""
        name = QFileDialog.getExistingDirectory(self, "Folder for the DEM files", self._folder())
        if name:
            self.panels_export.folder.setText(name)

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
        if self.workspace.selected is not None:
            self.enter("fit")
            self.fits.fit(self.workspace.selected)

    def fit_all(self) -> None:
        """Fit every grain inside the scan without an avatar."""
        self.enter("fit")
        self._whole_fit = self.fits.fit_all()

    def more_generations(self) -> None:
        """Let the last fit go on."""
        self.fits.go_on(self.panels_fit.more.value(), self.panels_fit.n.value())

    def export(self) -> None:
        """Export as the panel says."""
        panel = self.panels_export
        folder = panel.folder_path
        if folder is not None:
            self.enter("export")
            self.exports.export(panel.labels(), panel.target_name, folder, **panel.given())

    def undo(self) -> None:
        """Take the last change back."""
        self.workspace.undo()

    def redo(self) -> None:
        """Make it again."""
        self.workspace.redo()

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
        self.station = station
        self.rail.show_chosen(station)
        self._stack.setCurrentWidget(self.panels[station])
        self.link.enter(station)
        self._show_docks()
        for layer in LAYERS:
            self.commands.action(f"layer.{layer}").setVisible(layer in STATION_LAYERS[station])
        self.panels_fit.points.setChecked(self.link.is_shown("points"))
        self.commands.refresh()

    def show_table(self, shown: bool) -> None:
        """Show or hide the table of grains."""
        self.table_dock.setVisible(shown)

    def show_curve(self, shown: bool) -> None:
        """Show or hide the convergence curve."""
        self.curve_dock.setVisible(shown)

    def reset_layout(self) -> None:
        """Put table and curve back to where they were at first."""
        self.restoreState(self._first_layout)
        self._show_docks()

    def choose_theme(self, choice: Choice, _checked: bool = True) -> None:
        """Take a theme."""
        self.theme.choose(choice)
        self.commands.refresh()

    def open_palette(self) -> None:
        """Show the command palette."""
        self.palette_box.open()

    def about(self) -> None:
        """Show versions and graphics."""
        from mbstudio.ui.widgets.about import AboutBox

        AboutBox(self.viewport, self).open()

    # ---- what happens ----------------------------------------------------------------------------

    def _scan_changed(self) -> None:
        slices = self.link.scene.slices
        if slices is not None:
            self.panels_scan.show_window(*slices.window)
            self.panels_grains.set_threshold_range(*slices.window)

    def _selection_changed(self) -> None:
        chosen, grains = self.workspace.selected, self.workspace.state.grains
        self.table.select_label(chosen)
        diameter = None
        if grains is not None and chosen is not None:
            rows = grains.table.loc[grains.table["label"] == chosen, "volume"]
            diameter = (6 * float(rows.iloc[0]) / 3.141592653589793) ** (1 / 3)
        self.panels_grains.mark_grain(diameter)
        self._show_curve_of_fit()

    def _losses_arrived(self, fitted: int, losses: list[float]) -> None:
        if fitted == self.workspace.selected:
            self.curve.add_losses(losses)

    def _show_curve_of_fit(self) -> None:
        chosen = self.workspace.selected
        if chosen is not None and chosen == self.fits.running_label:
            return
        fit = self.workspace.state.fits.get(chosen) if chosen is not None else None
        self.curve.set_losses([] if fit is None else [float(loss) for loss in fit.history])

    def _run_layer(self, layer: str, shown: bool) -> None:
        self.link.show_layer(layer, shown)  # type: ignore[arg-type]
        self.commands.refresh()

    def _task_failed(self, task: Task, error: Exception) -> None:
        if isinstance(error, MbstudioError):
            self.messages.say("error", str(error))
        elif isinstance(error, OSError | MemoryError):
            self.messages.say("error", f"{task.title} failed: {error or 'not enough memory'}.")
        else:
            log.error("%s failed", task.title, exc_info=error)
            self.messages.say(
                "error", f"{task.title} failed by a mistake in mbstudio ({type(error).__name__}: {error})."
            )

    def _ask_about_scan(self, path: Path, why: str, raw: bool) -> None:
        dialog = ScanDialog(path, why, raw, self)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.answered.connect(self.scans.open_answered)
        dialog.open()

    def _show_recent(self) -> None:
        recent = self.workspace.recent
        self.welcome.show_recent(recent)
        self._recent_menu.clear()
        for path in recent:
            action = self._recent_menu.addAction(path.name)
            action.setToolTip(str(path))
            action.triggered.connect(lambda _checked=False, chosen=path: self.open_path(chosen))
        self._recent_menu.setEnabled(bool(recent))

    def _show_docks(self) -> None:
        self.table_dock.setVisible(
            self.station in ("grains", "fit") and self.workspace.state.grains is not None
        )
        self.curve_dock.setVisible(self.station == "fit" and self.workspace.state.grains is not None)

    def _folder(self, name: str = "") -> str:
        project = self.workspace.project.path
        recent = self.workspace.recent
        folder = project.parent if project else (recent[0].parent if recent else Path.home())
        return str(folder / name)

    # ---- leaving ---------------------------------------------------------------------------------

    def _leave_project(self, then: Any) -> None:
        """Do `then` once unsaved work is saved or given up."""
        if not (
            self.ask_before_closing and self.workspace.is_modified and self.workspace.state.scan is not None
        ):
            then()
            return
        box = QMessageBox(self)
        box.setIcon(QMessageBox.Icon.Question)
        box.setText(f"Save the changes to “{self.workspace.title}”?")
        box.setInformativeText("Otherwise the grains and avatars since the last save are lost.")
        buttons = QMessageBox.StandardButton
        box.setStandardButtons(buttons.Save | buttons.Discard | buttons.Cancel)
        answer = box.exec()
        if answer == buttons.Save:
            path = self.workspace.project.path
            if path is None:
                self.save_as(after=then)
            else:
                self.projects.save(path, after=then)
        elif answer == buttons.Discard:
            then()

    def closeEvent(self, event: QCloseEvent) -> None:
        if not self._closing and self.ask_before_closing and self.workspace.is_modified:
            event.ignore()
            self._leave_project(self._close_without_asking)
            return
        self._closing = True
        self.settings.setValue("geometry", self.saveGeometry())
        self.fits.stop()
        if not self.queue.shut_down():
            log.warning("A task did not end in time.")
        self.link.close()
        self.viewport.close_viewport()
        self.workspace.project.close()
        super().closeEvent(event)

    def _close_without_asking(self) -> None:
        self.ask_before_closing = False
        self.close()

    def _restore_layout(self) -> None:
        self._first_layout = self.saveState()
        geometry = self.settings.value("geometry")
        if geometry is None or not self.restoreGeometry(geometry):
            self.resize(1440, 900)
        self.resizeDocks([self.table_dock], [230], Qt.Orientation.Vertical)
        self.resizeDocks([self.table_dock, self.curve_dock], [600, 360], Qt.Orientation.Horizontal)

    # ---- drag and drop ---------------------------------------------------------------------------

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if event.mimeData().hasUrls():
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        paths = [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
        event.acceptProposedAction()
        if len(paths) != 1:
            self.messages.say("warning", "Drop one file or one folder of slices at a time.")
        else:
            self.open_path(paths[0])
