"""Judging the clones of a project against its grains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Signal

from mbstudio.core.batch.processes import usable_cores
from mbstudio.core.cloning.surface_generation import SurfaceGeneration
from mbstudio.core.errors import GenerationError
from mbstudio.ui.language import tr
from mbstudio.ui.stations.run import Run
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

if TYPE_CHECKING:
    from mbstudio.core.grains.grain_set import GrainSet
    from mbstudio.core.judging.features import Features
    from mbstudio.core.judging.judgement import Judgement
    from mbstudio.core.vae.generate.generation import Generation

MOST = 150
"""Grains and clones that are judged: more take long and tell little more."""
_MANY = 40


@dataclass(frozen=True, eq=False)
class Judged:
    """Clones judged against grains."""

    clones: Generation | SurfaceGeneration
    grains: GrainSet
    judgement: Judgement


class JudgeWork(Work):
    """Judges clones.

    Attributes
    ----------
    run : Run
    changed : signal
        Something runs or has ended, or there are other clones or grains.
    """

    changed = Signal()

    def __init__(self, workspace: Workspace, queue: TaskQueue, parent: QObject | None = None) -> None:
        super().__init__(workspace, queue, parent)
        self._judged: Judged | None = None
        self.refusal = ""
        self.run = Run(queue, self)
        self.run.changed.connect(self.changed)
        workspace.clones_changed.connect(self._forget)
        workspace.grains_changed.connect(self._forget)

    @property
    def judgement(self) -> Judgement | None:
        """What was found of the present clones and grains."""
        found, space = self._judged, self.workspace
        if found is None or found.clones is not space.clones or found.grains is not space.state.grains:
            return None
        return found.judgement

    @property
    def can_judge(self) -> bool:
        """Whether there are clones, and grains to judge them against."""
        return (
            self.workspace.clones is not None
            and self.workspace.state.grains is not None
            and not self.run.is_running
            and self.judgement is None
        )

    def judge(self) -> Task | None:
        """Judge the clones against all grains that the edge does not cut; None where that cannot be."""
        clones, grains = self.workspace.clones, self.workspace.state.grains
        if clones is None or grains is None or not self.can_judge:
            return None
        self.refusal = ""
        task = Task(tr("Judging the clones"), lambda control: _judged(clones, grains, control))
        task.handled = (GenerationError,)
        task.succeeded.connect(self._keep)
        task.failed.connect(self._refuse)
        return self.run.start(task)

    def _keep(self, found: Judged) -> None:
        self._judged = found
        self.changed.emit()

    def _refuse(self, error: Exception) -> None:
        self.refusal = str(error) if isinstance(error, GenerationError) else ""
        self.changed.emit()

    def _forget(self) -> None:
        self.refusal = ""
        self.changed.emit()


def _judged(clones: Generation | SurfaceGeneration, grains: GrainSet, control: Control) -> Judged:
    import numpy as np

    from mbstudio.core.judging.judging import judge
    from mbstudio.core.judging.measuring import measure_features

    def measured(bodies: list, begun: float) -> list[Features | str]:  # type: ignore[type-arg]
        return measure_features(
            bodies, workers=usable_cores() if len(bodies) >= _MANY else 0,
            progress=lambda share, told: control.progress(begun + 0.25 * share, told),
        )  # fmt: skip

    rng = np.random.default_rng(0)
    labels = grains.interior_labels
    chosen = sorted(rng.choice(len(labels), min(MOST, len(labels)), replace=False).tolist())
    rows = sorted(rng.choice(len(clones), min(MOST, len(clones)), replace=False).tolist())
    true = measured([grains.body(labels[place]) for place in chosen], 0.0)
    made = measured([clones.body(row) for row in rows], 0.25)
    # A clone of surfaces is a relative of the grain whose faces it has, if that is of this project.
    parents = [clone.parent for clone in clones.clones] if isinstance(clones, SurfaceGeneration) else None
    groups = [f"grain {labels[place]}" for place in chosen]
    found = judge(
        [entry for entry in true if not isinstance(entry, str)],
        [entry for entry in made if not isinstance(entry, str)],
        clone_parents=None
        if parents is None
        else [parents[row] for row, entry in zip(rows, made, strict=True) if not isinstance(entry, str)],
        true_groups=None
        if parents is None
        else [group for group, entry in zip(groups, true, strict=True) if not isinstance(entry, str)],
        progress=lambda share, told: control.progress(0.5 + 0.5 * share, tr("Judging")),
    )
    return Judged(clones, grains, found)
