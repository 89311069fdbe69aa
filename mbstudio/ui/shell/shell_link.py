"""What belongs to no station: autosave, history, log, preferences, guide, tour, memory, layout."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Qt, QTimer
from PySide6.QtWidgets import QDockWidget, QLabel, QWidget

from mbstudio.core.batch.processes import limit_processes
from mbstudio.core.errors import MbstudioError
from mbstudio.core.project import Autosave
from mbstudio.ui.language import tr
from mbstudio.ui.shell.autosave_work import AutosaveWork
from mbstudio.ui.shell.dialogs.recovery_card import RecoveryCard, age
from mbstudio.ui.shell.dialogs.tour_card import TourCard, TourStep
from mbstudio.ui.shell.history_list import HistoryList
from mbstudio.ui.shell.layout_memory import LayoutMemory
from mbstudio.ui.shell.log_panel import LogPanel
from mbstudio.ui.shell.memory import give_back_unused, memory_used
from mbstudio.ui.stations.gallery.link import GalleryLink

if TYPE_CHECKING:
    from mbstudio.ui.shell.dialogs.cheat_sheet import CheatSheet
    from mbstudio.ui.shell.dialogs.guide import Guide
    from mbstudio.ui.shell.dialogs.preferences import Preferences
    from mbstudio.ui.shell.main_window import MainWindow

MEMORY_EVERY = 3_000  # milliseconds between two looks at the memory


class ShellLink(QObject):
    """What happens around the stations.

    Parameters
    ----------
    window : MainWindow
        With its docks and panels made, but without commands.
    """

    def __init__(self, window: MainWindow) -> None:
        super().__init__(window)
        self._window = window
        self.autosaves = AutosaveWork(
            window.workspace, window.queue, window.fits, window.styles, window.settings, self
        )
        self.memory = LayoutMemory(window)
        self.history, self.log = HistoryList(window.theme, window.icons), LogPanel(window.icons)
        areas = Qt.DockWidgetArea
        self.history_dock = self._dock("history", tr("History"), self.history, areas.RightDockWidgetArea)
        self.log_dock = self._dock("log", tr("Messages"), self.log, areas.BottomDockWidgetArea)
        self.gallery = GalleryLink(window, self._dock)
        self._guide: Guide | None = None
        self._sheet: CheatSheet | None = None
        self._preferences: Preferences | None = None
        self._tour: TourCard | None = None
        self._used = QLabel()
        self._used.setToolTip(tr("Memory that MetaBall Studio holds"))
        self._watch = QTimer(self)
        self._watch.timeout.connect(self._show_memory)
        for station, panel in window.panels.items():
            window.icons.set(panel.help, "ph.question")
            panel.help.clicked.connect(lambda _checked=False, name=station: self.open_guide(name))
        limit = window.settings.value("work/processes", 0)
        limit_processes(int(str(limit)) or None if str(limit).isdecimal() else None)

    def _dock(self, name: str, title: str, content: QWidget, area: Qt.DockWidgetArea) -> QDockWidget:
        dock = self._window._dock(name, title, content, area)
        dock.setTitleBarWidget(self._window._dock_title(dock))
        dock.setFeatures(QDockWidget.DockWidgetFeature.DockWidgetClosable)
        dock.hide()
        return dock

    def connect_all(self) -> None:
        """Connect with the rest of the window, and put its panels as they stood."""
        window, space = self._window, self._window.workspace
        self.gallery.connect_all()
        self.autosaves.said.connect(window.messages.say)
        self.autosaves.found.connect(self._show_leftovers)
        self.autosaves.restored.connect(lambda _: window.scans.reopen())
        window.scans.missing.connect(window.files.tell_missing_scan)
        window.messages.shown.connect(self.log.say)
        space.state_changed.connect(self._show_history)
        window.theme.changed.connect(self._show_history)
        self.history.chosen.connect(space.go_to)
        self.history_dock.visibilityChanged.connect(lambda _: self._show_history())
        space.scan_changed.connect(self.memory.use_camera)
        # Voxels and surfaces of the project before are freed by then.
        self._trim = QTimer(self)
        self._trim.setSingleShot(True)
        self._trim.setInterval(200)
        self._trim.timeout.connect(give_back_unused)
        space.project_replaced.connect(self._trim.start)
        window.projects.opened.connect(self.memory.project_opened)
        window.statusBar().insertPermanentWidget(1, self._used)
        for dock in self.memory.docks.values():
            title = dock.titleBarWidget()
            for button in title.findChildren(QWidget) if title is not None else ():
                if hasattr(button, "clicked"):
                    button.clicked.connect(self.memory.note)
        for command in window.commands:
            if command.id.startswith("panel.") and command.id != "panel.reset":
                window.commands.action(command.id).triggered.connect(self.memory.note)
        self.memory.restore()
        self._show_memory()
        self._watch.start(MEMORY_EVERY)

    def begin(self) -> None:
        """Look for work that a crash has left; show the tour at the very first start."""
        self.autosaves.look()
        if not self._window.settings.value("tour/seen"):
            self.start_tour()

    def close(self) -> None:
        """Let go of what lies beside the window."""
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
        self._window.welcome.show_cards(cards)
        if found and self._window.has_view:
            # The welcome page is not to be seen: a file was opened with the window.
            note = found[0].note
            self._window.messages.say(
                "warning",
                tr(
                    "MetaBall Studio ended before “{project}” was saved ({age}).",
                    project=note.title,
                    age=age(note.saved),
                ),
                tr("Restore"),
                lambda: self.restore(found[0]),
            )
        self._window.refresh()

    def restore(self, autosave: Autosave | None = None) -> None:
        """Bring back work that was left, the newest by default; what is open now is saved first."""
        found = autosave or next(iter(self.autosaves.leftovers), None)
        if found is not None:
            self._window.files.leave_project(lambda: self.autosaves.restore(found))

    # ---- docks ---------------------------------------------------------------------------------

    def show_history(self, shown: bool) -> None:
        """Show or hide the history of changes."""
        self.history_dock.setVisible(shown)
        self._show_history()

    def show_log(self, shown: bool) -> None:
        """Show or hide messages and log."""
        self.log_dock.setVisible(shown)

    def show_gallery(self, shown: bool) -> None:
        """Show or hide the pictures of all grains, avatars and clones."""
        self.gallery.dock.setVisible(shown)
        self.gallery.show()

    def _show_history(self) -> None:
        if not self.history_dock.isHidden():
            self.history.show_history(self._window.workspace.project.history)

    def _show_memory(self) -> None:
        used = memory_used()
        self._used.setText(f"{used / 2**30:.1f} GB" if used >= 2**30 else f"{used / 2**20:.0f} MB")

    # ---- help ----------------------------------------------------------------------------------

    def open_guide(self, station: str = "") -> None:
        """Open the guide at a station, by default at the one that is open."""
        from mbstudio.ui.shell.dialogs.guide import SECTIONS, Guide

        self._guide = self._guide or Guide(self._window)
        try:
            self._guide.open_document("user-guide.md", SECTIONS[station or self._window.station])
        except MbstudioError as error:
            self._window.messages.say("error", str(error))

    def open_shortcuts(self) -> None:
        """Show all shortcuts."""
        from mbstudio.ui.shell.dialogs.cheat_sheet import CheatSheet

        self._sheet = self._sheet or CheatSheet(self._window.commands, self._window)
        self._sheet.open()

    def open_preferences(self) -> None:
        """Open the preferences, or bring them to the front."""
        from mbstudio.ui.shell.dialogs.preferences import Preferences

        if self._preferences is None:
            window = self._window
            self._preferences = Preferences(window.theme, window.workspace, self.autosaves, window)
            self._preferences.destroyed.connect(self._forget_preferences)
        self._preferences.show()
        self._preferences.raise_()

    def _forget_preferences(self) -> None:
        self._preferences = None

    def start_tour(self) -> None:
        """Go through the window in five steps."""
        window = self._window
        if self._tour is None:
            self._tour = TourCard(tour_steps(window), window)
            self._tour.ended.connect(lambda: window.settings.setValue("tour/seen", 1))
        self._tour.begin()


def tour_steps(window: MainWindow) -> list[TourStep]:
    """Return the five steps of the tour."""
    return [
        TourStep(
            tr("From a scan to particles"),
            tr(
                "MetaBall Studio finds the grains of a CT scan and fits a body to each that DEM can "
                "calculate with. Without a scan at hand, “Try the sample” makes one."
            ),
            lambda: None,
        ),
        TourStep(
            tr("Stations, from top to bottom"),
            tr(
                "Scan, Grains and Fit come first; Populations compares, Style and Latent make new grains, "
                "Export writes files for your engine. Ctrl+1 to Ctrl+7 go there."
            ),
            lambda: window.rail,
        ),
        TourStep(
            tr("One panel, one main action"),
            tr(
                "Settings of the station stand here, its blue button at the foot does the work. The "
                "question mark opens the guide where it speaks of this station."
            ),
            lambda: window._stack,
        ),
        TourStep(
            tr("One selection everywhere"),
            tr(
                "A click on a grain in the view, in the table or in a plot chooses it in all of them. "
                "Drag to turn the view, use the wheel to zoom."
            ),
            lambda: window._pages,
        ),
        TourStep(
            tr("Nothing gets lost"),
            tr(
                "Work runs in the background and can be cancelled at the lower edge. Everything can be "
                "undone, and after a crash you are offered what was not saved. Press ? for all shortcuts, "
                "Ctrl+K for any command."
            ),
            lambda: window.statusBar(),
        ),
    ]
