"""Opening a scan, or making the sample, in the background."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PySide6.QtCore import QObject, Signal

from mbstudio.core.errors import ScanError, ScanWarning, SeveralArraysError, UnitError
from mbstudio.core.project import ScanReference
from mbstudio.core.project.scan_reference import HOW_TO_RELOCATE, refer_to, reopen, reopen_whole
from mbstudio.core.scan import Scan, open_scan, sample_scan
from mbstudio.core.scan.excerpt import Counts
from mbstudio.core.scan.readers import raw
from mbstudio.core.scan.slice_stack import Block
from mbstudio.core.scan.voxel_blocks import in_memory_bytes, is_mapped
from mbstudio.core.units import VoxelSize
from mbstudio.ui.language import tr
from mbstudio.ui.stations.scan.dialog import ScanAnswer
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

IN_MEMORY = 4 * 2**30  # bytes up to which lazy slices are read at once, so that every cut is quick
SLAB_BYTES = 2**26  # bytes that are read between two reports of progress


@dataclass(frozen=True, eq=False)
class OpenedScan:
    """A scan with what a worker found out about it."""

    scan: Scan
    reference: ScanReference
    title: str
    name: str


def is_raw(path: Path) -> bool:
    """Return whether a file holds bare voxels, whose shape may have to be told."""
    return path.suffix.lower() in raw.FAMILY.suffixes


class ScanWork(Work):
    """Opens scans.

    Attributes
    ----------
    asked : signal (Path, str, bool)
        A scan whose voxel size is missing: its path, what is missing, whether it is RAW. Answer
        with :meth:`open_answered`.
    several : signal (SeveralArraysError, callable)
        A file holds several arrays. Call with the path of the one that is meant.
    missing : signal (str)
        The project's scan is not where it was, or is another one: what was found. Answer with
        :meth:`relocate`, or go on without it.
    """

    asked = Signal(object, str, bool)
    several = Signal(object, object)
    missing = Signal(str)

    def __init__(self, workspace: Workspace, queue: TaskQueue, parent: QObject | None = None) -> None:
        super().__init__(workspace, queue, parent)
        workspace.scan_forgotten.connect(self.reopen)

    def open(self, path: Path, voxel_size: VoxelSize | str | None = None) -> Task | None:
        """Open a file or a folder of slices; ask for what it does not say."""
        path = Path(path)
        if is_raw(path) and path.is_file() and not raw.describes_itself(path):
            self.asked.emit(path, tr("A RAW file contains only voxels. Describe them below."), True)
            return None
        size = VoxelSize.parse(voxel_size) if voxel_size is not None else None
        return self.open_answered(ScanAnswer(path, size))

    def open_answered(self, answer: ScanAnswer) -> Task:
        """Open a scan with what the person said about it."""
        path = answer.path

        def work(control: Control) -> OpenedScan:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ScanWarning)  # the scan's notes are shown
                scan = open_scan(
                    path,
                    answer.voxel_size,
                    shape=answer.shape,
                    dtype=answer.dtype,
                    header_bytes=answer.header_bytes,
                    big_endian=answer.big_endian,
                )
            control.checkpoint()
            return _opened(scan, tr("Open {name}", name=path.name), path.name.capitalize(), control)

        task = Task(tr("Opening {name}", name=path.name), work)
        task.succeeded.connect(self._use_scan)
        task.succeeded.connect(lambda _: self.workspace.remember(path))
        if answer.shape is None and is_raw(path):
            # What lies beside the file, or its name, may be wrong: the person can tell what is right.
            task.handled = (UnitError, ScanError)
            task.failed.connect(lambda error: self._ask(path, error))
            return self.queue.submit(task)
        task.handled = (SeveralArraysError,) if answer.voxel_size else (UnitError, SeveralArraysError)
        task.failed.connect(lambda error: self._ask_what_is_missing(answer, error))
        return self.queue.submit(task)

    def open_sample(self) -> Task:
        """Make the built-in sample scan."""
        task = Task(
            tr("Making the sample scan"),
            lambda control: _opened(
                sample_scan(control.progress).scan, tr("Open sample scan"), tr("Sample scan"), control
            ),
        )
        task.succeeded.connect(self._use_scan)
        return self.queue.submit(task)

    def take_part(self, scan: Scan, block: Block, factors: Counts) -> Task:
        """Go on with a part of the scan alone, as one step of undo.

        Parameters
        ----------
        scan : Scan
        block : tuple of slice
            Region in voxels of the scan (z, y, x).
        factors : tuple of int
            Voxels along z, y, x that become one.
        """
        is_region = any(part != slice(0, count) for part, count in zip(block, scan.shape, strict=True))
        titles = {(True, False): tr("Crop scan"), (False, True): tr("Bin scan")}
        title = titles.get((is_region, factors != (1, 1, 1)), tr("Crop and bin scan"))

        def work(control: Control) -> OpenedScan:
            part = scan.cropped(block).binned(factors)
            return _opened(part, title, _name_of(part), control)

        task = Task(title, work)
        task.succeeded.connect(lambda opened: self._take_part(scan, opened))
        return self.queue.submit(task)

    @property
    def is_part_of_file(self) -> bool:
        """Whether the scan is a part of a file that can be shown again as a whole."""
        reference = self.workspace.state.scan
        return reference is not None and reference.excerpt is not None and reference.path is not None

    def open_whole(self) -> Task | None:
        """Show all of the file again that the scan is a part of."""
        reference = self.workspace.state.scan
        if reference is None or reference.excerpt is None or reference.path is None:
            return None

        def work(control: Control) -> OpenedScan:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ScanWarning)
                scan = reopen_whole(reference)
            return _opened(scan, tr("Show the whole scan"), _name_of(scan), control)

        task = Task(tr("Opening {name}", name=reference.path.name), work)
        task.succeeded.connect(self._use_scan)
        return self.queue.submit(task)

    def reopen(self) -> Task | None:
        """Open the scan that the project refers to."""
        project, reference = self.workspace.project, self.workspace.state.scan
        if reference is None:
            return None
        task = Task(tr("Opening the project's scan"), lambda control: project.scan_of(reference))
        task.succeeded.connect(lambda scan: self._give_scan(project, reference, scan))
        task.handled = (ScanError,)
        task.failed.connect(lambda error: self._report_missing(project, error))
        return self.queue.submit(task)

    def relocate(self, path: Path) -> Task | None:
        """Take the project's scan from its new place; it must hold the same voxels."""
        project, reference = self.workspace.project, self.workspace.state.scan
        if reference is None:
            return None

        def use_relocated(scan: Scan) -> None:
            if project is self.workspace.project:
                self.workspace.change(tr("Relocate scan"), scan=replace(reference, path=path))
                self.workspace.give_scan(scan)
                self.said.emit("success", tr("Found the project's scan in {path}.", path=path))

        task = Task(tr("Opening {name}", name=path.name), lambda control: reopen(reference, path))
        task.succeeded.connect(use_relocated)
        task.handled = (ScanError,)
        task.failed.connect(lambda error: self._report_missing(project, error))
        return self.queue.submit(task)

    def _report_missing(self, project: object, error: Exception) -> None:
        cause = error.__cause__ if isinstance(error.__cause__, SeveralArraysError) else error
        if project is self.workspace.project and isinstance(cause, SeveralArraysError):
            self.several.emit(cause, self.relocate)
        elif project is self.workspace.project and isinstance(error, ScanError):
            # The window has a button where the command line has an option.
            self.missing.emit(str(error).replace(HOW_TO_RELOCATE, tr("locate the file")))

    def _give_scan(self, project: object, reference: ScanReference, scan: Scan) -> None:
        now = self.workspace.state.scan
        # Undo may have gone to another scan since.
        if project is self.workspace.project and now is not None and now.identity == reference.identity:
            self.workspace.give_scan(scan)

    def _ask_what_is_missing(self, answer: ScanAnswer, error: Exception) -> None:
        if isinstance(error, SeveralArraysError):
            self.several.emit(error, lambda path: self.open_answered(replace(answer, path=path)))
        elif isinstance(error, UnitError) and answer.voxel_size is None:
            self._ask(answer.path, error)

    def _ask(self, path: Path, error: Exception) -> None:
        if isinstance(error, ScanError):
            self.asked.emit(path, str(error), True)
        elif isinstance(error, UnitError):
            # What to do about it is what the window asks for.
            self.asked.emit(path, f"{str(error).rpartition(': ')[0] or error}.", False)

    def _take_part(self, scan: Scan, opened: OpenedScan) -> None:
        if self.workspace.scan is not scan:
            self.said.emit("warning", tr("The scan has changed since: choose the part again."))
            return
        self._use_scan(opened)

    def _use_scan(self, opened: OpenedScan) -> None:
        self.workspace.use_scan(opened.scan, opened.reference, opened.title)
        shape = " × ".join(str(count) for count in opened.scan.shape)
        told = tr(
            "{scan}: {shape} voxels of {voxel_size}. Next: find the grains.",
            scan=opened.name,
            shape=shape,
            voxel_size=opened.scan.voxel_size,
        )
        notes = opened.scan.notes
        self.said.emit("warning" if notes else "success", " ".join((told, *notes)))


def _opened(scan: Scan, title: str, name: str, control: Control) -> OpenedScan:
    """Do what reads many voxels: bring lazy slices into memory, and take the digest."""
    scan = in_memory(scan, control)
    return OpenedScan(scan, refer_to(scan), title, name)


def in_memory(scan: Scan, control: Control) -> Scan:
    """Return a scan whose voxels, and no others, are in memory; mapped and too large ones stay on disk."""
    voxels = scan.voxels
    size = in_memory_bytes(scan.shape, np.dtype(voxels.dtype))
    is_view = isinstance(voxels, np.ndarray) and voxels.base is not None and scan.excerpt is not None
    if is_mapped(voxels) or size > IN_MEMORY or (isinstance(voxels, np.ndarray) and not is_view):
        return scan
    volume = np.empty(scan.shape, voxels.dtype)
    step = max(1, SLAB_BYTES * len(volume) // max(1, size))
    for first in range(0, len(volume), step):
        control.progress(first / len(volume), tr("Reading slices"))
        volume[first : first + step] = voxels[first : first + step]
    return replace(scan, voxels=volume)


def _name_of(scan: Scan) -> str:
    return scan.path.name.capitalize() if scan.path is not None else tr("Sample scan")
