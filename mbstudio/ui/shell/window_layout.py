"""Where everything in the window stands: rail and panels left, view in the middle, table and curve below."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QSettings, QSize, Qt
from PySide6.QtGui import QAction, QDragEnterEvent, QDropEvent, QResizeEvent
from PySide6.QtWidgets import (
    QDockWidget,
    QFrame,
    QHBoxLayout,
    QMainWindow,
    QMenu,
    QStackedWidget,
    QToolBar,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from mbstudio.scene import switched_layers
from mbstudio.ui.commands import CommandTable
from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.shell.dialogs.welcome import Welcome
from mbstudio.ui.shell.file_actions import FileActions
from mbstudio.ui.shell.message_bar import MessageBar
from mbstudio.ui.shell.rail import Rail
from mbstudio.ui.shell.shell_link import ShellLink
from mbstudio.ui.shell.window_commands import MENUS
from mbstudio.ui.stations.export.panel import ExportPanel
from mbstudio.ui.stations.fit.panel import FitPanel
from mbstudio.ui.stations.fit.sweep_dock import SweepDock
from mbstudio.ui.stations.fit.sweep_work import SweepWork
from mbstudio.ui.stations.fit.work import FitWork
from mbstudio.ui.stations.grains.panel import GrainPanel
from mbstudio.ui.stations.grains.table import GrainTable
from mbstudio.ui.stations.latent.dock import LatentDock
from mbstudio.ui.stations.latent.panel import LatentPanel
from mbstudio.ui.stations.latent.shelf import Gallery
from mbstudio.ui.stations.latent.work import LatentWork
from mbstudio.ui.stations.populations.dock import PopulationDock
from mbstudio.ui.stations.populations.panel import PopulationPanel
from mbstudio.ui.stations.populations.work import PopulationWork
from mbstudio.ui.stations.scan.panel import ScanPanel
from mbstudio.ui.stations.style.clone_work import CloneWork
from mbstudio.ui.stations.style.dock import StyleDock
from mbstudio.ui.stations.style.panel import StylePanel
from mbstudio.ui.stations.style.work import StyleWork
from mbstudio.ui.theme import Theme
from mbstudio.ui.view.slice_dock import SliceDock
from mbstudio.ui.view.slice_link import SliceLink
from mbstudio.ui.view.tool_commands import TOOLS
from mbstudio.ui.view.view_commands import STATIONS
from mbstudio.ui.view.view_tools import ViewTools
from mbstudio.ui.view.viewport import Viewport
from mbstudio.ui.widgets.forms import label
from mbstudio.ui.widgets.plots import ConvergenceCurve
from mbstudio.ui.workspace import Workspace

ROOMY = 640  # pixels: wide enough for a bar with the names of its layers


class ViewBar(QToolBar):
    """The bar above the view; where there is little room its layers are icons without words."""

    def __init__(self) -> None:
        super().__init__(tr("View"))
        self.worded: list[QToolButton] = []
        self._groups: list[tuple[tuple[QAction, ...], QAction]] = []

    def add_group(self, actions: tuple[QAction, ...]) -> None:
        """Add buttons and a line after them, which is there as long as one of them is."""
        self.addActions(actions)
        self._groups.append((actions, self.addSeparator()))
        for action in actions:
            action.changed.connect(self._show_lines)

    def _show_lines(self) -> None:
        for actions, line in self._groups:
            line.setVisible(any(action.isVisible() for action in actions))

    def resizeEvent(self, event: QResizeEvent) -> None:
        styles = Qt.ToolButtonStyle
        style = styles.ToolButtonTextBesideIcon if self.width() >= ROOMY else styles.ToolButtonIconOnly
        for button in self.worded:
            button.setToolButtonStyle(style)
        super().resizeEvent(event)


class WindowLayout(QMainWindow):
    """The window's widgets in their places; what they do is the main window's."""

    settings: QSettings
    theme: Theme
    icons: Icons
    workspace: Workspace
    fits: FitWork
    populations: PopulationWork
    sweeps: SweepWork
    styles: StyleWork
    clones: CloneWork
    latents: LatentWork
    messages: MessageBar
    viewport: Viewport
    commands: CommandTable
    files: FileActions
    slicing: SliceLink
    tools: ViewTools
    station: str
    shell: ShellLink
    sweep_shown: bool = False

    def refresh(self) -> None:
        """Bring commands, buttons and the title up to date."""
        raise NotImplementedError

    def _make_panels(self) -> None:
        self._sized: list[QDockWidget] = []
        self._swept = False
        self.panels_scan = ScanPanel(self.workspace, self.theme)
        self.panels_grains = GrainPanel(self.workspace, self.theme)
        self.panels_fit = FitPanel(self.workspace, self.fits, self.icons)
        self.panels_populations = PopulationPanel(self.workspace, self.populations)
        self.panels_style = StylePanel(self.workspace, self.styles, self.clones)
        self.panels_latent = LatentPanel(self.latents, self.icons)
        self.panels_export = ExportPanel(self.workspace, self.theme, self.icons)
        self.panels = {
            "scan": self.panels_scan,
            "grains": self.panels_grains,
            "fit": self.panels_fit,
            "populations": self.panels_populations,
            "style": self.panels_style,
            "latent": self.panels_latent,
            "export": self.panels_export,
        }
        stations = [(name, tr(title), icon, tr(tip)) for name, title, icon, tip in STATIONS]
        self.rail = Rail(stations, self.icons)
        self._stack = QStackedWidget()
        for panel in self.panels.values():
            self._stack.addWidget(panel)
        side = QWidget()
        layout = QHBoxLayout(side)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.rail)
        layout.addWidget(self._stack)
        self.side_dock = self._dock("side", tr("Stations"), side, Qt.DockWidgetArea.LeftDockWidgetArea)
        self.side_dock.setTitleBarWidget(QWidget())
        self.side_dock.setFeatures(QDockWidget.DockWidgetFeature.NoDockWidgetFeatures)
        # The rail reaches down to the status bar; table and curve lie beside it.
        self.setCorner(Qt.Corner.BottomLeftCorner, Qt.DockWidgetArea.LeftDockWidgetArea)

    def _make_docks(self) -> None:
        self.table = GrainTable()
        self.curve = ConvergenceCurve(self.theme)
        bottom = Qt.DockWidgetArea.BottomDockWidgetArea
        self.table_dock = self._dock("table", tr("Grains"), self.table, bottom)
        self.curve_dock = self._dock("curve", tr("Convergence"), self.curve, bottom)
        self.splitDockWidget(self.table_dock, self.curve_dock, Qt.Orientation.Horizontal)
        self.plots = PopulationDock(self.theme, self.icons)
        self.sweep = SweepDock(self.workspace, self.sweeps, self.theme)
        self.style_page = StyleDock(self.theme)
        self.style_dock = self._dock("style", tr("Style"), self.style_page, bottom)
        right = Qt.DockWidgetArea.RightDockWidgetArea
        self.plots_dock = self._dock("plots", tr("Plots of populations"), self.plots, right)
        self.sweep_dock = self._dock("sweep", tr("Sweep over n"), self.sweep, right)
        self.studio, self.gallery = LatentDock(self.theme, self.icons), Gallery(self.icons)
        self.studio_dock = self._dock("studio", tr("Latent studio"), self.studio, right)
        self.gallery_dock = self._dock("gallery", tr("Gallery"), self.gallery, bottom)
        self.slice_panes = SliceDock(self.theme)
        self.slices_dock = self._dock("slices", tr("Slices"), self.slice_panes, right)
        # Plots need the height more than the table needs the width.
        self.setCorner(Qt.Corner.BottomRightCorner, right)
        for dock in (
            self.table_dock, self.curve_dock, self.plots_dock, self.sweep_dock, self.style_dock,
            self.slices_dock,
        ):  # fmt: skip
            dock.setTitleBarWidget(self._dock_title(dock))
        for dock in (self.studio_dock, self.gallery_dock):
            dock.setTitleBarWidget(QWidget())
        for dock in self.findChildren(QDockWidget):
            if dock is self.side_dock:
                continue
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
        close.setToolTip(tr("Hide (menu View brings “{panel}” back)", panel=dock.windowTitle()))
        close.setAccessibleName(tr("Hide {panel}", panel=dock.windowTitle()))
        close.clicked.connect(dock.hide)
        close.clicked.connect(self.refresh)
        layout.addWidget(close)
        return bar

    @property
    def view_room(self) -> QSize:
        """Size of the place where the view is or will be."""
        return self._pages.size()

    def _make_centre(self) -> None:
        self.welcome = Welcome()
        self._pages = QStackedWidget()
        self._pages.addWidget(self.welcome)
        self._pages.addWidget(self.viewport)
        self.view_bar = ViewBar()
        self.view_bar.setMovable(False)
        self.view_bar.setIconSize(QSize(18, 18))
        for names in (
            ("scan.open", "project.save"),
            ("edit.undo", "edit.redo"),
            tuple(f"layer.{layer}" for layer in switched_layers()),
            ("view.fit", "view.screenshot"),
        ):
            self.view_bar.add_group(tuple(self.commands.action(name) for name in names))
            for name in names:
                if name.startswith("layer."):
                    button = self.view_bar.widgetForAction(self.commands.action(name))
                    assert isinstance(button, QToolButton)
                    self.view_bar.worded.append(button)
        views = QToolButton()
        self.icons.set(views, "ph.video-camera")
        views.setToolTip(tr("Look from …"))
        views.setAccessibleName(tr("Camera presets"))
        views.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        menu = QMenu(views)
        for command in self.commands:
            if command.id.startswith("view.from_"):
                menu.addAction(self.commands.action(command.id))
        views.setMenu(menu)
        self.view_bar.addWidget(views)
        self.view_bar.addWidget(self._tools_button())
        centre = QWidget()
        centre.setObjectName("centre")
        layout = QVBoxLayout(centre)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.view_bar)
        layout.addWidget(self.messages)
        layout.addWidget(self.files.leaving)
        layout.addWidget(self.tools.bar)
        layout.addWidget(self._pages, 1)
        self.setCentralWidget(centre)

    def _tools_button(self) -> QToolButton:
        button = QToolButton()
        self.icons.set(button, "ph.ruler")
        button.setToolTip(tr("Measure, clip, compare …"))
        button.setAccessibleName(tr("Tools of the view"))
        button.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        menu = QMenu(button)
        for name in TOOLS:
            menu.addAction(self.commands.action(name))
        button.setMenu(menu)
        return button

    def _make_menus(self) -> None:
        self._menus = {name: self.menuBar().addMenu(f"&{tr(name)}") for name in MENUS}
        for command in self.commands:
            menu = self._menus[command.menu]
            if command.separated:
                menu.addSeparator()
            if command.id == "project.new":
                self._recent_menu = menu.addMenu(tr("Open recent"))
                menu.addSeparator()
            menu.addAction(self.commands.action(command.id))

    # ---- what is to be seen now ------------------------------------------------------------------

    def show_recent(self) -> None:
        """List the files opened last on the welcome page and in the menu."""
        recent = self.workspace.recent
        self.welcome.show_recent(recent)
        self._recent_menu.clear()
        for path in recent:
            action = self._recent_menu.addAction(path.name)
            action.setToolTip(str(path))
            action.triggered.connect(lambda _checked=False, chosen=path: self.files.open_path(chosen))
        self._recent_menu.setEnabled(bool(recent))

    def show_docks(self) -> None:
        """Show the docks of the station, hide the others."""
        there = self.workspace.state.grains is not None
        sweeping = self.station == "fit" and self.sweep_shown
        self.table_dock.setVisible(self.station in ("grains", "fit", "populations") and there)
        self.curve_dock.setVisible(self.station == "fit" and there and not sweeping)
        self.sweep_dock.setVisible(sweeping)
        self.plots_dock.setVisible(self.station == "populations")
        self.style_dock.setVisible(self.station == "style")
        if self.station == "style":
            self.resizeDocks([self.style_dock], [282], Qt.Orientation.Vertical)
        shaping = self.station == "latent" and self.latents.learner is not None
        self.studio_dock.setVisible(shaping)
        self.gallery_dock.setVisible(shaping)
        self.slices_dock.setVisible(self.slicing.is_shown)
        self.shell.memory.apply()
        for dock in (self.sweep_dock, self.plots_dock, self.studio_dock):
            if dock.isVisible() and dock not in self._sized:
                self._sized.append(dock)
                self.resizeDocks([dock], [max(400, self.width() // 3)], Qt.Orientation.Horizontal)
        if self.slices_dock.isVisible() and self.slices_dock not in self._sized:
            self._sized.append(self.slices_dock)
            self.resizeDocks([self.slices_dock], [max(240, self.width() // 5)], Qt.Orientation.Horizontal)
        if self.curve_dock.isVisible() and self._swept != sweeping:
            self.resizeDocks([self.table_dock, self.curve_dock], [580, 280], Qt.Orientation.Horizontal)
        self._swept = sweeping

    def _restore_layout(self) -> None:
        self._first_layout = self.saveState()
        geometry = self.settings.value("geometry")
        if geometry is None or not self.restoreGeometry(geometry):
            room = self.screen().availableGeometry()
            self.resize(min(1440, room.width()), min(900, room.height()))
        self.resizeDocks([self.table_dock], [230], Qt.Orientation.Vertical)
        self.resizeDocks([self.table_dock, self.curve_dock], [580, 280], Qt.Orientation.Horizontal)

    # ---- drag and drop ---------------------------------------------------------------------------

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if event.mimeData().hasUrls():
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        paths = [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
        event.acceptProposedAction()
        if len(paths) != 1:
            self.messages.say("warning", tr("Drop one file or one folder of slices at a time."))
        else:
            self.files.open_path(paths[0])
