"""Finding grains, or loading labels made elsewhere, in the background."""

from __future__ import annotations

import warnings
from pathlib import Path
from types import MappingProxyType

from PySide6.QtCore import Signal

from mbstudio.core.batch.memory_estimate import MemoryNeed, need_of_segmentation
from mbstudio.core.batch.segmenting import segment_in_process
from mbstudio.core.errors import GrainWarning, SegmentationWarning, SeveralArraysError
from mbstudio.core.grains import GrainSet, load_labels
from mbstudio.core.grains.segmentation import SegmentationSettings
from mbstudio.core.memory import readable_bytes
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Task


class GrainWork(Work):
    """Segments the scan.

    Attributes
    ----------
    several : signal (SeveralArraysError, callable)
        A file of labels holds several arrays. Call with the path of the one that is meant.
    too_large : signal (SegmentationSettings, str)
        The memory is too small for finding the grains with these settings: what it would take. To try it
        all the same, call :meth:`find` with `anyway`.
    """

    several = Signal(object, object)
    too_large = Signal(object, str)

    def find(self, settings: SegmentationSettings, *, anyway: bool = False) -> Task | None:
        """Find the grains of the scan in place of the present ones and their fits."""
        scan = self.workspace.scan
        if scan is None:
            return None
        need = need_of_segmentation(scan)
        if not need.fits and not anyway:
            self.too_large.emit(
                settings,
                tr(
                    "Finding the grains needs {need}: take a part of the scan or larger voxels "
                    "(station Scan, Crop or bin), or close other programs.",
                    need=words_of(need),
                ),
            )
            return None

        def work(control: Control) -> tuple[GrainSet, tuple[str, ...]]:
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always", SegmentationWarning)
                grains = segment_in_process(scan, settings, progress=control.progress)
            return grains, _notes(told, SegmentationWarning)

        task = Task(tr("Finding grains"), work)
        task.succeeded.connect(lambda found: self._keep_grains(scan, found[0], settings, found[1]))
        return self.queue.submit(task)

    def load(self, path: Path) -> Task | None:
        """Take the labels of a label image of the scan's shape."""
        scan = self.workspace.scan
        if scan is None:
            return None

        def work(control: Control) -> tuple[GrainSet, tuple[str, ...]]:
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always", GrainWarning)
                grains = load_labels(path, scan)
            return grains, _notes(told, GrainWarning)

        task = Task(tr("Loading {name}", name=path.name), work)
        task.succeeded.connect(lambda loaded: self._keep_grains(scan, loaded[0], None, loaded[1]))
        task.handled = (SeveralArraysError,)
        task.failed.connect(self._ask_which)
        return self.queue.submit(task)

    def _ask_which(self, error: Exception) -> None:
        if isinstance(error, SeveralArraysError):
            self.several.emit(error, self.load)

    def _keep_grains(
        self,
        scan: object,
        grains: GrainSet,
        settings: SegmentationSettings | None,
        notes: tuple[str, ...] = (),
    ) -> None:
        if self.workspace.scan is not scan:
            self.said.emit(
                "warning",
                tr("The scan changed in the meantime, so the grains that were found do not belong to it."),
            )
            return
        inside = len(grains.interior_labels)
        self.workspace.change(
            plural(len(grains), mark("Find {count} grain"), mark("Find {count} grains"))
            if settings
            else plural(len(grains), mark("Load {count} grain"), mark("Load {count} grains")),
            grains=grains,
            segmentation=settings,
            fits=MappingProxyType({}),
        )
        told = plural(
            len(grains),
            mark("Found {count} grain, {inside} not cut by the edge of the scan. Click it, then fit it."),
            mark(
                "Found {count} grains, {inside} of them not cut by the edge of the scan. Click one in "
                "the view or the table, then fit it."
            ),
            inside=inside,
        )
        doubts = grains.verdict.described if grains.verdict is not None else []
        self.said.emit("warning" if notes or doubts else "success", " ".join((told, *notes, *doubts[:1])))


def words_of(need: MemoryNeed) -> str:
    """Return what is needed, and what is free where the system tells."""
    needed = readable_bytes(need.needed, 2)
    if need.free is None:
        return tr("about {needed} of memory", needed=needed)
    return tr("about {needed} of memory, {free} are free", needed=needed, free=readable_bytes(need.free, 2))


def _notes(told: list[warnings.WarningMessage], kind: type[Warning]) -> tuple[str, ...]:
    """Return what warnings of a kind say."""
    return tuple(str(one.message) for one in told if issubclass(one.category, kind))
