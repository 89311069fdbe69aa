"""Finding grains, or loading labels made elsewhere, in the background."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import Signal

from mbstudio.core.batch.memory_estimate import MemoryNeed, need_of_segmentation
from mbstudio.core.batch.segmenting import segment_in_process
from mbstudio.core.errors import GrainWarning, SegmentationWarning, SeveralArraysError
from mbstudio.core.grains import GrainSet, load_labels
from mbstudio.core.grains.segmentation import SegmentationSettings
from mbstudio.core.memory import readable_bytes
from mbstudio.core.project import ProjectState
from mbstudio.core.project.regraining import Regraining, regrain
from mbstudio.core.scan import Scan
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
    would_discard : signal (str, callable)
        Other grains were found, and taking them would discard avatars or corrections: which. Call to take
        them all the same.
    """

    several = Signal(object, object)
    too_large = Signal(object, str)
    would_discard = Signal(str, object)

    def find(self, settings: SegmentationSettings, *, anyway: bool = False) -> Task | None:
        """Find the grains of the scan in place of the present ones; what did not change keeps its avatar."""
        scan = self.workspace.scan
        if scan is None:
            return None
        classifier = self.workspace.state.classifier if settings.by_classifier else None
        if settings.by_classifier and classifier is None:
            self.said.emit(
                "warning", tr("Paint strokes of grain and of void in the slices first, or load a classifier.")
            )
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

        def work(control: Control) -> _Found:
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always", SegmentationWarning)
                grains = segment_in_process(scan, settings, classifier=classifier, progress=control.progress)
            return self._compared(scan, grains, settings, _notes(told, SegmentationWarning))

        task = Task(tr("Finding grains"), work)
        task.succeeded.connect(lambda found: self._keep_grains(scan, found))
        return self.queue.submit(task)

    def load(self, path: Path) -> Task | None:
        """Take the labels of a label image of the scan's shape."""
        scan = self.workspace.scan
        if scan is None:
            return None

        def work(control: Control) -> _Found:
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always", GrainWarning)
                grains = load_labels(path, scan)
            return self._compared(scan, grains, None, _notes(told, GrainWarning))

        task = Task(tr("Loading {name}", name=path.name), work)
        task.succeeded.connect(lambda loaded: self._keep_grains(scan, loaded))
        task.handled = (SeveralArraysError,)
        task.failed.connect(self._ask_which)
        return self.queue.submit(task)

    def _ask_which(self, error: Exception) -> None:
        if isinstance(error, SeveralArraysError):
            self.several.emit(error, self.load)

    def _compared(
        self, scan: Scan, grains: GrainSet, settings: SegmentationSettings | None, notes: tuple[str, ...]
    ) -> _Found:
        """Return grains with what of the present work they keep; in a worker."""
        state = self.workspace.state
        return _Found(grains, settings, notes, state, regrain(state, grains, settings, scan))

    def _keep_grains(self, scan: Scan, found: _Found) -> None:
        if self.workspace.scan is not scan:
            self.said.emit(
                "warning",
                tr("The scan changed in the meantime, so the grains that were found do not belong to it."),
            )
            return
        state, regraining = self.workspace.state, found.regraining
        if state.grains is not found.state.grains or state.fits is not found.state.fits:
            # Work went on meanwhile: an avatar more, a grain corrected.
            regraining = regrain(state, found.grains, found.settings, scan)
        if not regraining.loses_something:
            self._take(found, regraining)
            return

        def take() -> None:
            self._keep_grains_anyway(scan, found)

        self.would_discard.emit(_words_of_loss(found.grains, regraining), take)

    def _keep_grains_anyway(self, scan: Scan, found: _Found) -> None:
        if self.workspace.scan is not scan:
            return
        self._take(found, regrain(self.workspace.state, found.grains, found.settings, scan))

    def _take(self, found: _Found, regraining: Regraining) -> None:
        grains = regraining.state.grains
        assert grains is not None
        inside = len(grains.interior_labels)
        title = (
            plural(len(grains), mark("Find {count} grain"), mark("Find {count} grains"))
            if found.settings
            else plural(len(grains), mark("Load {count} grain"), mark("Load {count} grains"))
        )
        self.workspace.use_grains(regraining, title)
        told = [
            plural(
                len(grains),
                mark("Found {count} grain, {inside} not cut by the edge of the scan. Click it, then fit it."),
                mark(
                    "Found {count} grains, {inside} of them not cut by the edge of the scan. Click one in "
                    "the view or the table, then fit it."
                ),
                inside=inside,
            )
        ]
        if regraining.kept:
            told.append(tr("{count} avatars stay: their grains did not change.", count=regraining.kept))
        doubts = grains.verdict.described if grains.verdict is not None else []
        level = "warning" if found.notes or doubts else "success"
        self.said.emit(level, " ".join((*told, *found.notes, *doubts[:1])))


@dataclass(frozen=True, eq=False)
class _Found:
    """Grains that were found or loaded, and what they keep of the state that there was then."""

    grains: GrainSet
    settings: SegmentationSettings | None
    notes: tuple[str, ...]
    state: ProjectState
    regraining: Regraining


def _words_of_loss(grains: GrainSet, regraining: Regraining) -> str:
    """Return what taking other grains would discard."""
    told = [tr("Found {count} grains.", count=len(grains))]
    gone = len(regraining.discarded)
    if gone:
        told.append(
            tr(
                "{gone} of {count} avatars would be discarded, as their grains have other voxels now; the "
                "others stay.",
                gone=gone,
                count=gone + regraining.kept,
            )
        )
    if regraining.left_out:
        told.append(
            tr(
                "{count} corrections by hand cannot be made again ({reason}).",
                count=len(regraining.left_out),
                reason=regraining.left_out[0][1].rstrip("."),
            )
        )
    return " ".join(told)


def words_of(need: MemoryNeed) -> str:
    """Return what is needed, and what is free where the system tells."""
    needed = readable_bytes(need.needed, 2)
    if need.free is None:
        return tr("about {needed} of memory", needed=needed)
    return tr("about {needed} of memory, {free} are free", needed=needed, free=readable_bytes(need.free, 2))


def _notes(told: list[warnings.WarningMessage], kind: type[Warning]) -> tuple[str, ...]:
    """Return what warnings of a kind say."""
    return tuple(str(one.message) for one in told if issubclass(one.category, kind))
