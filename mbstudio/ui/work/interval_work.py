"""Finding between what the factors of a scanned grain lie, in the background."""

from __future__ import annotations

from PySide6.QtCore import Signal

from mbstudio.core.metrics import factor_intervals
from mbstudio.ui.language import tr
from mbstudio.ui.work.work import Work
from mbstudio.ui.workers import Task


class IntervalWork(Work):
    """Measures a grain again at other places on the voxels, thresholds and blurs.

    Attributes
    ----------
    found : signal (int, FactorIntervals)
        Label of the grain, and its intervals.
    """

    found = Signal(int, object)

    def find(self, label: int) -> Task | None:
        """Find the intervals of this grain; None if there are no grains."""
        grains = self.workspace.state.grains
        if grains is None:
            return None
        task = Task(
            tr("Finding the intervals of grain {label}", label=label),
            lambda control: factor_intervals(grains.grain(label)),
        )
        task.succeeded.connect(lambda intervals: self.found.emit(label, intervals))
        return self.queue.submit(task)
