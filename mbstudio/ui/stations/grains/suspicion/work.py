"""Looking for suspicious grains: all of them when the person asks, what an edit touched by itself."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from PySide6.QtCore import QObject

from mbstudio.core.grains import GrainSet
from mbstudio.core.grains.suspicion.scoring import score_grains
from mbstudio.core.grains.suspicion.suspects import Suspect
from mbstudio.core.twin.wrong_labels import more_suspicious, suspects_of_twin
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.offers import Offers
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Report, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

LANE = "looking"
AT_ONCE = 1.0
"""Seconds that looking may take to begin without being asked for."""
EACH = 0.05
"""Seconds that a grain takes before one was timed."""


class SuspicionWork(Work):
    """Scores grains in the background and offers what it finds as it comes.

    Parameters
    ----------
    workspace : Workspace
    queue : TaskQueue
    offers : Offers
        Gets the suspects.

    Attributes
    ----------
    task : Task or None
        The one that runs or ran last.
    """

    def __init__(
        self, workspace: Workspace, queue: TaskQueue, offers: Offers, parent: QObject | None = None
    ) -> None:
        super().__init__(workspace, queue, parent)
        self._offers = offers
        self._seen: GrainSet | None = None  # the grains that the suspects are of
        self._each = EACH
        self.task: Task | None = None
        self._twin: object = None  # that `_by_twin` is of
        self._by_twin: dict[int, Suspect] = {}
        workspace.grains_changed.connect(self._grains_changed)
        workspace.state_changed.connect(self._state_changed)

    @property
    def is_running(self) -> bool:
        """Whether grains are being looked at."""
        return self.task is not None and not self.task.is_over

    @property
    def missing(self) -> list[int]:
        """Labels of the grains that were not looked at as they are now."""
        grains = self.workspace.state.grains
        if grains is None:
            return []
        return [label for label in grains.table["label"].tolist() if label not in self._offers.suspects]

    @property
    def fraction(self) -> float:
        """Share of the grains that were looked at."""
        grains = self.workspace.state.grains
        return 0.0 if grains is None or not len(grains) else 1.0 - len(self.missing) / len(grains)

    def look(self) -> Task | None:
        """Look at all grains that were not looked at yet; None if there are none, or it is under way."""
        grains, labels = self.workspace.state.grains, self.missing
        if grains is None or not labels or self.is_running:
            return None
        scan = self.workspace.scan
        if scan is not None and scan.shape != grains.label_volume.shape:
            scan = None
        residuals = self.workspace.state.relative_residuals

        def steps(control: Control) -> Iterator[dict[str, Any]]:
            begun = time.monotonic()
            for count, row in enumerate(
                score_grains(grains.label_volume, grains.table, grains.voxel_size, scan, residuals, labels), 1
            ):
                self._each = (time.monotonic() - begun) / count
                yield {**row, "done": count}

        task = Task(
            tr("Looking for suspicious grains"),
            steps,
            fraction=lambda row: (
                row["done"] / len(labels),
                tr("{done} of {count} grains", done=row["done"], count=len(labels)),
            ),
        )
        self.task, self._seen = task, grains
        task.reported.connect(lambda report: self._take(task, report))
        task.succeeded.connect(lambda _: self._tell(len(labels)))
        self.queue.submit(task, lane=LANE)
        # After the queue's own: whoever is told finds the lane free.
        task.ended.connect(self._offers.suspects_changed)
        self._offers.suspects_changed.emit()
        return task

    def _take(self, task: Task, report: Report) -> None:
        if task is self.task and report.steps:
            rows = [Suspect.from_row(row) for row in report.steps]
            found = {one.label: more_suspicious(one, self._by_twin.get(one.label)) for one in rows}
            self._offers.offer_suspects({**self._offers.suspects, **found})

    def _tell(self, looked_at: int) -> None:
        grains = self.workspace.state.grains
        if grains is None or looked_at < len(grains):
            return  # what an edit touched: the person has not asked for words
        count = sum(one.is_suspicious for one in self._offers.suspects.values())
        told = plural(
            count,
            mark("{count} grain is suspicious. N goes to it."),
            mark("{count} grains are suspicious. N goes to the next, Enter accepts it."),
        )
        self.said.emit("success" if count else "info", told if count else tr("No grain is suspicious."))

    def _state_changed(self) -> None:
        """Take in what a new twin says of its grains; the rest is looked at when the person asks."""
        twin, grains = self.workspace.state.twin, self.workspace.state.grains
        if twin is self._twin:
            return
        self._twin = twin
        self._by_twin = {} if twin is None else suspects_of_twin(twin)
        if self._by_twin and grains is not None:
            self._seen = grains
            known = self._offers.suspects
            found = {label: more_suspicious(one, known.get(label)) for label, one in self._by_twin.items()}
            self._offers.offer_suspects({**known, **found})

    def _grains_changed(self) -> None:
        """Forget what is no longer so, and look again at what an edit touched, if that is quick."""
        now, before = self.workspace.state.grains, self._seen
        was_running = self.is_running
        if self.task is not None:
            self.task.cancel()
            self.task = None
        if before is None or now is None:
            self._seen = None
            self._offers.offer_suspects({})
            return
        gone = now.outdated_since(before)
        present = set(now.table["label"].tolist()) - gone
        known = {label: one for label, one in self._offers.suspects.items() if label in present}
        self._seen = now if known else None
        self._offers.offer_suspects(known)
        if known and (was_running or len(self.missing) * self._each <= AT_ONCE):
            self.look()
