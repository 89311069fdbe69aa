"""Writing the project beside itself while it is worked on, and offering what a crash has left."""

from __future__ import annotations

import logging
import threading
import time
from pathlib import Path

from platformdirs import user_state_path
from PySide6.QtCore import QObject, QSettings, QTimer, Signal

from mbstudio.core.errors import MbstudioError
from mbstudio.core.project import Autosave, Project, ProjectState
from mbstudio.ui.kept_settings import whole_number
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.shell.project_notes import told_of
from mbstudio.ui.stations.registry import Stations
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Task, TaskQueue
from mbstudio.ui.workspace import Workspace

log = logging.getLogger(__name__)

LANE = "autosave"
SECONDS = 20  # between two writes, unless the person wants otherwise
SHORTEST, LONGEST = 5, 30
SETTLING = 2.0  # seconds that a first change waits for the ones that follow it


def autosave_folder() -> Path:
    """Return the folder that all windows of this person write to."""
    return user_state_path("mbstudio", appauthor=False) / "autosave"


class AutosaveWork(Work):
    """Writes the project in the background, and finds what programs that ended early have left.

    Attributes
    ----------
    found : signal (list of Autosave)
        Work that nobody saved; emitted once after `look`, and again when one was taken or removed.
    restored : signal (Project)
        A project that was brought back.
    """

    found = Signal(object)
    restored = Signal(object)
    _journal_begun = Signal()  # from a worker: the grains must be on the disk before avatars of them are

    def __init__(
        self,
        workspace: Workspace,
        queue: TaskQueue,
        stations: Stations,
        settings: QSettings,
        parent: QObject,
    ) -> None:
        super().__init__(workspace, queue, parent)
        self._settings, self._stations = settings, stations
        self._own: Autosave | None = None
        self._making = threading.Lock()
        self._task: Task | None = None
        self._kept: ProjectState | None = None  # what was written last
        # The project with what is half done, and what it was joined from: the same is not written twice.
        self._parts: tuple[object, ...] = ()
        self._joined: ProjectState | None = None
        self._last = float("-inf")
        self._has_complained = False
        self._is_restoring = False
        self._held: list[Autosave] = []
        self.leftovers: list[Autosave] = []
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self.write_now)
        workspace.spare_journal = self._spare_journal
        workspace.state_changed.connect(self._changed)
        workspace.grains_changed.connect(self._grains_changed)
        self._journal_begun.connect(self.write_now)
        for station in stations:
            station.arrived.connect(self._changed)

    @property
    def seconds(self) -> int:
        """Seconds between two writes."""
        return whole_number(self._settings, "autosave/seconds", SECONDS, 1, LONGEST)

    def set_seconds(self, seconds: int) -> None:
        """Write so often from now on."""
        self._settings.setValue("autosave/seconds", seconds)

    # ---- writing -------------------------------------------------------------------------------

    def state_to_keep(self) -> ProjectState | None:
        """Return the project with what is half done; None where the file holds all."""
        state = self.workspace.state
        found = [half for station in self._stations if (half := station.half_done) is not None]
        if found:
            parts = (state, *(part for half in found for part in half.parts))
            if len(parts) != len(self._parts) or any(
                a is not b for a, b in zip(parts, self._parts, strict=True)
            ):
                for half in found:
                    state = half.join(state)
                self._parts, self._joined = parts, state
            return self._joined
        found_or_learned = (state.scan, state.grains, state.style, state.surfaces)
        worth_it = any(one is not None for one in found_or_learned)
        return state if self.workspace.is_modified and worth_it else None

    def _spare_journal(self) -> Path | None:
        """Return where finished avatars are written that cannot lie beside the project's file."""
        with self._making:
            self._own = self._own or Autosave.begin(autosave_folder())
            place = self._own.journal
        self._journal_begun.emit()
        return place

    def write_now(self) -> Task | None:
        """Write what is not in the project's file, unless it is written already."""
        self._timer.stop()
        if self._is_restoring or (self._task is not None and not self._task.is_over):
            self._timer.start(1000)
            return None
        state, own = self.state_to_keep(), self._own
        if state is None and (own is None or self._kept is None):
            return None
        if state is not None and state is self._kept:
            return None
        path, scan, opened_as = (
            self.workspace.project.path, self.workspace.scan, self.workspace.project.opened_as,
        )  # fmt: skip
        embedded = state is not None and state.scan is not None and state.scan.embedded
        if embedded and scan is None:
            return None  # its voxels are still being read
        self._last = time.monotonic()

        def work(_: object) -> None:
            if state is None:
                assert own is not None
                own.clear()
                return
            with self._making:  # kept here, so that a window that closes meanwhile removes it
                autosave = self._own = self._own or Autosave.begin(autosave_folder())
            autosave.write(state, path, scan.voxels if embedded and scan is not None else None, opened_as)

        self._task = Task(tr("Autosave"), work)
        self._task.handled = (MbstudioError, OSError)
        self._task.succeeded.connect(lambda _: self._written(state))
        self._task.failed.connect(self._failed)
        return self.queue.submit(self._task, lane=LANE)

    def _changed(self) -> None:
        if self._timer.isActive():
            return
        state = self.state_to_keep()
        if state is self._kept or (state is None and self._kept is None):
            return
        wait = max(SETTLING if self.seconds > SETTLING else 0.0, self._last + self.seconds - time.monotonic())
        self._timer.start(round(1000 * wait))

    def _grains_changed(self) -> None:
        """Write the first grains at once: finding them took minutes."""
        if self.workspace.state.grains is not None and (self._kept is None or self._kept.grains is None):
            self.write_now()

    def _written(self, state: ProjectState | None) -> None:
        self._kept = state
        self._has_complained = False
        self._changed()

    def _failed(self, error: Exception) -> None:
        log.warning("Autosave failed: %s", str(error))  # the error itself holds the window by its traceback
        if not self._has_complained:  # once, not every half minute
            self._has_complained = True
            self.said.emit(
                "warning",
                tr(
                    "Autosave failed: {error} Save the project yourself until autosave works again.",
                    error=error,
                ),
            )
        self._changed()

    # ---- what a crash has left -----------------------------------------------------------------

    def look(self) -> Task:
        """Look for work that nobody saved."""

        def work(_: object) -> list[Autosave]:
            # Held from here on, so that a window that closes meanwhile lets go of them.
            self._held = list(Autosave.find_abandoned(autosave_folder()))
            return self._held

        task = Task(tr("Looking for unsaved work"), work)
        task.handled = (OSError,)
        task.succeeded.connect(self._take_leftovers)
        task.failed.connect(lambda error: log.warning("Could not look for unsaved work: %s", str(error)))
        return self.queue.submit(task, lane=LANE)

    def _take_leftovers(self, found: list[Autosave]) -> None:
        for autosave in found:
            try:
                autosave.note  # noqa: B018
            except MbstudioError as error:
                # What can be read of it may still be worth something to a person: it stays.
                log.warning("%s", str(error))  # the error itself holds the window through its traceback
                autosave.release()
            else:
                self.leftovers.append(autosave)
        self.found.emit(list(self.leftovers))

    def restore(self, autosave: Autosave) -> Task:
        """Bring the work of an ended program back, as an unsaved project."""
        task = Task(
            tr("Restoring {project}", project=autosave.note.title),
            lambda control: told_of(autosave.restore),
        )
        task.succeeded.connect(lambda restored: self._restored(autosave, *restored))
        task.ended.connect(self._end_restoring)
        self._is_restoring = True
        return self.queue.submit(task, lane=LANE)  # after a write that is under way

    def _end_restoring(self) -> None:
        self._is_restoring = False
        self._changed()

    def _restored(self, autosave: Autosave, project: Project, notes: tuple[str, ...]) -> None:
        note = autosave.note
        if autosave in self.leftovers:
            self.leftovers.remove(autosave)
        if self._own is not None:
            self._own.discard()
        # The folder goes on as this window's: until the next write it is the only copy.
        self._own, self._kept = autosave, None if project.brought_back else project.state
        self.workspace.replace_project(project)
        self.workspace.hold_project()
        told = tr(
            "Restored {project}: {grains}, {avatars}. Save it to keep it.",
            project=note.title,
            grains=plural(note.grains, mark("{count} grain"), mark("{count} grains")),
            avatars=plural(len(project.fits), mark("{count} avatar"), mark("{count} avatars")),
        )
        self.said.emit("warning" if notes else "success", " ".join((told, *notes)))
        self.found.emit(list(self.leftovers))
        self.restored.emit(project)

    def discard(self, autosave: Autosave) -> None:
        """Remove what a program has left."""
        if autosave in self.leftovers:
            self.leftovers.remove(autosave)
        autosave.discard()
        self.found.emit(list(self.leftovers))

    def close(self) -> None:
        """End cleanly: what was worked on is saved or given up; what others left stays."""
        self._timer.stop()
        self.workspace.give_up_work()
        if self._own is not None:
            self._own.discard()
            self._own = None
        for autosave in {*self.leftovers, *self._held}:
            autosave.release()
        self.leftovers.clear()
        self._held.clear()
