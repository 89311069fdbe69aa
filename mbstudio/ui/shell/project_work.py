"""Opening and saving projects in the background."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Signal

from mbstudio.core.errors import ProjectChangedError, ProjectError, ProjectLockedError
from mbstudio.core.project import Project
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.shell.project_notes import told_of
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Task


class ProjectWork(Work):
    """Reads and writes project files.

    Attributes
    ----------
    opened : signal
        A project was opened and taken; its scan is still to be opened.
    refused : signal (ProjectError, Path, callable or None)
        A project was not saved, because another program uses its file or has written it; with what was to be
        done afterwards.
    """

    opened = Signal()
    refused = Signal(object, object, object)

    def new(self) -> None:
        """Begin with an empty project."""
        self.workspace.replace_project(Project.new())

    def open(self, path: Path) -> Task:
        """Open a project file."""
        task = Task(tr("Opening {name}", name=path.name), lambda control: _opened(path))
        task.succeeded.connect(lambda opened: self._use_project(opened[0], opened[1], path))
        return self.queue.submit(task)

    @property
    def saving(self) -> Task | None:
        """The save that runs, if one does."""
        return self.queue.running("saving")

    def save(self, path: Path, after: Callable[[], object] | None = None, *, waits: bool = False) -> Task:
        """Write the project to `path` as it is now; `after` is called once it is written.

        Parameters
        ----------
        path : Path
        after : callable, optional
        waits : bool
            Whether what runs comes first: what it has found is to be in the file.
        """
        project = self.workspace.project
        task = Task(tr("Saving {name}", name=path.name), lambda control: project.save(path))
        task.can_cancel = False
        task.handled = (ProjectLockedError, ProjectChangedError)
        task.failed.connect(
            lambda error: self.refused.emit(error, path, after) if isinstance(error, task.handled) else None
        )
        task.succeeded.connect(lambda written: self._saved(project, Path(written)))
        if after is not None:
            task.succeeded.connect(lambda _: after())
        return self.queue.submit(task, lane="work" if waits else "saving")

    def merge(self, path: Path, after: Callable[[], object] | None = None) -> Task:
        """Bring in what another program has written into the project's file, then save it."""
        task = Task(tr("Opening {name}", name=path.name), lambda control: _opened(path, journal=False))
        task.succeeded.connect(lambda opened: self._merge(opened[0], path, after))
        return self.queue.submit(task)

    def _merge(self, found: Project, path: Path, after: Callable[[], object] | None) -> None:
        try:
            merge = self.workspace.merge(found)
        except ProjectError as error:
            self.said.emit("error", str(error))
            return
        told = plural(
            merge.added,
            mark("{count} avatar or kept grain of the file came in."),
            mark("{count} avatars and kept grains of the file came in."),
        )
        if merge.in_both:
            labels = ", ".join(map(str, merge.in_both))
            told += " " + tr(
                "Both have fitted these grains, and the avatars here were kept: {labels}.", labels=labels
            )
        self.said.emit("warning" if merge.in_both else "success", told)
        self.save(path, after)

    def _use_project(self, project: Project, notes: tuple[str, ...], path: Path) -> None:
        self.workspace.replace_project(project)
        self.workspace.remember(path)
        if in_use := self.workspace.hold_project():
            notes = (*notes, in_use, tr("You can work on it here; saving then offers a copy."))
        grains = len(project.grains) if project.grains is not None else 0
        told = tr(
            "{name}: {grains} grains, {fitted} of them fitted.",
            name=path.name,
            grains=grains,
            fitted=len(project.fits),
        )
        self.said.emit("warning" if notes else "success", " ".join((told, *notes)))
        self.opened.emit()

    def _saved(self, project: Project, path: Path) -> None:
        self.workspace.remember(path)
        if project is self.workspace.project:
            self.workspace.hold_project()
            self.workspace.saved()
        self.said.emit("success", tr("Saved {name}.", name=path.name))


def _opened(path: Path, *, journal: bool = True) -> tuple[Project, tuple[str, ...]]:
    """Return a project, and what the person should know about its file."""
    project, notes = told_of(lambda: Project.open(path, journal=journal))
    if project.state.new_grains is not None:
        # Clones are compared with grains at once; what compares takes a second to load.
        import scipy.stats  # noqa: F401
    return project, notes
