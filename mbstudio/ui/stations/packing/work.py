"""Packing grains in the background, and what is being looked at of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Signal

from mbstudio.core.metaball import Avatar
from mbstudio.core.packing.frame import PackingFrame
from mbstudio.core.packing.packing import INSET, Packing
from mbstudio.core.packing.packing_files import write_packing
from mbstudio.core.packing.trial import PackingTrial, run_trial
from mbstudio.scene.packed_grains import PackedForms, PackedGrains, make_forms, posed, shares_of, sizes_of
from mbstudio.ui.language import tr
from mbstudio.ui.stations.run import Run
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Report, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

PARENTS, CLONES, SPHERES, ALL = "parents", "clones", "spheres", "all"
SUBJECTS = (PARENTS, CLONES, SPHERES, ALL)
TRIANGLES = {"OpenGL": 400_000, "software": 60_000}
"""Of all grains while they fall: what is drawn in a fraction of a twentieth of a second."""
SECONDS_A_GRAIN = 0.085
"""Of one core, for a grain of twenty spheres to settle among two hundred."""


@dataclass(frozen=True)
class PackRequest:
    """What is to be packed, and how.

    Attributes
    ----------
    subject : {'parents', 'clones', 'spheres', 'all'}
    count : int
    friction : float
    mould : {'box', 'cylinder'}
    seeds : int
        Packings of each kind.
    seed : int
        The first one.
    spheres : int
        Of each clump.
    inset : float
        Of the measures, in mean diameters.
    """

    subject: str = PARENTS
    count: int = 200
    friction: float = 0.5
    mould: str = "box"
    seeds: int = 1
    seed: int = 0
    spheres: int = 20
    inset: float = INSET


class PackingWork(Work):
    """Packs grains, and hands over what they look like on the way.

    Attributes
    ----------
    run : Run
    falling : PackedGrains or None
        The newest look at grains that settle; None while none do.
    changed : signal
        Packing begins, pauses, ends, or there is another packing.
    fallen : signal
        There is a newer `falling`.
    """

    changed = Signal()
    fallen = Signal()

    def __init__(
        self, workspace: Workspace, queue: TaskQueue, viewport: str, parent: QObject | None = None
    ) -> None:
        super().__init__(workspace, queue, parent)
        self._triangles = TRIANGLES[viewport]
        self.falling: PackedGrains | None = None
        self.run = Run(queue, self)
        self.run.changed.connect(self._run_changed)
        for signal in (workspace.packing_changed, workspace.fits_changed, workspace.clones_changed):
            signal.connect(self.changed)

    @property
    def trial(self) -> PackingTrial | None:
        """The packings of the project."""
        return self.workspace.state.packing

    @property
    def subjects(self) -> tuple[str, ...]:
        """What there is to pack."""
        parents, clones = self._parents(), self.workspace.clones is not None
        found = ((PARENTS, bool(parents)), (CLONES, clones), (SPHERES, bool(parents) or clones))
        there = [name for name, is_there in found if is_there]
        return (*there, ALL) if len(there) > 1 else tuple(there)

    def _parents(self) -> list[Avatar]:
        return [fit.avatar for fit in self.workspace.state.included_fits.values() if fit.verdict.valid]

    def _groups(self, subject: str) -> Mapping[str, Any]:
        """Return what is packed: avatars by name, or what yields them."""
        parents, clones = self._parents(), self.workspace.clones
        groups: dict[str, Any] = {}
        if parents and (subject in (PARENTS, ALL) or subject == SPHERES):
            groups[PARENTS] = lambda: parents
        if clones is not None and (subject in (CLONES, ALL) or (subject == SPHERES and not parents)):
            groups[CLONES] = clones.avatars
        return groups

    # ---- packing ---------------------------------------------------------------------------------

    def pack(self, asked: PackRequest) -> Task | None:
        """Pack as asked; None if there is nothing to pack or it runs already."""
        if self.run.is_running or asked.subject not in self.subjects:
            return None
        groups = self._groups(asked.subject)
        task = Task(tr("Packing grains"), lambda control: _pack(groups, asked, control, self._triangles))
        task.can_pause = True  # the engine waits for who takes its frames
        task.reported.connect(self._see)
        task.succeeded.connect(self._keep)
        return self.run.start(task)

    def _see(self, report: Report) -> None:
        if isinstance(report.view, PackedGrains):
            self.falling = report.view
            self.fallen.emit()

    def _keep(self, trial: PackingTrial) -> None:
        self.falling = None
        self.workspace.change(tr("Pack grains"), packing=trial)

    def _run_changed(self) -> None:
        if not self.run.is_running:
            self.falling = None
        self.changed.emit()

    # ---- files -----------------------------------------------------------------------------------

    def export(self, packing: Packing, folder: Path, inset: float) -> Task:
        """Write a packing into a folder: tables, summary, surfaces and mesh."""

        def work(control: Control) -> Path:
            control.checkpoint()
            write_packing(packing, folder, inset=inset)
            return folder

        return self.queue.submit(Task(tr("Writing the packing"), work))


def _pack(groups: Mapping[str, Any], asked: PackRequest, control: Control, triangles: int) -> PackingTrial:
    told: tuple[float, str] = (0.0, "")
    forms: PackedForms | None = None

    def progress(share: float, message: str) -> None:
        nonlocal told
        told = share, message
        control.progress(share, message)

    def watch(frame: PackingFrame) -> None:
        nonlocal forms
        control.checkpoint()
        if not control.is_due():
            return
        if forms is None or forms.kinds is not frame.kinds:
            forms = make_forms(frame.kinds, frame.poses.kinds, triangles)
        values, _, _ = shares_of(sizes_of(frame.kinds, frame.poses))
        control.report(*told, view=posed(forms, frame.poses, frame.mould, values))

    avatars: dict[str, Sequence[Avatar]] = {name: make() for name, make in groups.items()}
    return run_trial(
        avatars, asked.count, seeds=asked.seeds, seed=asked.seed, with_spheres=asked.subject == ALL,
        spheres_alone=asked.subject == SPHERES, inset=asked.inset, progress=progress, watch=watch,
        friction=asked.friction, mould=asked.mould, spheres=asked.spheres,
    )  # fmt: skip
