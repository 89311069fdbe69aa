"""Opening and saving projects in the background."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Signal

from mbstudio.core.errors import ProjectWarning
from mbstudio.core.project import Project
from mbstudio.ui.language import tr
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Task


class ProjectWork(Work):
    """Reads and writes project files.

    Attributes
    ----------
    opened : signal
        A project was opened and taken; its scan is still to be opened.
    """

    opened = Signal()

    def new(self) -> None:
        """Begin with an empty project."""
        self.workspace.replace_project(Project.new())

    def open(self, path: Path) -> Task:
        """Open a project file."""
        task = Task(tr("Opening {name}", name=path.name), lambda control: _opened(path))
        task.succeeded.connect(lambda opened: self._take(opened[0], opened[1], path))
        return self.queue.submit(task)

    def save(self, path: Path, after: Callable[[], object] | None = None) -> Task:
        """Write the project to `path`; `after` is called once it is written."""
        project = self.workspace.project
        task = Task(tr("Saving {name}", name=path.name), lambda control: project.save(path))
        task.succeeded.connect(lambda written: self._saved(Path(written)))
        if after is not None:
            task.succeeded.connect(lambda _: after())
        return self.queue.submit(task)

    def _take(self, project: Project, notes: tuple[str, ...], path: Path) -> None:
        self.workspace.replace_project(project)
        self.workspace.remember(path)
        grains = len(project.grains) if project.grains is not None else 0
        told = tr(
            "{name}: {grains} grains, {fitted} of them fitted.",
            name=path.name,
            grains=grains,
            fitted=len(project.fits),
        )
        self.said.emit("warning" if notes else "success", " ".join((told, *notes)))
        self.opened.emit()

    def _saved(self, path: Path) -> None:
        self.workspace.remember(path)
        self.workspace.saved()
        self.said.emit("success", tr("Saved {name}.", name=path.name))


def _opened(path: Path) -> tuple[Project, tuple[str, ...]]:
    """Return a project, and what the person should know about its file."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", ProjectWarning)
        project = Project.open(path)
    notes = tuple(str(one.message) for one in told if issubclass(one.category, ProjectWarning))
    if project.state.clones is not None:
        # Clones are compared with grains at once; what compares takes a second to load.
        import scipy.stats  # noqa: F401
    return project, notes
