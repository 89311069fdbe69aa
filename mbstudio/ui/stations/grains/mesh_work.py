"""Opening meshes as grains in the background: what the files do not say is asked for first."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from PySide6.QtCore import Signal

from mbstudio.core.errors import GrainWarning, MeshError
from mbstudio.core.grains import GrainSet
from mbstudio.core.grains.mesh_set import grain_set_from_meshes
from mbstudio.core.meshes.bodies import Cavities, read_bodies
from mbstudio.core.meshes.reading import read_mesh_data
from mbstudio.core.project import ScanReference
from mbstudio.ui.language import tr
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Task

_LOOKED_AT = 4  # files that are tried before the dialog opens without knowing a size
_QUICK = 400_000  # triangles of a file whose bodies are told apart before anything is asked


@dataclass(frozen=True)
class FirstStone:
    """The first body among files that can be read.

    Attributes
    ----------
    name : str
        Of its file.
    length : float
        Its longest side, in the numbers of the file.
    bodies : int
        That the file holds; 0 where they have not been told apart.
    unit : str or None
        Of the coordinates, where the file knows it.
    """

    name: str
    length: float
    bodies: int
    unit: str | None


@dataclass(frozen=True)
class MeshAnswer:
    """What the person said about meshes.

    Attributes
    ----------
    paths : tuple of Path
    unit : str
        Of the coordinates of files that do not know it.
    overrides : bool
        Whether the unit is that of all files, also of those that say another.
    resolution : int
        Voxels along a body of middle length.
    cavities : {"fill", "keep"}
    """

    paths: tuple[Path, ...]
    unit: str
    overrides: bool = False
    resolution: int = 120
    cavities: Cavities = "fill"


@dataclass(frozen=True, eq=False)
class OpenedMeshes:
    """What came of files of meshes.

    Attributes
    ----------
    grains : GrainSet or None
        None if no file could be read.
    left_out : tuple of (Path, str)
        Files that are not among the grains, and why.
    notes : tuple of str
        What was mended, filled or is to be minded.
    """

    grains: GrainSet | None
    left_out: tuple[tuple[Path, str], ...]
    notes: tuple[str, ...]


LeftOut = Sequence[tuple[Path, str]]


class MeshWork(Work):
    """Opens meshes.

    Attributes
    ----------
    asked : signal (tuple of Path, FirstStone or None, list of (Path, str))
        Files whose unit, resolution and cavities are to be asked for, and what is left out already. Answer
        with :meth:`open_answered`.
    opened : signal (OpenedMeshes)
        What became of them; they are in the project.
    """

    asked = Signal(object, object, object)
    opened = Signal(object)

    def open(self, paths: Sequence[Path], left_out: LeftOut = ()) -> Task:
        """Look at the first file, then ask for what files of meshes do not say."""
        files = tuple(paths)

        def work(control: Control) -> tuple[FirstStone | None, list[tuple[Path, str]]]:
            unread: list[tuple[Path, str]] = []
            for path in files[:_LOOKED_AT]:
                control.checkpoint()
                try:
                    return _look_at(path), unread
                except MeshError as error:
                    unread.append((path, str(error)))
            return None, unread

        def ask_about(found: tuple[FirstStone | None, list[tuple[Path, str]]]) -> None:
            first, unread = found
            if first is None and len(unread) == len(files):
                self.opened.emit(OpenedMeshes(None, (*left_out, *unread), ()))
            else:
                self.asked.emit(files, first, list(left_out))

        task = Task(tr("Looking at {name}", name=files[0].name), work)
        task.succeeded.connect(ask_about)
        return self.queue.submit(task)

    def open_answered(self, answer: MeshAnswer, left_out: LeftOut = ()) -> Task:
        """Make the bodies of meshes the grains of the project, with what the person said about them."""
        before = self.workspace.state.scan
        task = Task(
            tr("Opening {name}", name=name)
            if (name := _name_of(answer.paths))
            else tr("Opening {count} meshes", count=len(answer.paths)),
            lambda control: _open(answer, left_out, control),
        )
        task.succeeded.connect(lambda opened: self._use_meshes(opened, answer, before))
        return self.queue.submit(task)

    def _use_meshes(self, opened: OpenedMeshes, answer: MeshAnswer, before: ScanReference | None) -> None:
        if self.workspace.state.scan is not before:
            self.said.emit("warning", tr("A scan was opened in the meantime, so the meshes were not taken."))
            return
        if opened.grains is not None:
            settings = self.workspace.state.fit_settings
            options = {name: value for name, value in settings.options.items() if name != "cavities"}
            if answer.cavities == "keep":
                options["cavities"] = "keep"
            self.workspace.change(
                tr("Open {name}", name=name)
                if (name := _name_of(answer.paths))
                else tr("Open {count} meshes", count=len(answer.paths)),
                scan=None,
                segmentation=None,
                grains=opened.grains,
                fits=MappingProxyType({}),
                fit_settings=replace(settings, options=options),
            )
            folders = {path.absolute().parent for path in answer.paths}
            if len(answer.paths) == 1:
                self.workspace.remember(answer.paths[0])
            elif len(folders) == 1:
                self.workspace.remember(folders.pop())
        self.opened.emit(opened)


def _name_of(paths: Sequence[Path]) -> str:
    """Return the name of a single file; empty for several."""
    return paths[0].name if len(paths) == 1 else ""


def _look_at(path: Path) -> FirstStone:
    """Return the first body of a file; of large files only how long all is together."""
    data = read_mesh_data(path)
    length, count = float(np.ptp(data.vertices[data.faces.ravel()], axis=0).max()), 0
    if len(data.faces) <= _QUICK:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", GrainWarning)  # told when it is opened
            bodies = read_bodies(path)
        length, count = float(np.ptp(bodies[0].vertices, axis=0).max()), len(bodies)
    return FirstStone(path.name, length, count, data.unit)


def _open(answer: MeshAnswer, left_out: LeftOut, control: Control) -> OpenedMeshes:
    failed = list(left_out)
    known = {path for path, _ in failed}
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", GrainWarning)
        try:
            grains = grain_set_from_meshes(
                answer.paths,
                answer.resolution,
                answer.unit if answer.overrides else None,
                answer.cavities,
                on_failure=lambda path, error: failed.append((path, str(error))),
                assumed_unit=answer.unit,
                progress=control.progress,
            )
        except MeshError:
            if all(path in known for path, _ in failed):
                raise  # not of a single file
            return OpenedMeshes(None, tuple(failed), ())
    notes = [str(one.message) for one in told if issubclass(one.category, GrainWarning)]
    return OpenedMeshes(grains, tuple(failed), tuple(notes))
