"""Finding grains, or loading labels made elsewhere, in the background."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

from mbstudio.core.batch.segmenting import segment_in_process
from mbstudio.core.grains import GrainSet, load_labels
from mbstudio.core.grains.segmentation import SegmentationSettings
from mbstudio.ui.language import tr
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Task


class GrainWork(Work):
    """Segments the scan."""

    def find(self, settings: SegmentationSettings) -> Task | None:
        """Find the grains of the scan in place of the present ones and their fits."""
        scan = self.workspace.scan
        if scan is None:
            return None

        def work(control: Control) -> GrainSet:
            return segment_in_process(scan, settings, progress=control.progress)

        task = Task(tr("Finding grains"), work)
        task.succeeded.connect(lambda grains: self._take(scan, grains, settings))
        return self.queue.submit(task)

    def load(self, path: Path) -> Task | None:
        """Take the labels of a label image of the scan's shape."""
        scan = self.workspace.scan
        if scan is None:
            return None
        task = Task(tr("Loading {name}", name=path.name), lambda control: load_labels(path, scan))
        task.succeeded.connect(lambda grains: self._take(scan, grains, None))
        return self.queue.submit(task)

    def _take(self, scan: object, grains: GrainSet, settings: SegmentationSettings | None) -> None:
        if self.workspace.scan is not scan:
            self.said.emit(
                "warning",
                tr("The scan was changed meanwhile: the grains that were found do not belong to it."),
            )
            return
        inside = len(grains.interior_labels)
        self.workspace.change(
            tr("Find {count} grains", count=len(grains))
            if settings
            else tr("Load {count} grains", count=len(grains)),
            grains=grains,
            segmentation=settings,
            fits=MappingProxyType({}),
        )
        self.said.emit(
            "success",
            tr(
                "{count} grains, {inside} of them not cut by the edge of the scan. "
                "Click one in the view or the table, then fit it.",
                count=len(grains),
                inside=inside,
            ),
        )
