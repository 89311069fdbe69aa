"""The window: rail and panels on the left, the view in the middle, docks around it."""

from __future__ import annotations

import logging
from pathlib import Path

from PySide6.QtCore import QEvent, QSettings, Qt
from PySide6.QtGui import QCloseEvent, QDragEnterEvent, QDropEvent, QKeyEvent
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDockWidget,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QMainWindow,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from mbstudio.core.errors import MbstudioError
from mbstudio.ui.icons import Icons, application_icon
from mbstudio.ui.kept_settings import stored_bytes
from mbstudio.ui.language import tr
from mbstudio.ui.shell.commands import (
    edit_commands,
    file_commands,
    help_commands,
    in_menu_order,
    menu_names,
    panel_commands,
    station_commands,
)
from mbstudio.ui.shell.dialogs.command_palette import CommandPalette
from mbstudio.ui.shell.dialogs.welcome import Welcome
from mbstudio.ui.shell.message_bar import MessageBar
from mbstudio.ui.shell.project_files import ProjectFiles
from mbstudio.ui.shell.project_work import ProjectWork
from mbstudio.ui.shell.rail import Rail
from mbstudio.ui.shell.shell import Shell
from mbstudio.ui.shell.task_strip import TaskStrip
from mbstudio.ui.shell.undo import Undo
from mbstudio.ui.shell.view_bar import ViewBar
from mbstudio.ui.stations.registry import Stations
from mbstudio.ui.studio import Studio
from mbstudio.ui.theme import Theme
from mbstudio.ui.view.building_note import BuildingNote
from mbstudio.ui.view.comparison import Comparison
from mbstudio.ui.view.grain_focus import GrainFocus
from mbstudio.ui.view.pictures import Pictures
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.view.slice_commands import AUTO, BUTTONS, slice_commands
from mbstudio.ui.view.slice_views import SliceViews
from mbstudio.ui.view.tool_commands import tool_commands
from mbstudio.ui.view.view_commands import focus_commands, view_commands
from mbstudio.ui.view.view_tools import ViewTools
from mbstudio.ui.viewport import make_viewport
from mbstudio.ui.workers import Task

log = logging.getLogger(__name__)


class MainWindow(QMainWindow):
    """Everything that the person sees. What happens in it is the stations', the view's and the shell's.

    Attributes
    ----------
    studio : Studio
    view : SceneView
    stations : Stations
    shell : Shell
    """

    def __init__(self, settings: QSettings, theme: Theme) -> None:
        super().__init__()
        self._closing = False
        self.settings, self.theme = settings, theme
        self.icons = Icons(theme, self)
        self.message_bar = MessageBar(self.icons)
        self.studio = Studio(settings, theme, self.icons, self.message_bar, make_viewport(), self)
        # What a test or a script asks for again and again.
        self.workspace, self.queue = self.studio.workspace, self.studio.queue
        self.commands, self.messages = self.studio.commands, self.studio.messages
        self.viewport = self.studio.viewport
        self.view = SceneView(self.studio)
        self.view_tools = ViewTools(self.studio, self.view)
        self.focus = GrainFocus(self.studio, self.view)
        self.slice_views = SliceViews(self.studio, self.view, self.focus)
        self.building_note = BuildingNote(self.studio, self.view)
        self.comparison = Comparison(self.studio, self.view, self.view_tools)
        self.pictures = Pictures(self.studio)
        self.setWindowIcon(application_icon())
        self.setAcceptDrops(True)
        self.setMinimumSize(900, 600)
        self.stations = Stations(self.studio, self.view)
        self.project_work = ProjectWork(self.workspace, self.queue, self)
        self.project_files = ProjectFiles(self.studio, self.stations, self.project_work)
        self.undo = Undo(self.workspace, self.stations)
        self._make_side()
        self.shell = Shell(
            self,
            self.studio,
            self.stations,
            self.view,
            self.slice_views,
            self.project_work,
            self.project_files,
        )
        self.docks = self.shell.docks
        self.command_palette = CommandPalette(self.commands, self)
        self._make_commands()
        self._make_centre()
        self._make_menus()
        self._make_status_bar()
        self._connect_signals()
        self._take_first_layout()
        for station in self.stations:
            station.wire()
        self.shell.wire()
        self._pages.setFocus()
        self.enter(self.stations.home.id)

    # ---- making it -------------------------------------------------------------------------------

    def _make_side(self) -> None:
        self.rail = Rail(self.stations, self.icons)
        self._panels = QStackedWidget()
        self._panels.setObjectName("panels")
        for station in self.stations:
            self._panels.addWidget(station.panel)
        side = QWidget()
        layout = QHBoxLayout(side)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.rail)
        layout.addWidget(self._panels)
        dock = QDockWidget(tr("Stations"), self)
        dock.setObjectName("side")
        dock.setWidget(side)
        dock.setTitleBarWidget(QWidget())
        dock.setFeatures(QDockWidget.DockWidgetFeature.NoDockWidgetFeatures)
        self.addDockWidget(Qt.DockWidgetArea.LeftDockWidgetArea, dock)

    def _make_commands(self) -> None:
        shell, view = self.shell, self.view
        found = [
            *station_commands(self.stations),
            *view_commands(view),
            *slice_commands(self.slice_views),
            *focus_commands(self.workspace, self.focus),
            *tool_commands(self.studio, view, self.view_tools, self.comparison, self.pictures),
            *(command for station in self.stations for command in station.commands()),
            *file_commands(self.studio, self.project_files, shell, view, self.pictures, self.close),
            *edit_commands(self.studio, self.undo, shell),
            *panel_commands(self.studio, shell, self.slice_views, self.reset_layout),
            *help_commands(shell, self.command_palette.open, self.about),
        ]
        self.commands.add(in_menu_order(found, self.stations))
        self.slice_views.panes.bar.add_buttons(
            [self.commands.action(name) for name in BUTTONS], self.commands.action(AUTO)
        )

    def _make_centre(self) -> None:
        self.welcome = Welcome()
        self._pages = QStackedWidget()
        self._pages.setObjectName("pages")
        # What the pages would like may not push the docks out of a small window.
        self._pages.setMinimumSize(200, 160)
        self._pages.addWidget(self.welcome)
        self._pages.addWidget(self.slice_views.grid)
        self.view_bar = ViewBar(self.commands, self.icons)
        centre = QWidget()
        centre.setObjectName("centre")
        layout = QVBoxLayout(centre)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.view_bar)
        layout.addWidget(self.message_bar)
        layout.addWidget(self.project_files.leaving)
        layout.addWidget(self.project_files.conflict)
        layout.addWidget(self.view_tools.bar)
        layout.addWidget(self._pages, 1)
        self.setCentralWidget(centre)

    def _make_menus(self) -> None:
        menus = {name: self.menuBar().addMenu(f"&{tr(name)}") for name in menu_names(self.stations)}
        for command in self.commands:
            menu = menus[command.menu]
            if command.separated:
                menu.addSeparator()
            if command.id == "project.new":
                self._recent_menu = menu.addMenu(tr("Open recent"))
                menu.addSeparator()
            menu.addAction(self.commands.action(command.id))

    def _make_status_bar(self) -> None:
        self.task_strip = TaskStrip(self.queue, self.icons)
        renderer = QLabel(tr("OpenGL view") if self.viewport.kind == "OpenGL" else tr("software view"))
        renderer.setToolTip(tr("How the 3-D view is drawn"))
        bar = self.statusBar()
        bar.addWidget(self.slice_views.readout)
        for part in (self.task_strip, self.shell.memory_label, renderer):
            bar.addPermanentWidget(part)
        bar.setSizeGripEnabled(False)

    def _take_first_layout(self) -> None:
        self._first_layout = self.saveState()
        geometry = stored_bytes(self.settings, "geometry")
        if geometry is None or not self.restoreGeometry(geometry):
            room = self.screen().availableGeometry()
            self.resize(min(1440, room.width()), min(900, room.height()))
        self.docks.take_first_sizes()

    def _connect_signals(self) -> None:
        studio, space = self.studio, self.workspace
        self._undo_and_redo = self.commands.action("edit.undo"), self.commands.action("edit.redo")
        for signal in (studio.refresh_asked, space.state_changed, self.queue.changed, self.message_bar.shown):
            signal.connect(lambda *_: self.refresh())
        # Esc belongs to the measurements again.
        self.message_bar.gone.connect(lambda: self.refresh())
        studio.hint_given.connect(self.statusBar().showMessage)
        self.stations.entered.connect(self._show_station)
        self.rail.chosen.connect(self.enter)
        space.recent_changed.connect(self._show_recent)
        space.project_replaced.connect(lambda: self.enter(self.stations.home.id))
        self.queue.failed.connect(self._tell_failure)
        self.shell.leftovers_found.connect(self.welcome.show_cards)
        self.welcome.recent_chosen.connect(self.project_files.open_path)
        for button, command in (
            (self.welcome.open_button, "scan.open"),
            (self.welcome.sample_button, "scan.sample"),
            (self.welcome.project_button, "project.open"),
            (self.welcome.meshes_button, "grains.open_meshes"),
        ):
            self.commands.bind(button, command)
        self._show_recent()

    # ---- what is to be seen now ------------------------------------------------------------------

    def enter(self, station: str) -> None:
        """Go to a station."""
        self.stations.enter(station)

    def _show_station(self) -> None:
        station = self.stations.current
        self.rail.show_chosen(station.id)
        self._panels.setCurrentWidget(station.panel)
        self.docks.show()

    def refresh(self) -> None:
        """Show the project, and bring commands and buttons up to date once the event loop is free."""
        if not self._closing:
            self._show_project()
            self.commands.outdate()

    def _show_project(self) -> None:
        """Show what there is, what can be undone, and the title."""
        undone, redone = self.undo.undo_title, self.undo.redo_title
        undo, redo = self._undo_and_redo
        undo.setText(tr("Undo: {change}", change=undone) if undone else tr("Undo"))
        redo.setText(tr("Redo: {change}", change=redone) if redone else tr("Redo"))
        self._pages.setCurrentIndex(1 if self.view.has_content else 0)
        self.setWindowTitle(tr("{project}[*] – MetaBall Studio", project=self.workspace.title))
        self.setWindowModified(self.workspace.is_modified)

    def _show_recent(self) -> None:
        """List the files opened last on the welcome page and in the menu."""
        recent = self.workspace.recent
        self.welcome.show_recent(recent)
        self._recent_menu.clear()
        for path in recent:
            action = self._recent_menu.addAction(path.name)
            action.setToolTip(str(path))
            action.triggered.connect(lambda _checked=False, chosen=path: self.project_files.open_path(chosen))
        self._recent_menu.setEnabled(bool(recent))

    def reset_layout(self) -> None:
        """Put the docks back to where they were at first."""
        self.restoreState(self._first_layout)
        self.shell.memory.forget()
        self.docks.show()

    def about(self) -> None:
        """Show versions and graphics."""
        from mbstudio.ui.shell.dialogs.about import AboutBox

        AboutBox(self.viewport, self).open()

    def _tell_failure(self, task: Task, error: Exception) -> None:
        if isinstance(error, MbstudioError):
            self.messages.say("error", str(error))
        elif isinstance(error, OSError | MemoryError):
            reason = str(error) or tr("not enough memory")
            self.messages.say("error", tr("{task} failed: {reason}.", task=task.title, reason=reason))
        else:
            log.error("%s failed", task.title, exc_info=error)
            self.messages.say(
                "error",
                tr(
                    "{task} failed because of a bug in mbstudio ({kind}: {error}).",
                    task=task.title,
                    kind=type(error).__name__,
                    error=error,
                ),
            )

    # ---- drag and drop ---------------------------------------------------------------------------

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if event.mimeData().hasUrls():
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        paths = [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
        event.acceptProposedAction()
        self.project_files.open_paths(paths)

    # ---- closing -----------------------------------------------------------------------------------

    def event(self, event: QEvent) -> bool:
        """Leave Enter to a field that is being written in, though a command has it too."""
        if event.type() == QEvent.Type.ShortcutOverride:
            # A key may come before the event loop was free: what it does must not be greyed out from before.
            self.commands.bring_up_to_date()
        if (
            event.type() == QEvent.Type.ShortcutOverride
            and isinstance(event, QKeyEvent)
            and event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter)
            and isinstance(QApplication.focusWidget(), QLineEdit | QAbstractSpinBox | QComboBox)
        ):
            event.accept()
            return True
        return super().event(event)

    def closeEvent(self, event: QCloseEvent) -> None:
        files = self.project_files
        if not self._closing and files.asks and files.has_unsaved_work:
            event.ignore()
            files.leave_project(self._close_without_asking)
            return
        self._closing = True
        self.commands.close()
        self.settings.setValue("geometry", self.saveGeometry())
        for station in self.stations:
            station.stop_and_keep()
        if not self.queue.shut_down():
            log.warning("A task did not end in time.")
        self.shell.close()
        for station in self.stations:
            station.close()
        self.view.close()
        self.viewport.close_viewport()
        self.workspace.project.close()
        super().closeEvent(event)

    def _close_without_asking(self) -> None:
        self.project_files.asks = False
        self.close()
