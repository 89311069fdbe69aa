"""Opening and saving projects: which file, and whether unsaved work may go."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.errors import ProjectError
from mbstudio.ui.deferred_calls import DeferredCalls
from mbstudio.ui.language import mark, tr
from mbstudio.ui.shell.dialogs.conflict_card import ConflictCard
from mbstudio.ui.shell.dialogs.leave_card import LeaveCard
from mbstudio.ui.shell.project_work import ProjectWork
from mbstudio.ui.stations.registry import Stations
from mbstudio.ui.studio import Studio

PROJECT_FILTER = mark("MetaBall Studio project (*.mbs)")


class ProjectFiles(QObject):
    """Asks the person for project files, and whether what is not saved is to be.

    Parameters
    ----------
    studio : Studio
    stations : Stations
        They know what is not in the project yet, and open what is no project.
    project_work : ProjectWork

    Attributes
    ----------
    leaving : LeaveCard
    conflict : ConflictCard
    asks : bool
        Whether leaving unsaved work asks; tests switch it off.
    """

    def __init__(self, studio: Studio, stations: Stations, project_work: ProjectWork) -> None:
        super().__init__(studio)
        self._studio, self._stations, self._work = studio, stations, project_work
        self._space = studio.workspace
        self.asks = True
        self._then: Callable[[], object] | None = None
        self._after_saving: Callable[[], object] | None = None
        self._deferred = DeferredCalls(self)
        self.leaving = LeaveCard()
        self.leaving.answered.connect(self._leave)
        self.conflict = ConflictCard()
        self.conflict.answered.connect(self._settle)
        self._refused: tuple[Path, Callable[[], object] | None] | None = None
        project_work.refused.connect(self._ask_about)
        for card in (self.leaving, self.conflict):
            self._space.project_replaced.connect(card.take_away)

    def ask_project(self) -> None:
        """Let the person choose a project file."""
        name, _ = QFileDialog.getOpenFileName(
            self._studio.host, tr("Open project"), self._studio.path_for(), tr(PROJECT_FILTER)
        )
        if name:
            self.open_path(Path(name))

    def open_path(self, path: Path) -> None:
        """Open a project, or let a station open what it is."""
        self.open_paths([path])

    def open_paths(self, paths: Sequence[Path]) -> None:
        """Open a project, or let a station open what was given together."""
        if len(paths) == 1 and paths[0].suffix.lower() == ".mbs":
            self.leave_project(lambda: self._work.open(paths[0]))
        elif paths and not self._stations.open(paths):
            self._studio.say(
                "warning",
                tr("Open one scan, folder of slices or project at a time; of meshes, as many as you like."),
            )

    def new_project(self) -> None:
        """Begin anew."""
        self.leave_project(self._work.new)

    def save(self) -> None:
        """Save to the project's file, or ask for one."""
        path = self._space.project.path
        if path is None:
            self.save_as()
        else:
            self._work.save(path)

    def save_as(self, after: Any = None, suggested: str = "sand.mbs", *, waits: bool = False) -> None:
        """Ask for a file and save to it, once what runs is over if `waits`."""
        name, _ = QFileDialog.getSaveFileName(
            self._studio.host, tr("Save project"), self._studio.path_for(suggested), tr(PROJECT_FILTER)
        )
        if name:
            path = Path(name)
            self._work.save(path if path.suffix else path.with_suffix(".mbs"), after, waits=waits)

    @property
    def has_unsaved_work(self) -> bool:
        """Whether leaving the project now would lose something that is done or under way."""
        return self._space.is_modified or any(station.has_unsaved_work for station in self._stations)

    def leave_project(self, then: Callable[[], object]) -> None:
        """Do `then` once unsaved work is saved or given up; a card above the view asks for which.

        A save that runs comes to its end first.
        """
        saving = self._work.saving
        if saving is not None:
            if self._after_saving is None:
                saving.ended.connect(self._go_on)
            self._after_saving = then
            return
        if not (self.asks and self.has_unsaved_work and self._space.can_be_saved):
            then()
            return
        running = self._studio.queue.running()
        told = [tr("If you do not save, the grains and avatars found since the last save are lost.")]
        if running is not None:
            told.insert(0, tr("“{task}” is still running and will be stopped.", task=running.title))
        self._then = then
        question = tr("Save the changes to “{project}”?", project=self._space.title)
        self.leaving.ask(question, " ".join(told))

    def _go_on(self) -> None:
        then, self._after_saving = self._after_saving, None
        if then is not None:
            # Not from within the save's own signal: the lane is free by then.
            self._deferred.call(lambda: self.leave_project(then))

    def _leave(self, answer: str) -> None:
        """Do what was answered; work may have been done or saved since the question was asked."""
        then, self._then = self._then, None
        if answer == "save":
            # What a fit has reached so far comes into the project, then into the file.
            stopped = [station.stop_and_keep() for station in self._stations]
            if not any(stopped):
                self._studio.queue.cancel_all("work")
            path = self._space.project.path
            if path is None:
                self.save_as(after=then, waits=True)
            else:
                self._work.save(path, after=then, waits=True)
        elif answer == "discard" and then is not None:
            self._space.give_up_work()
            then()

    def _ask_about(self, error: ProjectError, path: Path, after: Callable[[], object] | None) -> None:
        """Ask what becomes of work that was not saved, for another program uses or has written the file."""
        self._refused = path, after
        self.conflict.ask_about(path.name, error)

    def _settle(self, answer: str) -> None:
        refused, self._refused = self._refused, None
        if refused is None:
            return
        path, after = refused
        if answer == "copy":
            suggested = tr("{project} (copy)", project=path.stem)
            self.save_as(after, f"{suggested}{path.suffix}")
        elif answer == "merge":
            self._work.merge(path, after)
        elif answer == "reload":
            self._space.give_up_work()
            self._work.open(path)
