"""What belongs to no station: autosave, history, log, preferences, guide, tour, memory, layout."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QTimer, Signal
from PySide6.QtWidgets import QLabel, QMainWindow, QWidget

from mbstudio.core.batch.processes import limit_processes, processors
from mbstudio.core.errors import MbstudioError
from mbstudio.core.project import Autosave
from mbstudio.ui.kept_settings import whole_number
from mbstudio.ui.language import mark, tr
from mbstudio.ui.shell.autosave_work import AutosaveWork
from mbstudio.ui.shell.dialogs.recovery_card import RecoveryCard, age
from mbstudio.ui.shell.dialogs.tour_card import TourCard, TourStep
from mbstudio.ui.shell.docks import Docks
from mbstudio.ui.shell.history_list import HistoryList
from mbstudio.ui.shell.layout_memory import LayoutMemory
from mbstudio.ui.shell.log_panel import LogPanel
from mbstudio.ui.shell.memory import give_back_unused, memory_used
from mbstudio.ui.shell.project_files import ProjectFiles
from mbstudio.ui.shell.project_work import ProjectWork
from mbstudio.ui.stations.gallery.link import GalleryLink
from mbstudio.ui.stations.registry import Stations
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.view.slice_views import SliceViews
from mbstudio.ui.widgets.dock_frame import DockFrame

if TYPE_CHECKING:
    from mbstudio.ui.shell.dialogs.cheat_sheet import CheatSheet
    from mbstudio.ui.shell.dialogs.guide import Guide
    from mbstudio.ui.shell.dialogs.preferences import Preferences

MEMORY_EVERY = 3_000  # milliseconds between two looks at the memory


class Shell(QObject):
    """What happens around the stations.

    Parameters
    ----------
    window : QMainWindow
    studio : Studio
    stations : Stations
    view : SceneView
    slice_views : SliceViews
    project_work : ProjectWork
    project_files : ProjectFiles

    Attributes
    ----------
    leftovers_found : signal (list of RecoveryCard)
        Work that a crash has left, for the welcome page.
    """

    leftovers_found = Signal(object)

    def __init__(
        self,
        window: QMainWindow,
        studio: Studio,
        stations: Stations,
        view: SceneView,
        slice_views: SliceViews,
        project_work: ProjectWork,
        project_files: ProjectFiles,
    ) -> None:
        super().__init__(window)
        self._window, self._studio, self._stations, self._view = window, studio, stations, view
        self._space, self._project_work, self._project_files = studio.workspace, project_work, project_files
        self.autosaves = AutosaveWork(studio.workspace, studio.queue, stations, studio.settings, self)
        self.history, self.log = HistoryList(studio.theme, studio.icons), LogPanel(studio.icons)
        self.history_frame = DockFrame("history", tr("History"), self.history, "right", studio.icons)
        self.log_frame = DockFrame("log", tr("Messages"), self.log, "bottom", studio.icons)
        self.gallery_link = GalleryLink(studio)
        free = (self.history_frame, self.log_frame, self.gallery_link.frame)
        self.docks = Docks(window, studio, stations, (slice_views.frame,), free)
        self.memory = LayoutMemory(window, studio, stations, self.docks, view)
        self._guide: Guide | None = None
        self._sheet: CheatSheet | None = None
        self._preferences: Preferences | None = None
        self._tour: TourCard | None = None
        self.memory_label = QLabel()
        self.memory_label.setToolTip(tr("Memory used by MetaBall Studio"))
        self._watch = QTimer(self)
        self._watch.timeout.connect(self._show_memory)
        for station in stations:
            studio.icons.set(station.panel.help, "ph.question")
            station.panel.help.clicked.connect(lambda _checked=False, name=station.id: self.open_guide(name))
        limit_processes(whole_number(studio.settings, "work/processes", 0, 0, processors()) or None)

    def wire(self) -> None:
        """Connect with the rest of the window, and put its panels as they stood."""
        studio, space = self._studio, self._space
        self.autosaves.said.connect(studio.say)
        self.autosaves.found.connect(self._show_leftovers)
        self._project_work.said.connect(studio.say)
        for signal in (self.autosaves.restored, self._project_work.opened):
            signal.connect(self._project_opened)
        studio.messages.shown.connect(self.log.say)
        space.state_changed.connect(self._show_history)
        studio.theme.changed.connect(self._show_history)
        self.history.chosen.connect(space.go_to)
        self.history_frame.visibilityChanged.connect(lambda _: self._show_history())
        space.scan_changed.connect(self.memory.use_camera)
        # Voxels and surfaces of the project before are freed by then.
        self._trim = QTimer(self)
        self._trim.setSingleShot(True)
        self._trim.setInterval(200)
        self._trim.timeout.connect(give_back_unused)
        space.project_replaced.connect(self._trim.start)
        self._project_work.opened.connect(self.memory.project_opened)
        for dock in self.docks:
            if dock.close_button is not None:
                dock.close_button.clicked.connect(self.memory.note)
        for command in studio.commands:
            if command.id.startswith("panel.") and command.id != "panel.reset":
                studio.commands.action(command.id).triggered.connect(self.memory.note)
        self.memory.restore()
        self._show_memory()
        self._watch.start(MEMORY_EVERY)

    def _project_opened(self, *_: object) -> None:
        for station in self._stations:
            station.project_opened()

    def begin(self) -> None:
        """Look for work that a crash has left; show the tour at the very first start."""
        self.autosaves.look()
        if not self._studio.settings.value("tour/seen"):
            self.start_tour()

    def close(self) -> None:
        """Let go of what lies beside the window."""
        self.autosaves.close()
        self._watch.stop()
        self.memory.save()
        self.log.records.close()
        if self._guide is not None:
            self._guide.close()

    # ---- work that a crash has left ------------------------------------------------------------

    def _show_leftovers(self, found: list[Autosave]) -> None:
        cards = []
        for autosave in found:
            card = RecoveryCard(autosave.note)
            card.restore.clicked.connect(lambda _checked=False, left=autosave: self.restore(left))
            card.remove.clicked.connect(lambda _checked=False, left=autosave: self.autosaves.discard(left))
            cards.append(card)
        self.leftovers_found.emit(cards)
        if found and self._view.has_content:
            # The welcome page is not to be seen: a file was opened with the window.
            note = found[0].note
            self._studio.say(
                "warning",
                tr(
                    "MetaBall Studio closed unexpectedly before “{project}” was saved ({age}).",
                    project=note.title,
                    age=age(note.saved),
                ),
                tr("Restore"),
                lambda: self.restore(found[0]),
            )
        self._studio.refresh()

    def restore(self, autosave: Autosave | None = None) -> None:
        """Bring back work that was left, the newest by default; what is open now is saved first."""
        found = autosave or next(iter(self.autosaves.leftovers), None)
        if found is not None:
            self._project_files.leave_project(lambda: self.autosaves.restore(found))

    # ---- docks ---------------------------------------------------------------------------------

    def show_history(self, shown: bool) -> None:
        """Show or hide the history of changes."""
        self.history_frame.setVisible(shown)
        self._show_history()

    def show_log(self, shown: bool) -> None:
        """Show or hide messages and log."""
        self.log_frame.setVisible(shown)

    def show_gallery(self, shown: bool) -> None:
        """Show or hide the pictures of all grains, avatars and clones."""
        self.gallery_link.frame.setVisible(shown)
        self.gallery_link.show()

    def _show_history(self) -> None:
        if not self.history_frame.isHidden():
            self.history.show_history(self._space.project.history)

    def _show_memory(self) -> None:
        used = memory_used()
        self.memory_label.setText(f"{used / 2**30:.1f} GB" if used >= 2**30 else f"{used / 2**20:.0f} MB")

    # ---- help ----------------------------------------------------------------------------------

    def open_guide(self, station: str = "") -> None:
        """Open the guide at a station, by default at the one that is open."""
        from mbstudio.ui.shell.dialogs.guide import Guide

        open_at = self._stations[station] if station else self._stations.current
        self._guide = self._guide or Guide(self._window)
        try:
            self._guide.open_document("user-guide.md", open_at.guide)
        except MbstudioError as error:
            self._studio.say("error", str(error))

    def open_shortcuts(self) -> None:
        """Show all shortcuts."""
        from mbstudio.ui.shell.dialogs.cheat_sheet import CheatSheet

        self._sheet = self._sheet or CheatSheet(self._studio.commands, self._window)
        self._sheet.open()

    def open_preferences(self) -> None:
        """Open the preferences, or bring them to the front."""
        from mbstudio.ui.shell.dialogs.preferences import Preferences

        if self._preferences is None:
            studio = self._studio
            self._preferences = Preferences(studio.theme, self._space, self.autosaves, self._window)
            self._preferences.destroyed.connect(self._forget_preferences)
        self._preferences.show()
        self._preferences.raise_()

    def _forget_preferences(self) -> None:
        self._preferences = None

    def start_tour(self) -> None:
        """Go through the window in five steps."""
        if self._tour is None:
            self._tour = TourCard(tour_steps(self._window), self._window)
            self._tour.ended.connect(lambda: self._studio.settings.setValue("tour/seen", 1))
        self._tour.begin()


_TOUR = (
    (
        mark("From a scan to particles"),
        mark(
            "MetaBall Studio finds the grains in a CT scan and fits a body for DEM to each of them. "
            "If you have no scan at hand, click “Try the sample”."
        ),
        "",
    ),
    (
        mark("Stations, from top to bottom"),
        mark(
            "Scan, Grains and Fit come first; Populations compares, Style and Latent make new grains, "
            "Export writes files for your engine. Ctrl+1 to Ctrl+7 go there."
        ),
        "rail",
    ),
    (
        mark("One panel, one main action"),
        mark(
            "The settings of the station are here. The blue button at the bottom starts the work. "
            "The question mark opens the guide at this station."
        ),
        "panels",
    ),
    (
        mark("One selection everywhere"),
        mark(
            "Click a grain in the view, the table or a plot to select it in all of them. Drag to "
            "turn the view, use the wheel to zoom."
        ),
        "pages",
    ),
    (
        mark("Nothing is lost"),
        mark(
            "Work runs in the background; cancel it in the status bar. Everything can be undone, "
            "and unsaved work is offered again after a crash. Press ? for all shortcuts, Ctrl+K "
            "for any command."
        ),
        "status",
    ),
)
"""Title, text and the name of the widget that the step points at."""


def tour_steps(window: QMainWindow) -> list[TourStep]:
    """Return the five steps of the tour."""

    def finder(name: str) -> Callable[[], QWidget | None]:
        if name == "status":
            return window.statusBar
        return lambda: window.findChild(QWidget, name) if name else None

    return [TourStep(tr(title), tr(text), finder(name)) for title, text, name in _TOUR]
